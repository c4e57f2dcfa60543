"""`wander-sins`, `wander-sins-plain`: free-inertial navigation in the wander-azimuth frame, from a stated start.

Source: the airborne-navigation paper, equations (3)-(11). `wander-sins` has them in exact form
(`insenv.estimators.parts.strapdown`), `wander-sins-plain` as printed, for comparison: no coning, sculling or rotation
compensation, attitude and position of first order in the sample interval, and the paper's gravity formula. An inertial
row of the paper is a rate and a specific force at its time; here it is the sample's increments divided by its interval,
at the end of the sample. The paper's local axes are east, north, up; here n is north, east, down, and w is n at wander
angle 0.

Nothing bounds the vertical channel: errors of height grow by a factor of e every 9.5 minutes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, rows, strapdown

PLAIN_STATE = strapdown.NAVIGATION_STATE + Table((
    Row("velocity_change_w", "Velocity increment of the last sample, (7)", "m/s", (3,), "w"),
    Row("samples", "Number of samples so far", "1"),
))  # fmt: skip


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    return strapdown.move(x, u.delta_angle, u.delta_velocity, u.dt).rows


def plain_sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: (3), (4)-(7), (8) in this order, each with the newest values available."""
    axis_w = attitude.to_dcm(x.q_ew)[2, :].T  # the Earth's axis: its last component is -sin(latitude)
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


def _estimator(id: str, title: str, state: Table, step: Callable[[Any, Any, Any], dict[str, Any]]) -> Estimator:
    model = Model(
        id=id,
        title=title,
        parameters=rows.START,
        state=state,
        inputs=rows.SAMPLE_INPUTS,
        outputs=rows.NAVIGATION,
        steps={"sample": Step(step)},
        output=lambda p, x: strapdown.navigation_outputs(x),  # (8)-(11), by quaternions
        start=strapdown.start_state,
    )
    return Estimator(model, kind="navigation", applicability=applicability.unaided_height)


ESTIMATORS = (
    _estimator("wander-sins", "free-inertial navigation in the wander-azimuth frame", strapdown.STATE, sample),
    _estimator(
        "wander-sins-plain",
        "free-inertial navigation, the paper's first-order formulas, for comparison",
        PLAIN_STATE,
        plain_sample,
    ),
)
