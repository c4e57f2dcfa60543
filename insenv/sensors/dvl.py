"""Doppler velocity log of a ship: three components of its velocity over the ground, or through the water.

At an epoch, with the attitude C_nb, the velocity v_n and the angular rate omega_eb of the inertial unit:

    u_b = C_nb^T (v_n - c_n) + omega_eb x l
    y_b = (1 + k) C(e)^T u_b + noise w

l is the lever arm, k the scale factor error (the speed of sound), the same on all axes, e the rotation vector from the nominal
to the actual axes of the log.  Its output is in body axes by the nominal mounting.  c_n is the current, which enters only if
the log tracks the water: a constant and a first-order Gauss-Markov process north and east.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from insenv.attitude import from_rotation_vector, rotate_inverse
from insenv.base.toml import LeverArm, key
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.sensors import units
from insenv.sensors.contract import ErrorSource, Sensor
from insenv.sensors.figures import Figure, FiguresSection, Grade, TimedSection, by_name, figures_section
from insenv.sensors.imu import normals
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instruments import DVL
from insenv.sensors.sampled import Motion, Sampled, gauss_markov, root_sum

PARAMETERS = Table((
    DVL.told["dvl_lever_arm_b"],
    Row("dvl_noise", "White noise of each axis, standard deviation", "m/s", lower=0.0),
    Row("dvl_scale_factor", "Scale factor error, fixed part"),
    Row("dvl_scale_factor_sigma", "Scale factor error, 1 sigma of the part drawn at the start", lower=0.0),
    Row("dvl_misalignment", "Rotation vector from the nominal to the actual axes, fixed part", "rad", (3,), "b"),
    Row("dvl_misalignment_sigma", "Rotation vector from the nominal to the actual axes, 1 sigma of the part drawn at the start",
        "rad", (3,), "b", lower=0.0),
    Row("dvl_water_track", "1 if velocity is that through the water, 0 if it is that over the ground", lower=0.0, upper=1.0,
        flag=True),
    Row("dvl_current_n", "Current of the water, constant part", "m/s", (3,), "n"),
    Row("dvl_current_sigma", "Current of the water north and east (Gauss-Markov), standard deviation", "m/s", lower=0.0),
    Row("dvl_current_time", "Current of the water north and east (Gauss-Markov), correlation time", "s", start=3600.0,
        lower=1e-3, upper=HUGE),
))  # fmt: skip

STATE = Table((
    Row("dvl_scale_factor_true", "Scale factor error"),
    Row("dvl_misalignment_true", "Rotation vector from the nominal to the actual axes", "rad", (3,), "b"),
    Row("dvl_current_true", "Current of the water at the latest epoch", "m/s", (3,), "n"),
    Row("dvl_current", "Changing part of the current at the latest epoch, north and east", "m/s", (2,), "n"),
))  # fmt: skip


def _start(p: Values, r: Any) -> dict[str, Any]:
    n = normals(r)
    current = p.dvl_current_sigma * n[4:6]
    return {
        "dvl_misalignment_true": p.dvl_misalignment + p.dvl_misalignment_sigma * n[0:3],
        "dvl_scale_factor_true": p.dvl_scale_factor + p.dvl_scale_factor_sigma * n[3],
        "dvl_current": current,
        "dvl_current_true": p.dvl_current_n + ca.vertcat(current, 0.0),
    }


def _measure(p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
    n = normals(r)
    current = gauss_markov(x.dvl_current, p.dvl_current_sigma, p.dvl_current_time, p.dvl_interval, n[3:5])
    current_n = p.dvl_current_n + ca.vertcat(current, 0.0)
    lever = ca.cross(motion.rate_eb_b, p.dvl_lever_arm_b)
    velocity = rotate_inverse(x.q_nb, x.velocity_n - p.dvl_water_track * current_n) + lever
    seen = rotate_inverse(from_rotation_vector(x.dvl_misalignment_true), velocity)
    return {
        "dvl_velocity_b": seen + x.dvl_scale_factor_true * seen + p.dvl_noise * n[0:3],
        "dvl_velocity_true": rotate_inverse(x.q_nb, x.velocity_n) + lever,
        "dvl_current": current,
        "dvl_current_true": current_n,
    }


def _told(rows: Mapping[str, Any]) -> dict[str, Any]:
    current = root_sum(rows["dvl_current_n"], rows["dvl_current_sigma"])
    return {
        "dvl_lever_arm_b": rows["dvl_lever_arm_b"],
        "dvl_noise": rows["dvl_noise"],
        "dvl_scale_factor_sigma": root_sum(rows["dvl_scale_factor"], rows["dvl_scale_factor_sigma"]),
        "dvl_misalignment_sigma": root_sum(rows["dvl_misalignment"], rows["dvl_misalignment_sigma"]),
        "dvl_current_sigma": current * float(rows["dvl_water_track"]),
        "dvl_current_time": rows["dvl_current_time"],
    }


ERRORS = (
    ErrorSource("DVL noise", ("dvl_noise",)),
    ErrorSource("DVL scale factor", ("dvl_scale_factor", "dvl_scale_factor_sigma")),
    ErrorSource("DVL misalignment", ("dvl_misalignment", "dvl_misalignment_sigma")),
    ErrorSource("DVL current", ("dvl_current_n", "dvl_current_sigma")),
)

EQUATIONS = Sampled(
    DVL,
    parameters=PARAMETERS,
    state=STATE,
    exact=Table((Row("dvl_velocity_true", "True velocity of the log over the ground at the epoch", "m/s", (3,), "b"),)),
    measure=_measure,
    uniforms=6,
    truth=("dvl_scale_factor_true", "dvl_misalignment_true", "dvl_current_true"),
    told=_told,
    errors=ERRORS,
    start=_start,
    start_uniforms=6,
)

FIGURES: dict[str, Figure] = {
    "noise_mps": Figure("dvl_noise", "m/s"),
    "scale_factor_percent": Figure("dvl_scale_factor", "%", units.percent_to_one),
    "scale_factor_sigma_percent": Figure("dvl_scale_factor_sigma", "%", units.percent_to_one),
    "misalignment_deg": Figure("dvl_misalignment", "deg", units.deg_to_rad, vector=True),
    "misalignment_sigma_deg": Figure("dvl_misalignment_sigma", "deg", units.deg_to_rad, vector=True),
    "current_mps": Figure("dvl_current_n", "m/s", vector=True),
    "current_sigma_mps": Figure("dvl_current_sigma", "m/s"),
    "current_time_s": Figure("dvl_current_time", "s"),
}

_MOUNTED = "insenv's choice: angle that is left after a calibration run"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade(
        "survey",
        "Doppler velocity log of a survey vessel",
        {
            "noise_mps": "insenv's choice: 1 cm/s a ping",
            "scale_factor_sigma_percent": "Teledyne data sheets of bottom-tracking logs: 0.2 % of the speed",
            "misalignment_sigma_deg": _MOUNTED,
        },
        {"noise_mps": 0.01, "scale_factor_sigma_percent": 0.2, "misalignment_sigma_deg": 0.1},
    ),
    Grade(
        "ship",
        "Doppler velocity log of a ship",
        {
            "noise_mps": "Tang et al. 2013: 0.5 % of the speed +-0.5 cm/s; insenv's choice for a ping: 3 cm/s",
            "scale_factor_sigma_percent": "Tang et al. 2013: 0.5 % of the speed",
            "misalignment_sigma_deg": "insenv's choice: mounting in a dock",
        },
        {"noise_mps": 0.03, "scale_factor_sigma_percent": 0.5, "misalignment_sigma_deg": 0.5},
    ),
)

if TYPE_CHECKING:
    DvlFigures = FiguresSection
else:
    DvlFigures = figures_section("DvlFigures", PARAMETERS, GRADES, FIGURES, "ship")


class DvlSection(DvlFigures, TimedSection):
    """The Doppler velocity log."""

    sensor: ClassVar[Sensor] = EQUATIONS.sensor()

    lever_arm_m: LeverArm = key((0.0, 0.0, 0.0), "from the inertial unit to the log: forward, right, down", "m")
    water_track: bool = key(False, "whether the log shows the velocity through the water", strict=True)

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for times that do not fit the samples."""
        return {
            **self.timing(rate_hz),
            **self.error_rows(),
            "dvl_lever_arm_b": np.array(self.lever_arm_m),
            "dvl_water_track": float(self.water_track),
        }
