"""The section [imu] of a scenario: a grade, values that replace its own, and the mounting."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import create_model

from insenv import attitude
from insenv.base.errors import InputError
from insenv.base.toml import Number, key
from insenv.base.values import LeverArm, Rotation
from insenv.sensors import units
from insenv.sensors.contract import Sensor, SensorSection
from insenv.sensors.grade_file import GradeValue, grade_of
from insenv.sensors.imu import IMU
from insenv.sensors.imu_figures import FIGURES, WAYS, WHITE, figure_key


class _ImuSection(SensorSection):
    """The inertial unit: a grade, values that replace those of the grade, and the mounting."""

    sensor: ClassVar[Sensor] = IMU

    grade: GradeValue = key("perfect", "grade of the catalogue (docs/sensors.md), or a grade file (docs/allan.md)")
    lever_arm_m: LeverArm = key((0.0, 0.0, 0.0), "from the vehicle's centre of motion to the unit: forward, right, down", "m")
    mounting_angles_deg: Rotation = key(
        (0.0, 0.0, 0.0),
        "known roll, pitch and heading of the unit in the vehicle; its output is in body axes",
        "deg",
    )
    mounting_error_deg: Rotation = key((0.0, 0.0, 0.0), "rotation from the nominal to the actual sensor axes", "deg")
    drop_probability: Number = key(0.0, "probability that a sample is lost", "", ge=0, le=1)
    temperature_start_degc: Number = key(20.0, "temperature at time 0", "deg C", ge=-100, le=200)
    temperature_end_degc: Number = key(20.0, "temperature after warm-up", "deg C", ge=-100, le=200)
    temperature_reference_degc: Number = key(20.0, "temperature at which thermal errors are 0", "deg C", ge=-100, le=200)
    temperature_ramp_k_h: Number = key(0.0, "steady change with the surroundings", "K/h", ge=-100, le=100)
    warm_up_s: Number = key(600.0, "time constant of the warm-up", "s", ge=1e-3, le=1e9)

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI).  White noise per sample, if given here, is that of samples at `rate_hz`."""
        grade = grade_of(self.grade)
        own = {name: getattr(self, name) for name in FIGURES if getattr(self, name) is not None}
        for group in WAYS:
            given = [name for name in group if name in own]
            if len(given) > 1:
                raise InputError(f"imu has {' and '.join(given)}, which describe the same noise: allowed is one of them")
            if given:
                own = dict.fromkeys(group, 0.0) | own
        for name in WHITE:
            if own.get(name):
                own[name] *= float(np.sqrt(grade.white_rate_hz / rate_hz))
        rows = replace(grade, **own).parameters()
        return rows | {
            "imu_lever_arm_b": np.array(self.lever_arm_m),
            "q_bs": attitude.numeric.from_euler(*np.radians(self.mounting_angles_deg)),
            "mounting_error": np.radians(self.mounting_error_deg),
            "imu_drop_probability": self.drop_probability,
            "imu_temperature_initial": units.deg_c_to_k(self.temperature_start_degc),
            "imu_temperature_final": units.deg_c_to_k(self.temperature_end_degc),
            "imu_temperature_time": self.warm_up_s,
            "imu_temperature_reference": units.deg_c_to_k(self.temperature_reference_degc),
            "imu_temperature_ramp": self.temperature_ramp_k_h / units.HOUR,
        }


if TYPE_CHECKING:
    ImuSection = _ImuSection
else:
    ImuSection = create_model(
        "ImuSection",
        __base__=_ImuSection,
        __doc__=_ImuSection.__doc__,
        **{name: figure_key(name, "the grade's") for name in FIGURES},
    )
