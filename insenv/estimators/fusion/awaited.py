"""A heading that a field is about to show: until it has, all other measurements wait.

A filter is linearised about its heading.  Where that is known to tens of degrees only, and a vector instrument such as a
magnetometer is there to show it, the first velocities of GNSS would be taken for a measurement of it: the filter would be sure
of a heading that is as wrong as before when the field comes, and would no longer look for it all round (`measurement.far`).
So they wait: the fixes before the first field are not used, the covariance grows, and nothing false is learnt.  A note says so.
They wait for `LONGEST` at most, and a doubt says where no field had come until then.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Any

import casadi as ca

from insenv.base.remarks import Doubt, declared
from insenv.core.elementary import select
from insenv.estimators.fusion.aid import AWAITED, AWAITED_TIME, Aid
from insenv.estimators.fusion.measurement import FAR, far
from insenv.estimators.parts.finding import Finding

LONGEST = 60.0
"""s"""
LONG = 1.0
"""s: from which a note says that they have waited."""


def step(aids: Sequence[Aid], x: Any, dt: Any) -> dict[str, Any]:
    """The rows `AWAITED` and `AWAITED_TIME` after a sample; aids: those of the filter, one of them iterated.  x: the state
    before it.
    """
    seen = sum(getattr(x, aid.row("count")) for aid in aids if aid.iterated)
    unknown = ca.logic_and(far(x) > 0, seen < 1)
    now = select(ca.logic_and(unknown, x.heading_awaited_time < LONGEST), 1.0, 0.0)
    return {AWAITED.name: now, AWAITED_TIME.name: x.heading_awaited_time + now * dt}


_WAITED = declared(
    "heading-awaited",
    f"the measurements of {{ratio}} s were not used, to wait for a field that shows the heading: it is known worse than "
    f"{degrees(FAR):.2g} deg at the start",
)
_NOT_COME = declared(
    "field-not-come",
    f"no field was measured in the first {LONGEST:g} s, and the heading is known worse than {degrees(FAR):.2g} deg at the "
    "start: this linearised filter takes the motion for more information about the heading than it is; state a heading, or "
    "leave out the magnetometer, and fusion finds the heading by the velocities",
    Doubt,
)


def findings() -> tuple[Finding, ...]:
    """That the aids have waited in vain, or else that they have waited: the first that holds is said."""
    return (
        Finding(AWAITED_TIME.name, _NOT_COME, 1.0, limit=LONGEST),
        Finding(AWAITED_TIME.name, _WAITED, 1.0, limit=LONG),
    )
