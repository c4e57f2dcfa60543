"""Doppler velocity log of a ship: three components of its velocity over the ground, or through the water.

At an epoch, with the attitude C_nb, the velocity v_n and the angular rate omega_eb of the inertial unit:

    u_b = C_nb^T (v_n - c_n) + omega_eb x l
    y_b = (1 + k) C(e)^T u_b + noise w

l is the lever arm, k the scale factor error (the speed of sound), the same on all axes, e the rotation vector from the nominal
to the actual axes of the log.  Its output is in body axes by the nominal mounting.  c_n is the current, which enters only if
the log tracks the water: a constant and a first-order Gauss-Markov process north and east.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import casadi as ca
from pydantic import Strict

from insenv.attitude import from_rotation_vector, rotate_inverse
from insenv.base.toml import LeverArm
from insenv.core.model import Values
from insenv.core.tables import Row
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, Instrument, Setting, constant, drift, white

LEVER_ARM = Row("dvl_lever_arm_b", "From the inertial unit to the log", "m", (3,), "b", lower=-1e3, upper=1e3)
WATER_TRACK = Row(
    "dvl_water_track",
    "1 if velocity is that through the water, 0 if it is that over the ground",
    lower=0.0,
    upper=1.0,
    flag=True,
)
CHANGING_CURRENT = drift(
    "dvl_current", "changing_current", "DVL current", "Current of the water north and east", "m/s", (2,), "n",
    start_time=3600.0, states=(Estimated("current", "current of the water: north, east"),), flag=WATER_TRACK.name,
    normals=(4, 3),
)  # fmt: skip
TERMS = (
    white("dvl_noise", "DVL noise", "White noise of each axis", "m/s", (3,), "b"),
    constant(
        "dvl_scale_factor", "scale_factor", "DVL scale factor", "Scale factor error, the same on all axes: speed of sound",
        states=(Estimated("dvl_scale", "scale factor of the Doppler velocity log"),), normals=(3,),
    ),
    constant(
        "dvl_misalignment", "misalignment", "DVL misalignment", "Rotation vector from the nominal to the actual axes", "rad",
        (3,), "b", states=(Estimated("dvl_misalignment", "misalignment of the Doppler velocity log"),), normals=(0,),
    ),
    replace(
        constant("dvl_current_n", "current", "DVL current", "Current of the water", "m/s", (3,), "n", drawn=False,
                 flag=WATER_TRACK.name),
        stated=CHANGING_CURRENT.stated[:1],  # one sigma of both
    ),
    CHANGING_CURRENT,
)  # fmt: skip


def _current(e: Values) -> Any:
    """Current of the water (3, m/s, n)."""
    return e.current + ca.vertcat(e.changing_current, 0.0)


def _measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    velocity = motion.body_velocity(p.dvl_lever_arm_b, _current(e))
    seen = rotate_inverse(from_rotation_vector(e.misalignment), velocity)
    return {"dvl_velocity_b": seen + e.scale_factor * seen + e.noise}


FIGURES: dict[str, Figure] = {
    "noise_mps": Figure("dvl_noise", "m/s"),
    "scale_factor_percent": Figure("dvl_scale_factor", "%"),
    "scale_factor_sigma_percent": Figure("dvl_scale_factor_sigma", "%"),
    "misalignment_deg": Figure("dvl_misalignment", "deg", vector=True),
    "misalignment_sigma_deg": Figure("dvl_misalignment_sigma", "deg", vector=True),
    "current_mps": Figure("dvl_current_n", "m/s", vector=True),
    "current_sigma_mps": Figure("dvl_current_sigma", "m/s"),
    "current_time_s": Figure("dvl_current_time", "s"),
}

_MOUNTED = "insenv's choice: angle that is left after a calibration run"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade.of(
        "survey",
        "Doppler velocity log of a survey vessel",
        noise_mps=(0.01, "insenv's choice: 1 cm/s a ping"),
        scale_factor_sigma_percent=(0.2, "Teledyne data sheets of bottom-tracking logs: 0.2 % of the speed"),
        misalignment_sigma_deg=(0.1, _MOUNTED),
    ),
    Grade.of(
        "ship",
        "Doppler velocity log of a ship",
        noise_mps=(0.03, "Tang et al. 2013: 0.5 % of the speed +-0.5 cm/s; insenv's choice for a ping: 3 cm/s"),
        scale_factor_sigma_percent=(0.5, "Tang et al. 2013: 0.5 % of the speed"),
        misalignment_sigma_deg=(0.5, "insenv's choice: mounting in a dock"),
    ),
)

DVL = Instrument(
    "dvl",
    title="Doppler velocity log",
    called="the Doppler velocity log",
    what="velocity in body axes",
    causes="its scale factor, mounting, lever arm and latency, and whether it tracks the ground or the water (current)",
    values=(
        Row("dvl_velocity_b", "Velocity over the ground, or through the water", "m/s", (3,), "b", lower=-1e4, upper=1e4),
    ),
    terms=TERMS,
    measure=_measure,
    holds=("vertical", "horizontal"),
    parameters=(LEVER_ARM, WATER_TRACK),
    stated=(LEVER_ARM,),
    exact=lambda motion, e, p: {"dvl_velocity_true": motion.body_velocity(p.dvl_lever_arm_b)},
    exact_rows=(Row("dvl_velocity_true", "True velocity of the log over the ground at the epoch", "m/s", (3,), "b"),),
    totals=((Row("dvl_current_true", "Current of the water at the latest epoch", "m/s", (3,), "n"), lambda e, p: _current(e)),),
    aid_parameters=("dvl_lever_arm_b", "dvl_noise"),
    least_sigma={"dvl_velocity_b": 1e-3},
    turned=True,
    columns=(Column("velocity", "dvl_velocity_b", "velocity's x, y, z [m/s]", axes=True),),
    settings=(
        Setting("lever_arm_m", LeverArm, (0.0, 0.0, 0.0), "from the inertial unit to the log: forward, right, down", "m",
                "dvl_lever_arm_b", needed=True),
        Setting("water_track", Annotated[bool, Strict()], False, "whether the log shows the velocity through the water",
                row=WATER_TRACK.name),
    ),
    figures=FIGURES,
    grades=GRADES,
    grade="ship",
)  # fmt: skip
