"""Rows of the aiding instruments: what each one shows, and what an estimator is told of its errors.

A sensor of a plant has the rows of a measurement as outputs, a recorded log has them as columns, and an estimator takes them as
inputs under the same names.  The values of the rows `told` are in `insenv.Knowledge.rows`; an estimator has them as parameters
under the same names.  Both are declared here only.

Every measurement has the rows ``NAME_new``, 1 on the one sample with which it arrives, and ``NAME_age``, the time from its
epoch to the end of that sample.  The other rows keep their values until the next measurement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from insenv.core.tables import Row, Table

_HUGE = 1e12
_LONGEST_ARM = 1e3
_NO_TIME: dict[str, Any] = {"start": 600.0, "lower": 1e-3, "upper": _HUGE}


@dataclass(frozen=True)
class Instrument:
    """One instrument: its id (that of the sensor and of its sections), title, measurement rows and told rows."""

    id: str
    title: str
    measurement: Table
    told: Table

    @property
    def new(self) -> str:
        """The row that is 1 on the sample with which a measurement arrives."""
        return f"{self.id}_new"

    @property
    def age(self) -> str:
        """The row of the time from the epoch of the latest measurement to its arrival."""
        return f"{self.id}_age"

    @property
    def values(self) -> tuple[str, ...]:
        """The rows of the measured values."""
        return tuple(name for name in self.measurement.names if name not in (self.new, self.age))


def _instrument(id: str, title: str, values: tuple[Row, ...], told: tuple[Row, ...]) -> Instrument:
    arrival = (
        Row(f"{id}_new", "1 on the one sample with which a measurement arrives", lower=0.0, upper=1.0, flag=True),
        Row(
            f"{id}_age",
            "Time from the epoch of the latest measurement to the end of that sample",
            "s",
            lower=-1.0,
            upper=3600.0,
        ),
    )
    return Instrument(id, title, Table((*arrival, *values)), Table(told))


def _sigma(name: str, meaning: str, unit: str = "1", shape: tuple[int, ...] = (), frame: str = "") -> Row:
    return Row(name, meaning, unit, shape, frame, lower=0.0, upper=_HUGE)


def _arm(name: str, of: str) -> Row:
    return Row(name, f"From the inertial unit to {of}", "m", (3,), "b", lower=-_LONGEST_ARM, upper=_LONGEST_ARM)


BAROMETER = _instrument(
    "barometer",
    "Barometer",
    (Row("barometer_height", "Height above the WGS-84 ellipsoid by the pressure of the air", "m", lower=-1e5, upper=1e6),),
    (
        _sigma("barometer_noise", "White noise of a height, quantum included", "m"),
        _sigma("barometer_bias_sigma", "Constant part of the error: weather, calibration", "m"),
        _sigma("barometer_drift_sigma", "Slowly changing part of the error (Gauss-Markov)", "m"),
        Row("barometer_drift_time", "Correlation time of that part", "s", **_NO_TIME),
        _sigma("barometer_scale_factor_sigma", "Error per height above the start: air warmer or colder than the standard"),
        _sigma("barometer_speed_error", "Dynamic pressure taken for static pressure, as a share: height error k v^2 / (2 g)"),
        Row("barometer_lag", "Time constant with which the instrument follows the height", "s", lower=0.0, upper=1e3),
    ),
)

MAGNETOMETER = _instrument(
    "magnetometer",
    "Magnetometer",
    (Row("magnetometer_field_b", "Magnetic flux density", "T", (3,), "b", lower=-1.0, upper=1.0),),
    (
        Row("magnetic_field_n", "Field of the Earth at the reported start", "T", (3,), "n", lower=-1e-3, upper=1e-3),
        Row("magnetic_field_gradient", "Its change per metre north, east, down (columns), components in the local n", "T/m",
            (3, 3), "n", lower=-1e-6, upper=1e-6),
        _sigma("magnetic_field_sigma", "Error of that field: model and crust, constant over a run", "T", (3,), "n"),
        _sigma("magnetometer_noise", "White noise of each axis, quantum included", "T"),
        _sigma("magnetometer_hard_iron_sigma", "Constant field of the vehicle, each axis", "T"),
        _sigma("magnetometer_soft_iron_sigma", "Diagonal of the soft-iron matrix, scale factors included"),
        _sigma("magnetometer_coupling_sigma", "Other elements of the soft-iron matrix, misalignment included"),
        _sigma("magnetometer_drift_sigma", "Slowly changing field of the vehicle (Gauss-Markov), each axis", "T"),
        Row("magnetometer_drift_time", "Correlation time of that field", "s", **_NO_TIME),
    ),
)  # fmt: skip

ODOMETER = _instrument(
    "odometer",
    "Odometer",
    (Row("odometer_speed", "Speed along the forward axis of the odometer", "m/s", lower=-1e4, upper=1e4),),
    (
        _arm("odometer_lever_arm_b", "the wheel's or sensor's point"),
        Row("odometer_mounting", "Rotation vector from b to the odometer's axes v, v_v = C(rotation)^T v_b", "rad", (3,), "b",
            lower=-7.0, upper=7.0),
        _sigma("odometer_mounting_sigma", "Error of that rotation, each axis", "rad"),
        _sigma("odometer_noise", "White noise of a speed, quantum included", "m/s"),
        _sigma("odometer_scale_factor_sigma", "Scale factor error: circumference of the wheel"),
        _sigma("odometer_slip_sigma", "Slip: relative speed error per forward specific force", "s^2/m"),
        _sigma("odometer_quantum", "Step in which the speed is shown, 0 for none", "m/s"),
    ),
)  # fmt: skip

DVL = _instrument(
    "dvl",
    "Doppler velocity log",
    (Row("dvl_velocity_b", "Velocity over the ground, or through the water", "m/s", (3,), "b", lower=-1e4, upper=1e4),),
    (
        _arm("dvl_lever_arm_b", "the log"),
        _sigma("dvl_noise", "White noise of each axis", "m/s"),
        _sigma("dvl_scale_factor_sigma", "Scale factor error, the same on all axes: speed of sound"),
        _sigma("dvl_misalignment_sigma", "Error of the mounting, each axis", "rad"),
        _sigma("dvl_current_sigma", "Current of the water, north and east (Gauss-Markov); 0 if the ground is tracked", "m/s"),
        Row("dvl_current_time", "Correlation time of the current", "s", **_NO_TIME),
    ),
)

HEADING = _instrument(
    "heading",
    "Two-antenna heading",
    (
        Row("heading_azimuth", "Azimuth of the baseline from the first to the second antenna, clockwise from north", "rad",
            lower=-7.0, upper=7.0),
        Row("heading_azimuth_sigma", "Standard deviation of the azimuth that the receiver reports", "rad", start=1.0,
            lower=0.0, upper=1e3),
        Row("heading_baseline_n", "The baseline; zero where only the azimuth is known", "m", (3,), "n", lower=-1e4, upper=1e4),
    ),
    (
        Row("heading_baseline_b", "From the first to the second antenna", "m", (3,), "b", start=(1.0, 0.0, 0.0),
            lower=-_LONGEST_ARM, upper=_LONGEST_ARM),
        _sigma("heading_baseline_sigma", "Error of that baseline, each axis", "m"),
        _sigma("heading_baseline_noise", "White noise of the measured baseline", "m", (3,), "n"),
        _sigma("heading_wander_sigma", "Slowly changing error of that (Gauss-Markov): multipath", "m", (3,), "n"),
        Row("heading_wander_time", "Correlation time of that error", "s", **{**_NO_TIME, "start": 60.0}),
    ),
)  # fmt: skip

INSTRUMENTS: Mapping[str, Instrument] = {each.id: each for each in (BAROMETER, MAGNETOMETER, ODOMETER, DVL, HEADING)}
"""The instruments by id."""

GNSS_TOLD = Table((
    _sigma("antenna_lever_arm_sigma", "Error of the lever arm of the antenna", "m", (3,), "b"),
    _sigma("gnss_delay_sigma", "Error of the age of a fix: true minus stated", "s"),
))  # fmt: skip
"""What is told of a GNSS receiver beside the fields of `insenv.Knowledge`."""

TOLD = sum((each.told for each in INSTRUMENTS.values()), GNSS_TOLD)
"""All told rows.  Their start values, mostly 0, mean "no such error"."""
