"""`analytic`: the textbook coarse alignment of a vehicle at rest, from two mean vectors (TRIAD).

The mean specific force is minus gravity and the mean rate is the Earth's; down and east follow:

    down^b = -f^b / |f^b|,   east^b = down^b x omega^b / |down^b x omega^b|,   north^b = east^b x down^b
    C_nb = [north^b east^b down^b]^T

Source: Titterton and Weston (2004), section 10.3; TRIAD: Black, AIAA Journal 2 (1964), with gravity as the trusted
vector. Any attitude, both hemispheres, not at the poles. The attitude is assumed constant: sway, people and engines
enter the means directly, and the noise of heading falls only as the square root of time. The latitude is used by the
stated accuracy only.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import cos, maximum, minimum
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, rows

LARGEST_SIGMA = math.pi  # rad: heading unknown

PARAMETERS = rows.chosen(rows.PLACE, "latitude") + rows.NOISES

STATE = Table((
    Row("angle", "Sum of the delta angles", "rad", (3,), "b"),
    Row("velocity", "Sum of the delta velocities", "m/s", (3,), "b"),
    Row("time", "Time since the start", "s"),
))  # fmt: skip


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    return {"angle": x.angle + u.delta_angle, "velocity": x.velocity + u.delta_velocity, "time": x.time + u.dt}


def triad(force_b: Any, rate_b: Any) -> Any:
    """C_nb (3x3) from specific force and angular rate at rest (3 each, b, any unit)."""
    down = -_unit(force_b)
    east = _unit(ca.cross(down, rate_b))
    return ca.horzcat(ca.cross(east, down), east, down).T


def _unit(v: Any) -> Any:
    length = ca.sqrt(ca.sumsqr(v))
    return v / (length + (length == 0))


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude from the means so far."""
    time = maximum(x.time, 1e-6)
    tilt = ca.sqrt(p.accel_bias_sigma**2 + p.velocity_random_walk**2 / time) / geodesy.NOMINAL_GRAVITY
    rate = ca.sqrt(p.gyro_bias_sigma**2 + p.angle_random_walk**2 / time)
    heading = rate / (geodesy.OMEGA_IE * maximum(ca.fabs(cos(p.latitude)), 1e-9))
    return {
        "q_nb": attitude.from_dcm(triad(x.velocity, x.angle)),
        "attitude_sigma": ca.vertcat(tilt, tilt, minimum(heading, LARGEST_SIGMA)),
    }


MODEL = Model(
    id="analytic",
    title="textbook static coarse alignment from mean specific force and rate",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={"sample": Step(sample)},
    output=output,
)


ESTIMATOR = Estimator(MODEL, kind="alignment", applicability=applicability.notes)
