"""Odometer: the speed of a wheel, or of a radar, along its forward axis.

At an epoch, with the attitude C_nb, the velocity v_n and the angular rate omega_eb of the inertial unit:

    u_b = C_nb^T v_n + omega_eb x l
    y   = (1 + k + s f_x) e_x . u_b + noise w,   rounded to the quantum

l is the lever arm and e_x the forward axis: the first of the axes that the mounting, and after it the mounting error, turn
from b. k is the scale factor error (the circumference of the wheel).  s f_x is the slip of a driven or braked wheel, which is
proportional to the force that it transmits: f_x is the forward specific force over the sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from insenv.attitude import from_rotation_vector, multiply, rotate, rotate_inverse
from insenv.base.toml import LeverArm, Number, Rotation, key
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.sensors import units
from insenv.sensors.contract import ErrorSource, Sensor
from insenv.sensors.figures import Figure, FiguresSection, Grade, TimedSection, by_name, figures_section
from insenv.sensors.imu import normals
from insenv.sensors.instruments import ODOMETER
from insenv.sensors.sampled import QUANTUM_SIGMA, Motion, Sampled, root_sum, rounded

PARAMETERS = Table((
    ODOMETER.told["odometer_lever_arm_b"],
    ODOMETER.told["odometer_mounting"],
    Row("odometer_mounting_error", "Rotation vector from the nominal to the actual axes, fixed part", "rad", (3,), "v"),
    Row("odometer_mounting_error_sigma", "Rotation vector from the nominal to the actual axes, 1 sigma of the drawn part",
        "rad", (3,), "v", lower=0.0),
    Row("odometer_noise", "White noise of a speed, standard deviation", "m/s", lower=0.0),
    Row("odometer_scale_factor", "Scale factor error, fixed part"),
    Row("odometer_scale_factor_sigma", "Scale factor error, 1 sigma of the part drawn at the start", lower=0.0),
    Row("odometer_slip", "Slip per forward specific force, fixed part", "s^2/m", lower=-1.0, upper=1.0),
    Row("odometer_slip_sigma", "Slip per forward specific force, 1 sigma of the part drawn at the start", "s^2/m", lower=0.0),
    Row("odometer_quantum", "Step in which the speed is shown, 0 for none", "m/s", lower=0.0),
))  # fmt: skip

STATE = Table((
    Row("odometer_scale_factor_true", "Scale factor error"),
    Row("odometer_slip_true", "Slip per forward specific force", "s^2/m"),
    Row("odometer_mounting_error_true", "Rotation vector from the nominal to the actual axes", "rad", (3,), "v"),
    Row("odometer_axis", "Forward axis of the odometer", "1", (3,), "b", (1.0, 0.0, 0.0)),
))  # fmt: skip


def _start(p: Values, r: Any) -> dict[str, Any]:
    n = normals(r)
    error = p.odometer_mounting_error + p.odometer_mounting_error_sigma * n[0:3]
    q_bv = multiply(from_rotation_vector(p.odometer_mounting), from_rotation_vector(error))
    return {
        "odometer_mounting_error_true": error,
        "odometer_axis": rotate(q_bv, ca.SX([1.0, 0.0, 0.0])),
        "odometer_scale_factor_true": p.odometer_scale_factor + p.odometer_scale_factor_sigma * n[3],
        "odometer_slip_true": p.odometer_slip + p.odometer_slip_sigma * n[4],
    }


def _measure(p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
    n = normals(r)
    velocity_b = rotate_inverse(x.q_nb, x.velocity_n) + ca.cross(motion.rate_eb_b, p.odometer_lever_arm_b)
    speed = ca.dot(x.odometer_axis, velocity_b)
    force = x.true_delta_velocity[0] / p.sample_interval
    shown = (1.0 + x.odometer_scale_factor_true + x.odometer_slip_true * force) * speed + p.odometer_noise * n[0]
    return {"odometer_speed": rounded(shown, p.odometer_quantum), "odometer_speed_true": speed}


def _told(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "odometer_lever_arm_b": rows["odometer_lever_arm_b"],
        "odometer_mounting": rows["odometer_mounting"],
        "odometer_mounting_sigma": root_sum(rows["odometer_mounting_error"], rows["odometer_mounting_error_sigma"]),
        "odometer_noise": root_sum(rows["odometer_noise"], QUANTUM_SIGMA * rows["odometer_quantum"]),
        "odometer_scale_factor_sigma": root_sum(rows["odometer_scale_factor"], rows["odometer_scale_factor_sigma"]),
        "odometer_slip_sigma": root_sum(rows["odometer_slip"], rows["odometer_slip_sigma"]),
        "odometer_quantum": rows["odometer_quantum"],
    }


ERRORS = (
    ErrorSource("odometer noise", ("odometer_noise",)),
    ErrorSource("odometer scale factor", ("odometer_scale_factor", "odometer_scale_factor_sigma")),
    ErrorSource("odometer slip", ("odometer_slip", "odometer_slip_sigma")),
    ErrorSource("odometer mounting", ("odometer_mounting_error", "odometer_mounting_error_sigma")),
    ErrorSource("odometer rounding", ("odometer_quantum",)),
)

EQUATIONS = Sampled(
    ODOMETER,
    parameters=PARAMETERS,
    state=STATE,
    exact=Table((Row("odometer_speed_true", "True speed along the true forward axis at the epoch of the measurement", "m/s"),)),
    measure=_measure,
    uniforms=2,
    truth=("odometer_scale_factor_true", "odometer_slip_true", "odometer_mounting_error_true"),
    told=_told,
    errors=ERRORS,
    start=_start,
    start_uniforms=6,
)

FIGURES: dict[str, Figure] = {
    "noise_mps": Figure("odometer_noise", "m/s"),
    "scale_factor_percent": Figure("odometer_scale_factor", "%", units.percent_to_one),
    "scale_factor_sigma_percent": Figure("odometer_scale_factor_sigma", "%", units.percent_to_one),
    "slip_percent_s2_m": Figure("odometer_slip", "% per m/s^2", units.percent_to_one),
    "slip_sigma_percent_s2_m": Figure("odometer_slip_sigma", "% per m/s^2", units.percent_to_one),
    "mounting_error_deg": Figure("odometer_mounting_error", "deg", units.deg_to_rad, vector=True),
    "mounting_sigma_deg": Figure("odometer_mounting_error_sigma", "deg", units.deg_to_rad, vector=True),
    "quantum_mps": Figure("odometer_quantum", "m/s"),
}

_SLIP = "Gustafsson 1997, Automatica 33(6): slip slope of a tyre on asphalt, 30 to 40 per unit of slip: 0.3 % per m/s^2"
_TYRE = "insenv's choice: wear, pressure and load of a tyre; data sheets of vehicles allow 1 to 3 %"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade(
        "wheel",
        "Wheel speed from the encoders of the brakes",
        {
            "noise_mps": "insenv's choice: 0.05 m/s, as OB_GINS assumes of an odometer",
            "scale_factor_sigma_percent": _TYRE,
            "slip_percent_s2_m": _SLIP,
            "mounting_sigma_deg": "insenv's choice: angle between the axes of the unit and of the vehicle",
            "quantum_mps": "insenv's choice: 0.01 m/s, as wheel speeds on a vehicle's bus have",
        },
        {
            "noise_mps": 0.05,
            "scale_factor_sigma_percent": 1.0,
            "slip_percent_s2_m": 0.3,
            "mounting_sigma_deg": (0.0, 0.5, 0.5),
            "quantum_mps": 0.01,
        },
    ),
    Grade(
        "obd",
        "Speed on the diagnostic interface of a car, in whole km/h",
        {
            "noise_mps": "insenv's choice",
            "scale_factor_sigma_percent": _TYRE,
            "slip_percent_s2_m": _SLIP,
            "mounting_sigma_deg": "insenv's choice: angle between the axes of the unit and of the vehicle",
            "quantum_mps": "SAE J1979, parameter 0x0D: 1 km/h a count",
        },
        {
            "noise_mps": 0.05,
            "scale_factor_sigma_percent": 2.0,
            "slip_percent_s2_m": 0.3,
            "mounting_sigma_deg": (0.0, 0.5, 0.5),
            "quantum_mps": float(np.round(1.0 / 3.6, 12)),
        },
    ),
    Grade(
        "survey",
        "Wheel encoder of a survey vehicle, its scale factor calibrated",
        {"": "insenv's choice: 0.1 % after calibration, 0.02 m/s", "slip_percent_s2_m": _SLIP},
        {
            "noise_mps": 0.02,
            "scale_factor_sigma_percent": 0.1,
            "slip_percent_s2_m": 0.3,
            "mounting_sigma_deg": (0.0, 0.1, 0.1),
        },
    ),
)

if TYPE_CHECKING:
    OdometerFigures = FiguresSection
else:
    OdometerFigures = figures_section("OdometerFigures", PARAMETERS, GRADES, FIGURES, "wheel")


class OdometerSection(OdometerFigures, TimedSection):
    """The odometer."""

    sensor: ClassVar[Sensor] = EQUATIONS.sensor()

    interval_s: Number = key(0.1, "interval between measurements, a whole number of samples", "s", gt=0, le=3600)
    lever_arm_m: LeverArm = key((0.0, 0.0, 0.0), "from the inertial unit to the wheel: forward, right, down", "m")
    mounting_deg: Rotation = key((0.0, 0.0, 0.0), "nominal rotation from body to odometer axes, as a rotation vector", "deg")

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for times that do not fit the samples."""
        return {
            **self.timing(rate_hz),
            **self.error_rows(),
            "odometer_lever_arm_b": np.array(self.lever_arm_m),
            "odometer_mounting": units.deg_to_rad(np.array(self.mounting_deg)),
        }
