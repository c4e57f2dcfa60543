"""Errors of the unit that are proportional to the motion, as process noise of a filter without states for them.

Scale factors and misalignments are constant, and what they do comes and goes with each turn: it accumulates in a manoeuvre
and reverses in the next. As noise they are white over manoeuvres of the sizes below.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

COHERENT_ANGLE = 1.0  # rad
COHERENT_SPEED = 10.0  # m/s


def variances(p: Any, rotation: Any, change: Any) -> tuple[Any, Any]:
    """Variances to add to each attitude (rad^2) and velocity (m^2/s^2) error over an interval.

    p: rows of `rows.MOTION_ERRORS`. rotation (3, rad), change (3, m/s): of attitude and velocity in the interval.
    """
    turned, pushed = ca.sqrt(ca.sumsqr(rotation)), ca.sqrt(ca.sumsqr(change))
    return p.rotation_error**2 * COHERENT_ANGLE * turned, p.thrust_error**2 * COHERENT_SPEED * pushed
