"""The contract of a sensor: a part of the plant, what of it is seen outside, and its section of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from insenv.core.compose import Part
from insenv.core.model import Values
from insenv.core.tables import Table
from insenv.files.toml import Section

Instant = Callable[[Values, Values], tuple[Any, Any]]
"""(parameters, state) -> true omega_eb^b (3, rad/s) and time derivative of velocity_n (3, m/s^2) at the end of the sample."""


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor as equations.

    Parameters
    ----------
    id: short name; of a sensor in a scenario also the name of its section.
    part: its rows and steps, made for a vehicle of which `Instant` is known.  Its functions see the true rows of the plant
        (``q_nb``, ``velocity_n``, ``latitude``, ``true_delta_angle``, ...) and the rows of the sensors before it.
    outputs: its state rows that the plant shows, and that estimators take as inputs of the same names.
    derived, derive: rows that the plant shows too, and ``(parameters, state) -> {row: value}`` that computes them.
    """

    id: str
    part: Callable[[Instant], Part]
    outputs: tuple[str, ...]
    derived: Table = field(default_factory=Table)
    derive: Callable[[Values, Values], Mapping[str, Any]] | None = None


class SensorSection(Section):
    """The section of a scenario that puts a sensor on the vehicle.

    A subclass names its `sensor` and declares its keys.  `insenv.register`, or the entry-point group ``insenv.sensors``,
    makes it known; ``[ID]`` in a scenario then is this section.
    """

    sensor: ClassVar[Sensor]

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows of the sensor, SI, on samples at `rate_hz`.  Raises `InputError` for what does not go together."""
        raise NotImplementedError
