"""Odometer: the speed of a wheel, or of a radar, along its forward axis.

At an epoch, with the attitude C_nb, the velocity v_n and the angular rate omega_eb of the inertial unit:

    u_b = C_nb^T v_n + omega_eb x l
    y   = (1 + k + s f_x) e_x . u_b + noise w,   rounded to the quantum

l is the lever arm and e_x the forward axis: the first of the axes that the mounting, and after it the mounting error, turn
from b. k is the scale factor error (the circumference of the wheel).  s f_x is the slip of a driven or braked wheel, which is
proportional to the force that it transmits: f_x is the forward specific force over the sample.
"""

from __future__ import annotations

from math import radians
from typing import Any

import casadi as ca
import numpy as np

from insenv.attitude import from_rotation_vector, multiply, rotate
from insenv.base.toml import LeverArm, Rotation
from insenv.core.model import Values
from insenv.core.tables import Row
from insenv.sensors import units
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, Instrument, Setting, constant, white

ASSUMED_MOUNTING = radians(3.0)
"""rad: standard deviation of the mounting where none is stated."""
LEVER_ARM = Row("odometer_lever_arm_b", "From the inertial unit to the wheel's or sensor's point", "m", (3,), "b",
                lower=-1e3, upper=1e3)  # fmt: skip
MOUNTING = Row("odometer_mounting", "Rotation vector from b to the odometer's axes v, v_v = C(rotation)^T v_b", "rad", (3,),
               "b", lower=-7.0, upper=7.0)  # fmt: skip
QUANTUM = Row("odometer_quantum", "Step in which the speed is shown, 0 for none", "m/s", lower=0.0)
TERMS = (
    white("odometer_noise", "odometer noise", "White noise of a speed", "m/s"),
    constant(
        "odometer_scale_factor", "scale_factor", "odometer scale factor", "Scale factor error: circumference of the wheel",
        states=(Estimated("odometer_scale", "scale factor of the odometer"),), normals=(3,),
    ),
    constant(
        "odometer_slip", "slip", "odometer slip", "Slip: relative speed error per forward specific force", "s^2/m",
        limits={"lower": -1.0, "upper": 1.0},
        states=(Estimated("odometer_slip", "slip of the wheel per forward specific force"),), normals=(4,),
    ),
    constant(
        "odometer_mounting_error", "mounting", "odometer mounting", "Rotation vector from the nominal to the actual axes",
        "rad", (3,), "v", stated="odometer_mounting_sigma",
        states=(Estimated("odometer_mounting_error", "mounting error of the odometer: pitch, yaw", (1, 2),
                          assumed=ASSUMED_MOUNTING),),
        normals=(0,),
    ),
)  # fmt: skip


def axis(number: int, p: Values, mounting_error: Any) -> Any:
    """Forward (0), right (1) or down (2) axis of the odometer (3, b), turned by the mounting and then by its error."""
    unit = ca.SX.zeros(3)
    unit[number] = 1.0
    return rotate(multiply(from_rotation_vector(p.odometer_mounting), from_rotation_vector(mounting_error)), ca.densify(unit))


def _speed(motion: Any, e: Values, p: Values) -> Any:
    return ca.dot(axis(0, p, e.mounting), motion.body_velocity(p.odometer_lever_arm_b))


def _measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    share = 1.0 + e.scale_factor + e.slip * motion.specific_force_b[0]
    return {"odometer_speed": share * _speed(motion, e, p) + e.noise}


FIGURES: dict[str, Figure] = {
    "noise_mps": Figure("odometer_noise", "m/s"),
    "scale_factor_percent": Figure("odometer_scale_factor", "%"),
    "scale_factor_sigma_percent": Figure("odometer_scale_factor_sigma", "%"),
    "slip_percent_s2_m": Figure("odometer_slip", "% per m/s^2"),
    "slip_sigma_percent_s2_m": Figure("odometer_slip_sigma", "% per m/s^2"),
    "mounting_error_deg": Figure("odometer_mounting_error", "deg", vector=True),
    "mounting_sigma_deg": Figure("odometer_mounting_error_sigma", "deg", vector=True),
    "quantum_mps": Figure("odometer_quantum", "m/s"),
}

_SLIP = "Gustafsson 1997, Automatica 33(6): slip slope of a tyre on asphalt, 30 to 40 per unit of slip: 0.3 % per m/s^2"
_TYRE = "insenv's choice: wear, pressure and load of a tyre; data sheets of vehicles allow 1 to 3 %"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade.of(
        "wheel",
        "Wheel speed from the encoders of the brakes",
        noise_mps=(0.05, "insenv's choice: 0.05 m/s, as OB_GINS assumes of an odometer"),
        scale_factor_sigma_percent=(1.0, _TYRE),
        slip_percent_s2_m=(0.3, _SLIP),
        mounting_sigma_deg=((0.0, 0.5, 0.5), "insenv's choice: angle between the axes of the unit and of the vehicle"),
        quantum_mps=(0.01, "insenv's choice: 0.01 m/s, as wheel speeds on a vehicle's bus have"),
    ),
    Grade.of(
        "obd",
        "Speed on the diagnostic interface of a car, in whole km/h",
        noise_mps=(0.05, "insenv's choice"),
        scale_factor_sigma_percent=(2.0, _TYRE),
        slip_percent_s2_m=(0.3, _SLIP),
        mounting_sigma_deg=((0.0, 0.5, 0.5), "insenv's choice: angle between the axes of the unit and of the vehicle"),
        quantum_mps=(float(np.round(1.0 / 3.6, 12)), "SAE J1979, parameter 0x0D: 1 km/h a count"),
    ),
    Grade.of(
        "survey",
        "Wheel encoder of a survey vehicle, its scale factor calibrated",
        "insenv's choice: 0.1 % after calibration, 0.02 m/s",
        noise_mps=0.02,
        scale_factor_sigma_percent=0.1,
        slip_percent_s2_m=(0.3, _SLIP),
        mounting_sigma_deg=(0.0, 0.1, 0.1),
    ),
)

ODOMETER = Instrument(
    "odometer",
    title="Odometer",
    called="the odometer",
    what="forward speed",
    causes="its scale factor, lever arm, mounting and latency, wheels that slip or block, and its stated noise",
    values=(Row("odometer_speed", "Speed along the forward axis of the odometer", "m/s", lower=-1e4, upper=1e4),),
    terms=TERMS,
    measure=_measure,
    holds=("horizontal",),
    parameters=(LEVER_ARM, MOUNTING),
    stated=(LEVER_ARM, MOUNTING, QUANTUM),
    exact=lambda motion, e, p: {"odometer_speed_true": _speed(motion, e, p)},
    exact_rows=(
        Row("odometer_speed_true", "True speed along the true forward axis at the epoch of the measurement", "m/s"),
    ),
    quantum=QUANTUM,
    aid_parameters=("odometer_lever_arm_b", "odometer_mounting", "odometer_noise"),
    least_sigma={"odometer_speed": 1e-3},
    turned=True,
    columns=(Column("speed", "odometer_speed", "speed, forward positive", units.SPEED_UNITS, "m/s"),),
    settings=(
        Setting("lever_arm_m", LeverArm, (0.0, 0.0, 0.0), "from the inertial unit to the wheel: forward, right, down", "m",
                "odometer_lever_arm_b", needed=True),
        Setting("mounting_deg", Rotation, (0.0, 0.0, 0.0), "nominal rotation from body to odometer axes, as a rotation vector",
                "deg", "odometer_mounting"),
    ),
    figures=FIGURES,
    grades=GRADES,
    grade="wheel",
    interval_s=0.1,
)  # fmt: skip
