"""`wander-sins-plain`: the airborne-navigation paper's free-inertial navigation as printed, formulas (3) to (9).

For comparison with `wander-sins`: no coning, sculling or rotation compensation, attitude and position of first order in the
sample interval, and the paper's gravity formula.  An inertial row of the paper is a rate and a specific force at its time;
here it is the sample's increments divided by its interval, taken to stand at the sample's end.

The paper's local axes are east, north, up; these are n's and w's of insenv, north, east, down at wander angle 0.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.increments import SAMPLE_INPUTS

STATE = Table(
    (
        Row("q_wb", "Attitude: takes b components to w components", "1", (4,), "w", start=(1, 0, 0, 0)),
        Row("velocity_w", "Velocity over the Earth", "m/s", (3,), "w"),
        Row("q_ew", "Position and wander angle: takes w components to e components", "1", (4,), "e", start=(1, 0, 0, 0)),
        Row("height", "Height over the ellipsoid", "m"),
        Row("velocity_change_w", "Velocity increment of the last sample, (7)", "m/s", (3,), "w"),
        Row("samples", "Number of samples taken", "1"),
    )
)


def start(p: Any) -> dict[str, Any]:
    """The start as given."""
    return strapdown.start_state(p)


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: (3), (4)-(7), (8) in this order, each with the newest values that it can have."""
    axis_w = attitude.to_dcm(x.q_ew)[2, :].T  # the Earth's axis: third row of C_ew, whose last element is -sin(latitude)
    omega_ie = geodesy.OMEGA_IE * axis_w
    omega_ew = geodesy.transport_rate_about_axis(x.velocity_w, axis_w, x.height)

    # (3): dC_wb/dt = C_wb [omega_wb^b x], omega_wb^b = omega_ib^b - C_bw (omega_ie^w + omega_ew^w)
    turn = u.delta_angle - attitude.rotate_inverse(x.q_wb, omega_ie + omega_ew) * u.dt
    q_wb = attitude.normalize(attitude.multiply(x.q_wb, ca.vertcat(1, turn / 2)))

    # (4)-(7): f^w = C_wb f^b, increment, mean of the last two increments
    gravity_w = ca.vertcat(0, 0, geodesy.normal_gravity_paper(-axis_w[2], x.height))
    coriolis = ca.cross(2 * omega_ie + omega_ew, x.velocity_w)
    change = attitude.rotate(q_wb, u.delta_velocity) + (gravity_w - coriolis) * u.dt
    before = ca.vertcat(*[select(x.samples == 0, change[i], x.velocity_change_w[i]) for i in range(3)])
    velocity = x.velocity_w + (before + change) / 2

    # (8): dC_ew/dt = C_ew [omega_ew^w x], height by the trapezoidal rule
    mean = (x.velocity_w + velocity) / 2
    omega_ew = geodesy.transport_rate_about_axis(mean, axis_w, x.height)
    return {
        "q_wb": q_wb,
        "velocity_w": velocity,
        "q_ew": attitude.normalize(attitude.multiply(x.q_ew, ca.vertcat(1, omega_ew * u.dt / 2))),
        "height": x.height - mean[2] * u.dt,
        "velocity_change_w": change,
        "samples": x.samples + 1,
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Navigation in n: (8)-(11), by quaternions, so that no attitude and no place is singular."""
    return strapdown.navigation_outputs(x)


MODEL = Model(
    id="wander-sins-plain",
    title="free-inertial navigation, the paper's first-order formulas, for comparison",
    parameters=strapdown.START,
    state=STATE,
    inputs=SAMPLE_INPUTS,
    outputs=strapdown.OUTPUTS,
    steps={"sample": Step(sample)},
    output=output,
    start=start,
)

ESTIMATOR = Estimator(MODEL, kind="navigation")
