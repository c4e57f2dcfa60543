"""The section [imu] of a scenario: a grade of the catalogue, any of its figures replaced, and the mounting."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import create_model, field_validator

from insenv.errors import InputError
from insenv.estimators.registry import SensorNotes
from insenv.files.toml import Number, Section, key
from insenv.geodesy import STANDARD_GRAVITY
from insenv.scenario.values import LeverArm, PerAxis, Rotation, one_of, within
from insenv.sensors import IMU_GRADES, IMU_PARAMETERS, imu_grade, units
from insenv.sensors.grades import CONVERSIONS, ImuGrade

LARGEST = 1e9
"""Bound of every figure, in its data-sheet unit."""
_WHITE = ("gyro_white_deg_h", "accel_white_ug")
_WAYS = (("gyro_arw_deg_sqrt_h", "gyro_white_deg_h"), ("accel_vrw_ug_sqrt_hz", "accel_vrw_m_s_sqrt_h", "accel_white_ug"))
"""Figures that say the same in different ways: one of each group is given."""
_SUFFIXES = {
    "_deg_h_sqrt_h": "deg/h/sqrt(h)", "_deg_sqrt_h": "deg/sqrt(h)", "_deg_h_g": "deg/h/g", "_deg_h_k": "deg/h/K",
    "_m_s_sqrt_h": "m/s/sqrt(h)", "_ug_sqrt_hz": "ug/sqrt(Hz)", "_ug_sqrt_h": "ug/sqrt(h)", "_ug_k": "ug/K", "_deg_h": "deg/h",
    "_deg_s": "deg/s", "_m_s": "m/s", "_ug": "ug", "_ppm": "ppm", "_urad": "urad", "_arcsec": "arcsec", "_time_s": "s",
    "_g": "g",
}  # fmt: skip


def unit_of(figure: str) -> str:
    """The unit that the name of a data-sheet figure shows."""
    return next((unit for suffix, unit in _SUFFIXES.items() if figure.endswith(suffix)), "")


class _ImuSection(Section):
    """The inertial unit: a grade, figures of the grade replaced, mounting."""

    grade: Annotated[str, one_of(IMU_GRADES)] = key("perfect", "grade of the catalogue (docs/sensors.md)")
    lever_arm_m: LeverArm = key((0.0, 0.0, 0.0), "from the vehicle's centre of motion to the unit, forward, right, down", "m")
    mounting_error_deg: Rotation = key((0.0, 0.0, 0.0), "rotation from the nominal to the actual sensor axes", "deg")
    drop_probability: Number = key(0.0, "probability that a sample is lost", "", ge=0, le=1)
    temperature_start_degc: Number = key(20.0, "temperature at time 0; thermal biases are 0 at 20", "deg C", ge=-100, le=200)
    temperature_end_degc: Number = key(20.0, "temperature after warming up", "deg C", ge=-100, le=200)
    warm_up_s: Number = key(600.0, "time constant of warming up", "s", ge=1e-3, le=1e9)

    @field_validator("grade")
    @classmethod
    def _known(cls, value: str) -> str:
        imu_grade(value)
        return value

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows, SI.  White noise given here per sample is that of the scenario's own samples."""
        grade = imu_grade(self.grade)
        own = {name: getattr(self, name) for name in _FIGURES if getattr(self, name) is not None}
        for group in _WAYS:
            given = [name for name in group if name in own]
            if len(given) > 1:
                raise InputError(f"imu has {' and '.join(given)}, which say the same in different ways: allowed is one of them")
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
    """Type and field of a figure: the grade's value unless given; meaning and sign from the parameter row."""
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


_FIGURES = tuple(f.name for f in fields(ImuGrade) if f.name not in ("name", "title", "sources", "white_rate_hz"))

if TYPE_CHECKING:
    ImuSection = _ImuSection
else:
    ImuSection = create_model(
        "ImuSection", __base__=_ImuSection, __doc__=_ImuSection.__doc__, **{name: _figure(name) for name in _FIGURES}
    )


def sensor_notes(rows: dict[str, Any], in_place: bool) -> SensorNotes:
    """What an estimator is told of a unit with these parameter rows: its data sheet, not what was drawn.

    Bias sigma, the largest of the axes: fixed, turn-on and in-run parts, and what g-sensitivity (gyros) and
    misalignment (accelerometers) make of gravity; for a vehicle on the move the scale factor too, which in place
    and about level changes only the vertical axis.  Correlation time: such that a first-order Gauss-Markov
    process of that sigma is driven as strongly as the in-run part, the bias random walk and, over an hour, the
    parts that depend on the motion; a bias that does not change has `CONSTANT`.
    """
    gravity = STANDARD_GRAVITY
    notes: dict[str, float] = {}
    for triad, white, floor in (("gyro", "angle_random_walk", 1e-9), ("accel", "velocity_random_walk", 1e-7)):
        largest = {name: float(np.max(np.abs(rows.get(f"{triad}_{name}", 0.0)))) for name in _NOTED}
        if triad == "gyro":
            motion = gravity * float(np.max(np.abs(rows.get("gyro_g_sensitivity", 0.0))))
        else:
            motion = gravity * max(largest["misalignment_sigma"], 0.0 if in_place else largest["scale_factor_sigma"])
        in_run = largest["instability_sigma"]
        variance = largest["bias"] ** 2 + largest["bias_sigma"] ** 2 + in_run**2 + motion**2
        drive = (
            2 * in_run**2 / max(largest["instability_time"], 1e-3)
            + largest["rate_random_walk"] ** 2
            + 2 * motion**2 / units.HOUR
        )
        sigma = max(variance**0.5, floor)
        notes[white] = max(largest["random_walk"], floor)
        notes[f"{triad}_bias_sigma"] = sigma
        notes[f"{triad}_correlation_time"] = 2 * sigma**2 / max(drive, 2 * sigma**2 / CONSTANT)
    return SensorNotes(**notes)


CONSTANT = 1e9
"""Correlation time (s) of a bias that does not change."""
_NOTED = (
    "bias", "bias_sigma", "instability_sigma", "instability_time", "rate_random_walk", "random_walk", "scale_factor_sigma",
    "misalignment_sigma",
)  # fmt: skip
