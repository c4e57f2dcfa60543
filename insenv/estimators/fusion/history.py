"""The motion of the last fraction of a second, to compare a late measurement with.

A receiver that reports its fixes half a second late, and a vehicle that brakes meanwhile: no polynomial from the last sample
gives the motion at the time of the fix.  `SLOTS` points of the estimated motion are kept, `SPACING` apart: way, velocity,
attitude and rate.  Between two of them the way is a cubic with their velocities, the rest is linear.

The way is the integral of the velocity in w, which turns against the Earth by less than 4e-5 rad/s: nothing over a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.geodesy import NOMINAL_GRAVITY

SLOTS = 14
SPACING = 0.08
"""s"""
OLDEST = SPACING * (SLOTS - 1)
"""s: the largest age at which a measurement is compared with the motion of its own time."""
_KINDS = (("way", 3), ("velocity", 3), ("attitude", 4), ("rate", 3))
"""What a slot holds: m, m/s (w), quaternion from b to w, rad/s (b)."""

STATE = Table((
    Row("way_w", "Integral of the velocity, from any origin", "m", (3,), "w"),
    Row("past_time", "Time since the motion was kept last", "s"),
    Row("past_due", "1 when it is to be kept"),
    Row("past_count", "Number of times that it was kept", "1"),
    Row("past_age", "Age of each kept motion at the time of the newest", "s", (SLOTS,)),
    Row("past_way", "Way at those times", "m", (SLOTS, 3), "w"),
    Row("past_velocity", "Velocity at those times", "m/s", (SLOTS, 3), "w"),
    Row("past_attitude", "Attitude at those times", "1", (SLOTS, 4), "w"),
    Row("past_rate", "Measured angular rate at those times", "rad/s", (SLOTS, 3), "b"),
))  # fmt: skip


def followed(x: Any, velocity_w: Any, moved_velocity_w: Any, dt: Any) -> dict[str, Any]:
    """Rows after a sample that took the velocity from `velocity_w` to `moved_velocity_w` (3, m/s, w)."""
    time = x.past_time + dt
    return {
        "way_w": x.way_w + (velocity_w + moved_velocity_w) * (dt / 2),
        "past_time": time,
        "past_due": select(ca.logic_or(time + dt / 2 > SPACING, x.samples == 0), 1.0, 0.0),
    }


def _keep(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Keep the motion at the end of this sample; the oldest is dropped."""
    now = {"way": x.way_w, "velocity": x.velocity_w, "attitude": x.q_wb, "rate": u.delta_angle / u.dt}
    past = {f"past_{kind}": ca.vertcat(now[kind].T, getattr(x, f"past_{kind}")[:-1, :]) for kind, _ in _KINDS}
    ages = ca.vertcat(0, x.past_age[:-1] + x.past_time)
    return {**past, "past_age": ages, "past_time": 0, "past_count": x.past_count + 1}


STEP = Step(_keep, when="past_due")


@dataclass(frozen=True)
class Past:
    """The estimated motion some time ago.

    way_w: since then (3, m, w).  velocity_w (3, m/s, w).  C_wb (3x3).  rate_b: as measured (3, rad/s, b).
    """

    way_w: Any
    velocity_w: Any
    C_wb: Any
    rate_b: Any


def past(x: Any, u: Any, age: Any) -> Past:
    """The motion `age` seconds before the end of the present sample; older than what is kept: that of the oldest, at its
    velocity; younger than the sample: at the present velocity.

    x: state rows `STATE`, and those of the navigation, after the sample.
    """
    now = ca.vertcat(x.way_w, x.velocity_w, x.q_wb, u.delta_angle / u.dt)
    columns = [getattr(x, f"past_{kind}") for kind, _ in _KINDS]
    younger, young_age = now, ca.SX(0)
    older = ca.horzcat(*[c[0, :] for c in columns]).T
    old_age = x.past_time + x.past_age[0]
    for k in range(1, SLOTS):
        beyond = ca.logic_and(age > old_age, k < x.past_count)
        following = ca.horzcat(*[c[k, :] for c in columns]).T
        younger, young_age = select(beyond, older, younger), select(beyond, old_age, young_age)
        older, old_age = select(beyond, following, older), select(beyond, x.past_time + x.past_age[k], old_age)
    span = old_age - young_age
    safe = select(span > 0, span, 1.0)
    # s from 0 at the older to 1 at the younger
    s = select(span > 0, (old_age - age) / safe, 1.0)
    s = select(s < 0, 0.0, select(s > 1, 1.0, s))
    v0, v1 = older[3:6], younger[3:6]
    w0, w1 = older[0:3], younger[0:3]
    chord = w1 - w0
    way = w0 + chord * (3 * s**2 - 2 * s**3) + safe * (v0 * (s - 2 * s**2 + s**3) + v1 * (s**3 - s**2))
    velocity = chord / safe * (6 * s - 6 * s**2) + v0 * (1 - 4 * s + 3 * s**2) + v1 * (3 * s**2 - 2 * s)
    velocity = select(span > 0, velocity, v1)
    # a measured rate is the mean of its sample: that of half a sample before its end
    r = select(span > 0, (old_age - age + u.dt / 2) / safe, 1.0)
    r = select(r < 0, 0.0, r)
    q = attitude.normalize(older[6:10] + (younger[6:10] - older[6:10]) * s)
    beyond_the_ends = x.velocity_w * minimum(age, 0.0) + older[3:6] * maximum(age - old_age, 0.0)
    return Past(
        x.way_w - way + beyond_the_ends, velocity, attitude.to_dcm(q), older[10:13] + (younger[10:13] - older[10:13]) * r
    )


def corrected(x: Any, dv: Any, psi: Any) -> dict[str, Any]:
    """Rows after the velocity error `dv` (3, m/s, w) and the misalignment `psi` (3, rad, w) were taken out of the state.

    x: the state before.  What was kept has the same errors, and the velocity gained since then was gained in a wrong direction;
    the way since then has the errors of the velocity for as long.
    """
    ages = x.past_age + x.past_time
    gained = ca.repmat(x.velocity_w.T, SLOTS, 1) - x.past_velocity
    gained[:, 2] -= NOMINAL_GRAVITY * ages
    turn = attitude.from_rotation_vector(psi)
    lost = gained @ (attitude.to_dcm(turn) - ca.SX.eye(3)).T
    q = ca.vertcat(*[attitude.multiply(turn, x.past_attitude[k, :].T).T for k in range(SLOTS)])
    return {
        "past_way": x.past_way + ages @ dv.T + lost * ca.repmat(ages / 2, 1, 3),
        "past_velocity": x.past_velocity - ca.repmat(dv.T, SLOTS, 1) - lost,
        "past_attitude": q,
    }
