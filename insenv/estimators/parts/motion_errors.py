"""Errors of the unit that are proportional to the motion, as process noise of a filter without states for them.

Scale factors and misalignments are constant, and what they do comes and goes with each turn: it accumulates in a manoeuvre
and reverses in the next. As noise they are white over manoeuvres of the sizes below.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

COHERENT_ANGLE = 1.0  # rad
COHERENT_SPEED = 10.0  # m/s
ROUNDED = 0.9
"""Part of the unit's value down to which a value set by hand counts as the same."""


def understated(unit: Mapping[str, Any], given: Mapping[str, Any]) -> tuple[str, ...]:
    """Sentences about errors that are set smaller than the unit's: the filter then states too small sigmas in motion.

    unit, given: parameters (by row name) as the data sheet of the unit gives them, and as they are set.
    """
    return tuple(
        f"{name} = {1000 * float(given[name]):.2g} mrad is set, that of the unit is {1000 * float(unit[name]):.2g} mrad: in "
        "and after manoeuvres the stated sigmas are too small"
        for name in ("rotation_error", "thrust_error")
        if name in given and name in unit and float(given[name]) < ROUNDED * float(unit[name])
    )


def variances(p: Any, rotation: Any, change: Any) -> tuple[Any, Any]:
    """Variances to add to each attitude (rad^2) and velocity (m^2/s^2) error over an interval.

    p: rows of `rows.MOTION_ERRORS`. rotation (3, rad), change (3, m/s): of attitude and velocity in the interval.
    """
    turned, pushed = ca.sqrt(ca.sumsqr(rotation)), ca.sqrt(ca.sumsqr(change))
    return p.rotation_error**2 * COHERENT_ANGLE * turned, p.thrust_error**2 * COHERENT_SPEED * pushed
