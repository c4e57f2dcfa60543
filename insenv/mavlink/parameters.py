"""Parameters of the stream, of the scenario's sensors and of the estimator.

All are REAL32, because clients disagree on how PARAM_VALUE encodes integers.  Units are degrees, deg/h, deg/sqrt(h), ug
and ug/sqrt(Hz) where the tables have SI units (docs/mavlink.md).

The equations determine when a new value takes effect.  A parameter on which a step of the model depends acts from
the next sample on.  One on which only the start depends acts at the next alignment if it is the estimator's, and cannot
be set if it is the plant's, whose run has begun.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import isfinite

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.model import Model
from insenv.core.tables import Row, Vector
from insenv.mavlink.simulation import Simulation
from insenv.sensors.gnss import GNSS_PARAMETERS
from insenv.sensors.grades import elements
from insenv.sensors.imu_tables import IMU_PARAMETERS
from insenv.sensors.units import SHOWN

REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""
MAX_SET_VALUE = 1e6
"""Largest magnitude that can be set, in the unit shown, where the row itself allows more."""

NOW, NEXT_ALIGNMENT, NEVER = "now", "next alignment", "never"
_TIMING = ("gnss_interval", "gnss_latency", "gnss_epoch_offset", "drift_interval")
"""Rows that must remain whole numbers of samples: they cannot be set."""


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    acts: when a new value takes effect (`NOW`, `NEXT_ALIGNMENT`, or `NEVER`: it cannot be set).  lower, upper: bounds
    in `unit`.
    """

    name: str
    meaning: str
    unit: str
    acts: str
    lower: float
    upper: float
    read: Callable[[], float]
    write: Callable[[float], None] | None = None

    def value(self) -> float:
        """The value as it is sent: the nearest float32."""
        return float(np.float32(min(max(self.read(), -3e38), 3e38)))

    def set(self, value: float) -> None:
        """Set the value.  Raises `InputError` if it is out of range or cannot be set."""
        if self.write is None:
            raise InputError(f"{self.name} cannot be set during a run")
        if not isfinite(value) or not self.lower <= value <= self.upper:
            raise InputError(f"{self.name} = {value:g}: allowed is {self.lower:g} to {self.upper:g} {self.unit}".rstrip())
        self.write(value)


class Parameters:
    """The parameters of a vehicle, in order and by name: the vehicle's, those of the plant's sensors, of the estimator."""

    def __init__(self, parameters: Iterable[Parameter], simulation: Simulation) -> None:
        self.all = [*parameters, *_of_plant(simulation), *_of_estimator(simulation)]
        self._places = {parameter.name: place for place, parameter in enumerate(self.all)}

    def __len__(self) -> int:
        return len(self.all)

    def find(self, name: str) -> int:
        """The index of a parameter.  Raises `InputError` for an unknown name."""
        if name not in self._places:
            raise InputError(f"no parameter {name!r}{nearest(name, self._places)[:60]}")
        return self._places[name]


def _of_plant(simulation: Simulation) -> Iterator[Parameter]:
    model = simulation.plant.model
    live = used_by_steps(model)
    for row, place, name in elements("S", model.parameters, IMU_PARAMETERS.names + GNSS_PARAMETERS.names):
        acts = NOW if live[place] and row.name not in _TIMING else NEVER
        yield _element(row, name, acts, place, simulation.plant_parameters, simulation.set_plant_parameter)


def _of_estimator(simulation: Simulation) -> Iterator[Parameter]:
    model = simulation.estimator.model
    live = used_by_steps(model)
    for row, place, name in elements("E", model.parameters, model.parameters.names):
        acts = NOW if live[place] else NEXT_ALIGNMENT
        if row.name == "sample_interval" or row.name.startswith("start_"):  # known anew at each alignment
            acts = NEVER
        yield _element(row, name, acts, place, simulation.estimator_parameters, simulation.set_estimator_parameter)


def _element(row: Row, name: str, acts: str, place: int, values: Vector, write: Callable[[int, float], None]) -> Parameter:
    """The parameter that is element `place` of a model's parameters `values`, in the unit shown."""
    unit, to_si = SHOWN.get(row.unit, (row.unit, float))
    scale = float(to_si(1.0))

    def set_value(value: float) -> None:
        write(place, min(max(float(to_si(value)), row.lower), row.upper))

    lower, upper = max(row.lower / scale, -MAX_SET_VALUE), min(row.upper / scale, MAX_SET_VALUE)
    return Parameter(
        name, row.meaning, "" if unit == "1" else unit, acts, lower, upper,
        lambda: float(values[place]) / scale, None if acts == NEVER else set_value,
    )  # fmt: skip


def used_by_steps(model: Model) -> list[bool]:
    """Whether a step or the output depends on each element of the model's parameters."""
    used = np.zeros(model.parameters.size, dtype=bool)
    for name, kernel in model.kernels.items():
        if name != "start":
            used[sorted(set(kernel.function.jac_sparsity(0, 0).get_triplet()[1]))] = True
    return used.tolist()


def of_mapping(values: dict[str, float], key: str, name: str, meaning: str, unit: str, upper: float) -> Parameter:
    """The parameter that is an entry of a mapping, from 0 to `upper`; it may be changed at any time."""
    return Parameter(name, meaning, unit, NOW, 0.0, upper, partial(values.__getitem__, key), partial(values.__setitem__, key))
