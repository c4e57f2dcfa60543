"""Fixes that are refused and agree with each other: the filter is wrong, and starts position and velocity anew.

An innovation z_r of position and z_v of velocity (predicted minus measured) is beyond the gate because the fix is wrong or
because the estimate is.  Wrong fixes are wrong one by one.  If the estimate is wrong, its error of position grows by its error
of velocity from one fix to the next, `since` seconds later:

    z_r(k) - z_r(k-1) = since (z_v(k) + z_v(k-1)) / 2,

up to the noise of the four measurements.  Fixes without velocities agree if their innovations are equal up to the stated
velocity: they have jumped.  After `AGREEING` refused fixes that do so the next one that does is taken: the variances of
position and velocity grow by the squares of its innovations, so that it passes, and that of the attitude by the error which,
against gravity, makes this velocity in the time since they are refused.  An accelerometer that vibration bends for some
seconds does that, as at the take-off of an aircraft.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.base.remarks import Doubt, declared
from insenv.core import symmetric
from insenv.core.elementary import maximum, select
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY
from insenv.estimators.parts.finding import Finding
from insenv.geodesy import NOMINAL_GRAVITY

AGREEING = 3
"""Refused fixes that agree, after which the filter starts anew."""
TOLERANCE = 3.0
"""Standard deviations within which two fixes agree."""


_RESTARTED = declared(
    "filter-restarted",
    "restarts of position and velocity, because refused fixes agreed with each other: {ratio}; the stated sigmas were too "
    "small before that",
    Doubt,
)


def restarts(aids: Iterable[Aid]) -> tuple[Finding, ...]:
    """What is said of a run in which the filter has started anew."""
    return tuple(Finding(aid.row("restart_count"), _RESTARTED, 1.0) for aid in aids if aid.restarts)


@dataclass(frozen=True)
class Restart:
    """Whether fixes agree now, whether the filter starts anew (0 or 1 each), and its covariance triangle then."""

    agrees: Any
    now: Any
    stored: Any


def restart(aid: Aid, x: Any, innovation: Any, variance: Any, present: Any, since: Any, n: int) -> Restart:
    """Arguments of one measurement of an aid: innovation, variance, present (6 each); since: the last one, s; n: errors."""
    last = getattr(x, aid.row("innovation"))
    grown, speeds, own = innovation[:3] - last[:3], (innovation[3:] + last[3:]) * (since / 2), ca.SX.zeros(3)
    agrees = ca.SX(1)
    for i in range(3):
        unmeasured = x.covariance[symmetric.place(VELOCITY.start + i, VELOCITY.start + i)] * since**2
        apart = grown[i] - select(present[3 + i], speeds[i], 0.0)
        allowed = TOLERANCE**2 * (2 * variance[i] + select(present[3 + i], variance[3 + i] * since**2 / 2, unmeasured))
        agrees = agrees * present[i] * select(apart**2 > allowed, 0.0, 1.0)
        own[i] = select(present[3 + i], innovation[3 + i], grown[i] / maximum(since, 1e-3))
    agreed = getattr(x, aid.row("agreed"))
    now = agrees * select(agreed < AGREEING, 0.0, 1.0)
    place, speed = ca.sumsqr(innovation[:3]), ca.sumsqr(own)
    turn = speed / (NOMINAL_GRAVITY * maximum(agreed * since, 1e-3)) ** 2
    added = ca.SX.zeros(n)
    for part, variance_added in ((POSITION, place), (VELOCITY, speed), (TILT, turn)):
        added[part] = now * variance_added
    stored = ca.SX(x.covariance)
    for i in range(n):
        if not added[i].is_zero():
            stored[symmetric.place(i, i)] = stored[symmetric.place(i, i)] + added[i]
    return Restart(agrees, now, stored)


def counted(aid: Aid, x: Any, done: Restart, outside: Any) -> dict[str, Any]:
    """The state rows after the measurement; outside: number of its components beyond the gate."""
    agreed, count = (getattr(x, aid.row(name)) for name in ("agreed", "restart_count"))
    # the first that is refused has none before it to agree with
    going_on = ca.logic_or(done.agrees, getattr(x, aid.row("refusals")) < 1)
    refused = ca.logic_and(outside > 0, ca.logic_not(done.now))
    return {
        aid.row("agreed"): select(refused, select(going_on, agreed + 1, 1.0), 0.0),
        aid.row("restart_count"): count + done.now,
    }
