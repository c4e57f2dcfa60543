"""The contract of a sensor: its part of the plant, its outputs, and its section of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from insenv.base.toml import Section
from insenv.core.compose import Part
from insenv.core.model import Values
from insenv.core.tables import Table

Instant = Callable[[Values, Values], tuple[Any, Any, Any]]
"""(parameters, state) -> true omega_eb^b (3, rad/s), its time derivative (3, rad/s^2) and d(velocity_n)/dt (3, m/s^2) at
the end of the sample."""
HUGE = 1e12
"""Represents "no limit": tables hold finite numbers only."""


def no_motion(p: Values, x: Values) -> tuple[Any, Any, Any]:
    """An `Instant` of a part of which only the rows are read."""
    raise NotImplementedError


@dataclass(frozen=True)
class ErrorSource:
    """One source of errors, which can be switched off alone.

    name: in tables ("gyro white noise").  rows: the parameter rows that make it.  off: their value without the error.
    """

    name: str
    rows: tuple[str, ...]
    off: float = 0.0


@dataclass(frozen=True)
class Stated:
    """What a measurement states of its own accuracy, which follows from the parameters of its errors.

    when: the row that is 1 on the sample with which a measurement arrives.  rows: ``(parameters, state) -> {row: value}``.
    """

    when: str
    rows: Callable[[Values, Values], dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor as equations.

    Parameters
    ----------
    id: short name; of a sensor in a scenario also the name of its section (lower-case letters, digits and ``_``).
    part: from the vehicle's `Instant` to the sensor's rows and steps.  Its functions can use the true rows of the plant
        (``q_nb``, ``velocity_n``, ``latitude``, ``true_delta_angle``, ...) and the rows of the sensors before it.
    outputs: state rows that are outputs of the plant, and inputs of the same names of estimators.
    derived, derive: further outputs of the plant, and ``(parameters, state) -> {row: value}`` that computes them.
    truth: state rows that are outputs of the plant to compare estimates with; no estimator and no agent gets them.
    stated_errors: ``(parameter rows by name) -> {row: value}``, its errors as stated to an estimator, by rows of
        `insenv.sensors.registry.stated_rows`.
    errors: the sources of its errors, for error budgets.  None: they are not known.
    stated: what its measurements state of their accuracy; None: nothing that depends on the parameters of its errors.
    """

    id: str
    part: Callable[[Instant], Part]
    outputs: tuple[str, ...]
    derived: Table = field(default_factory=Table)
    derive: Callable[[Values, Values], Mapping[str, Any]] | None = None
    truth: tuple[str, ...] = ()
    stated_errors: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    errors: tuple[ErrorSource, ...] | None = None
    stated: Stated | None = None

    @property
    def measured(self) -> Table:
        """The rows of its `outputs`: units, frames and shapes in which it feeds estimators."""
        state = self.part(no_motion).state
        return Table(tuple(state[name] for name in self.outputs))


@dataclass(frozen=True)
class Place:
    """Where a run starts: geodetic latitude and longitude (rad), height above the ellipsoid (m); its decimal year, if known."""

    latitude: float
    longitude: float
    height: float
    year: float | None = None


class SensorSection(Section):
    """The section of a scenario that puts a sensor on the vehicle.

    A subclass names its `sensor`, declares its keys and defines `rows`.  `insenv.register`, or the entry-point group
    ``insenv.sensors``, registers it under the id of its sensor; a scenario has it as ``[ID]``.
    """

    sensor: ClassVar[Sensor]

    @property
    def max_age_s(self) -> float:
        """Largest age of a measurement when it arrives, s."""
        return 0.0

    def notes(self, rate_hz: float) -> tuple[str, ...]:
        """Sentences on what the simulation does not do as the keys state it, for a reader of the results."""
        return ()

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for values that conflict."""
        raise NotImplementedError

    def rows_at(self, rate_hz: float, place: Place) -> dict[str, Any]:
        """Parameter rows (SI) for a run that starts at `place`: `rows`, unless the surroundings set some of them."""
        return self.rows(rate_hz)
