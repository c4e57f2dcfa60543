"""The figures of an inertial unit as keys of a file: a section [imu] and a grade file have the same."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any

from insenv.base.toml import Number, key
from insenv.base.values import PerAxis, within
from insenv.sensors.bounds import largest
from insenv.sensors.grades import CONVERSIONS, ImuGrade
from insenv.sensors.imu_tables import IMU_PARAMETERS

WHITE = ("gyro_white_deg_h", "accel_white_ug")
"""Values of white noise that belong to a sample rate."""
WAYS = (("gyro_arw_deg_sqrt_h", "gyro_white_deg_h"), ("accel_vrw_ug_sqrt_hz", "accel_vrw_m_s_sqrt_h", "accel_white_ug"))
"""Values that describe the same noise: at most one of each group may be given."""
_SUFFIXES = {
    "_deg_h_sqrt_h": "deg/h/sqrt(h)", "_deg_sqrt_h": "deg/sqrt(h)", "_deg_h_g": "deg/h/g", "_deg_h_k": "deg/h/K",
    "_m_s_sqrt_h": "m/s/sqrt(h)", "_ug_sqrt_hz": "ug/sqrt(Hz)", "_ug_sqrt_h": "ug/sqrt(h)", "_ug_k": "ug/K", "_ppm_k": "ppm/K",
    "_deg_h": "deg/h", "_deg_s": "deg/s", "_m_s": "m/s", "_ug": "ug", "_ppm": "ppm", "_urad": "urad", "_arcsec": "arcsec",
    "_time_s": "s", "_g": "g",
}  # fmt: skip


def unit_of(figure: str) -> str:
    """The unit in the name of a data-sheet value."""
    return next((unit for suffix, unit in _SUFFIXES.items() if figure.endswith(suffix)), "")


def figure_key(figure: str, otherwise: str) -> tuple[Any, Any]:
    """Type and field of a data-sheet value: None is the grade's; meaning and sign are those of the parameter row."""
    if figure in WHITE:
        what, lower = f"{'Gyro' if figure[0] == 'g' else 'Accelerometer'} white noise, standard deviation of one sample", 0.0
    else:
        row = IMU_PARAMETERS[CONVERSIONS[figure][0]]
        what, lower = row.meaning, row.lower
    most = largest(unit_of(figure))
    limits: dict[str, float] = {"le": most, "ge": -most if lower < 0.0 else 0.0}
    if "_range_" in figure or "_time_" in figure:
        limits = {"le": most, "gt": 0.0}
    meaning = f"{what[0].lower()}{what[1:]}; {otherwise} if absent"
    if figure in ("gyro_bias_deg_h", "accel_bias_ug"):
        return Annotated[PerAxis, within(-most, most)] | None, key(None, meaning, unit_of(figure))
    return Number | None, key(None, meaning, unit_of(figure), **limits)


FIGURES = tuple(f.name for f in fields(ImuGrade) if f.name not in ("name", "title", "sources", "white_rate_hz"))
"""Keys that give an error of the unit, in place of its grade's."""
