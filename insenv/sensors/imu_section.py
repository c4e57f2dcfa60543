"""The section [imu] of a scenario: a grade of the catalogue, values that replace its own, and the mounting."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import create_model, field_validator

from insenv.errors import InputError
from insenv.files.toml import Number, key
from insenv.files.values import LeverArm, PerAxis, Rotation, one_of, within
from insenv.sensors import units
from insenv.sensors.catalogue import IMU_GRADES, imu_grade
from insenv.sensors.contract import Sensor, SensorSection
from insenv.sensors.grades import CONVERSIONS, ImuGrade
from insenv.sensors.imu import IMU
from insenv.sensors.imu_tables import IMU_PARAMETERS

LARGEST = 1e9
"""Bound of every value, in its data-sheet unit."""
_WHITE = ("gyro_white_deg_h", "accel_white_ug")
_WAYS = (("gyro_arw_deg_sqrt_h", "gyro_white_deg_h"), ("accel_vrw_ug_sqrt_hz", "accel_vrw_m_s_sqrt_h", "accel_white_ug"))
"""Values that describe the same noise: at most one of each group may be given."""
_SUFFIXES = {
    "_deg_h_sqrt_h": "deg/h/sqrt(h)", "_deg_sqrt_h": "deg/sqrt(h)", "_deg_h_g": "deg/h/g", "_deg_h_k": "deg/h/K",
    "_m_s_sqrt_h": "m/s/sqrt(h)", "_ug_sqrt_hz": "ug/sqrt(Hz)", "_ug_sqrt_h": "ug/sqrt(h)", "_ug_k": "ug/K", "_deg_h": "deg/h",
    "_deg_s": "deg/s", "_m_s": "m/s", "_ug": "ug", "_ppm": "ppm", "_urad": "urad", "_arcsec": "arcsec", "_time_s": "s",
    "_g": "g",
}  # fmt: skip


def unit_of(figure: str) -> str:
    """The unit in the name of a data-sheet value."""
    return next((unit for suffix, unit in _SUFFIXES.items() if figure.endswith(suffix)), "")


class _ImuSection(SensorSection):
    """The inertial unit: a grade, values that replace those of the grade, and the mounting."""

    sensor: ClassVar[Sensor] = IMU

    grade: Annotated[str, one_of(IMU_GRADES)] = key("perfect", "grade of the catalogue (docs/sensors.md)")
    lever_arm_m: LeverArm = key((0.0, 0.0, 0.0), "from the vehicle's centre of motion to the unit: forward, right, down", "m")
    mounting_error_deg: Rotation = key((0.0, 0.0, 0.0), "rotation from the nominal to the actual sensor axes", "deg")
    drop_probability: Number = key(0.0, "probability that a sample is lost", "", ge=0, le=1)
    temperature_start_degc: Number = key(20.0, "temperature at time 0; thermal biases are 0 at 20", "deg C", ge=-100, le=200)
    temperature_end_degc: Number = key(20.0, "temperature after warm-up", "deg C", ge=-100, le=200)
    warm_up_s: Number = key(600.0, "time constant of the warm-up", "s", ge=1e-3, le=1e9)

    @field_validator("grade")
    @classmethod
    def _known(cls, value: str) -> str:
        imu_grade(value)
        return value

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI).  White noise per sample, if given here, is that of samples at `rate_hz`."""
        grade = imu_grade(self.grade)
        own = {name: getattr(self, name) for name in FIGURES if getattr(self, name) is not None}
        for group in _WAYS:
            given = [name for name in group if name in own]
            if len(given) > 1:
                raise InputError(f"imu has {' and '.join(given)}, which describe the same noise: allowed is one of them")
            if given:
                own = dict.fromkeys(group, 0.0) | own
        for name in _WHITE:
            if own.get(name):
                own[name] *= float(np.sqrt(grade.white_rate_hz / rate_hz))
        rows = replace(grade, **own).parameters()
        return rows | {
            "imu_lever_arm_b": np.array(self.lever_arm_m),
            "mounting_error": np.radians(self.mounting_error_deg),
            "imu_drop_probability": self.drop_probability,
            "imu_temperature_initial": units.deg_c_to_k(self.temperature_start_degc),
            "imu_temperature_final": units.deg_c_to_k(self.temperature_end_degc),
            "imu_temperature_time": self.warm_up_s,
        }


def _figure(figure: str) -> tuple[Any, Any]:
    """Type and field of a data-sheet value: None is the grade's; meaning and sign are those of the parameter row."""
    if figure in _WHITE:
        what, lower = f"{'Gyro' if figure[0] == 'g' else 'Accelerometer'} white noise, standard deviation of one sample", 0.0
    else:
        row = IMU_PARAMETERS[CONVERSIONS[figure][0]]
        what, lower = row.meaning, row.lower
    limits: dict[str, float] = {"le": LARGEST, "ge": -LARGEST} if lower < 0.0 else {"le": LARGEST, "ge": 0.0}
    if "_range_" in figure or "_time_" in figure:
        limits = {"le": LARGEST, "gt": 0.0}
    meaning = f"{what[0].lower()}{what[1:]}; the grade's if absent"
    if figure in ("gyro_bias_deg_h", "accel_bias_ug"):
        return Annotated[PerAxis, within(-LARGEST, LARGEST)] | None, key(None, meaning, unit_of(figure))
    return Number | None, key(None, meaning, unit_of(figure), **limits)


FIGURES = tuple(f.name for f in fields(ImuGrade) if f.name not in ("name", "title", "sources", "white_rate_hz"))
"""Keys that give an error of the unit, in place of its grade's."""

if TYPE_CHECKING:
    ImuSection = _ImuSection
else:
    ImuSection = create_model(
        "ImuSection", __base__=_ImuSection, __doc__=_ImuSection.__doc__, **{name: _figure(name) for name in FIGURES}
    )
