"""A heading that a field is about to show: until it has, what shows positions and velocities waits.

A filter is linearised about its heading.  Where that is known to tens of degrees only, and a vector instrument such as a
magnetometer is there to show it, the first velocities of GNSS would be taken for a measurement of it: the filter would be sure
of a heading that is as wrong as before when the field comes, and would no longer look for it all round (`measurement.far`).
So all others wait for the first field: the fixes before it are lost, the covariance grows, and nothing false is learnt.  They
wait for `LONGEST`, and a doubt says where no field had come until then.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Any

import casadi as ca

from insenv.base.remarks import Doubt, declared
from insenv.core.elementary import select
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.measurement import FAR, far
from insenv.estimators.parts.finding import Finding

LONGEST = 60.0
"""s"""
AWAITED = "heading_awaited"
"""Name of the row that is 1 while they wait."""
TIME = Row("heading_awaited_time", "Time for which measurements have waited for a field that shows the heading", "s")
STATE = Table((Row(AWAITED, "1 while measurements wait for a field that shows the heading"), TIME))


def step(aids: Sequence[Aid], x: Any, dt: Any) -> dict[str, Any]:
    """The rows `STATE` after a sample; aids: those of the filter, one of them iterated.  x: the state before it."""
    seen = sum(getattr(x, aid.row("count")) for aid in aids if aid.iterated)
    unknown = ca.logic_and(far(x) > 0, seen < 1)
    now = select(ca.logic_and(unknown, getattr(x, TIME.name) < LONGEST), 1.0, 0.0)
    return {AWAITED: now, TIME.name: getattr(x, TIME.name) + now * dt}


_NOT_COME = declared(
    "field-not-come",
    f"no field was measured in the first {LONGEST:g} s, and the heading is known worse than {degrees(FAR):.2g} deg at the "
    "start: this linearised filter takes the motion for more information about the heading than it is; state a heading, or "
    "leave out the magnetometer, and fusion finds the heading by the velocities",
    Doubt,
)


def findings() -> tuple[Finding, ...]:
    """That the aids have waited in vain."""
    return (Finding(TIME.name, _NOT_COME, 1.0, limit=LONGEST),)
