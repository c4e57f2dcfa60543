"""What an estimator is told at the start: where it is, how it stands and moves, and the stated errors of its instruments."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from insenv.base.errors import UnknownArgumentError
from insenv.core.tables import Table, Vector, check_rows
from insenv.sensors import registry as sensor_registry
from insenv.sensors.data_sheet import ImuDataSheet
from insenv.sensors.gnss import ARM

_ZERO = np.zeros(3)


class _Stated(dict[str, Any]):
    """Rows stated of instruments; a row that nothing states has its start value, which means "no such error"."""

    def __missing__(self, name: str) -> Any:
        row = sensor_registry.stated_rows()[name]
        return row.flat_start().reshape(row.shape) if row.shape else float(row.start)


@dataclass(frozen=True)
class Knowledge:
    """What is known at the start, SI and radians: the place, and for navigation the initial velocity and attitude.

    latitude, longitude (rad), height (m); velocity_n (3, m/s); roll, pitch, heading (rad): with their errors.
    *_sigma: their standard deviations.  gyro_bias (rad/s, b), accel_bias (m/s^2, b): as far as known.
    gyro_bias_error (rad/s): standard deviation of gyro_bias, each axis, if the attitude were right; 0: that of the data sheet.
    rest_share: the part of gyro_bias that is the rate at rest less the Earth's rate in the attitude above, 0 to 1; through it
    an error of the attitude is one of the bias too.
    rotation_error, thrust_error: scale factor and misalignment of gyros and accelerometers, 1 sigma, 1; 0: not stated.
    instruments: what is stated of the receiver and of the aiding instruments, lever arms and errors, by row name of
    `sensors.registry.stated_rows`; a row that is missing means "no such error", and ``instruments[row]`` is its start value.
    """

    latitude: float
    longitude: float
    height: float
    sample_interval: float
    velocity_n: Vector = field(default_factory=lambda: _ZERO)
    roll: float = 0.0
    pitch: float = 0.0
    heading: float = 0.0
    position_sigma: Vector = field(default_factory=lambda: np.full(3, 1.0))
    velocity_sigma: Vector = field(default_factory=lambda: np.full(3, 0.1))
    tilt_sigma: float = 0.01
    heading_sigma: float = 0.1
    gyro_bias: Vector = field(default_factory=lambda: _ZERO)
    accel_bias: Vector = field(default_factory=lambda: _ZERO)
    gyro_bias_error: float = 0.0
    rest_share: float = 0.0
    rotation_error: float = 0.0
    thrust_error: float = 0.0
    sensors: ImuDataSheet = field(default_factory=ImuDataSheet)
    instruments: Mapping[str, Any] = field(default_factory=dict)

    def __new__(cls, *positional: Any, **values: Any) -> Knowledge:
        """Refuse the former fields of a receiver, which are rows of `instruments`."""
        for name in _FORMER:
            if name in values:
                raise UnknownArgumentError(
                    f"Knowledge({name}=...): no field has this name: allowed is Knowledge(instruments={{{name!r}: ...}})"
                )
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if self.instruments:
            check_rows(self.instruments, sensor_registry.stated_rows())
        object.__setattr__(self, "instruments", _Stated(self.instruments))

    def __getattr__(self, name: str) -> Any:
        """The former fields of a receiver, which are rows of `instruments`."""
        if name not in _FORMER:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        warnings.warn(f"Knowledge.{name} is now Knowledge.instruments[{name!r}]", FutureWarning, stacklevel=2)
        return self.instruments[name]

    @cached_property
    def rows(self) -> dict[str, Any]:
        """Every value by the name of its field, those of `sensors` included, and once more as ``start_NAME``; stated errors."""
        values = {name: getattr(self, name) for name in VALUES}
        start = {f"start_{name}": value for name, value in values.items()}
        return {**start, **values, **vars(self.sensors), **self.instruments}

    def rows_of(self, table: Table) -> dict[str, Any]:
        """The values of those rows of a table that are in `rows`."""
        return {name: self.rows[name] for name in table.names if name in self.rows}

    @staticmethod
    def field_of(row: str) -> str:
        """The name without ``start_`` of the value that `rows` has under the name `row`; empty if there is none."""
        if row in _SHEET or row in sensor_registry.stated_rows():
            return row
        name = row.removeprefix("start_")
        return name if name in VALUES else ""


_FORMER = (ARM.name, "fix_wander_sigma", "fix_wander_time")
_SHEET = frozenset(each.name for each in fields(ImuDataSheet))
VALUES = tuple(each.name for each in fields(Knowledge) if each.name not in ("sensors", "instruments"))
"""Names of the fields that are values."""
