"""Errors and stated standard deviations by channel as symbols, for models that evaluate them at run time.

The formulas are those of `insenv.evaluation.errors`, which evaluates them in NumPy after a run.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import sin_cos, wrap_angle
from insenv.core.model import Values
from insenv.core.tables import Table
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY

DEGREES = 180.0 / pi
_GROUPS = (
    (ATTITUDE, "q_nb", "attitude_sigma"),
    (POSITION, "latitude", "position_sigma"),
    (VELOCITY, "velocity_n", "velocity_sigma"),
)


def channels_of(outputs: Table) -> tuple[str, ...]:
    """The channels of an estimator with these outputs."""
    return tuple(name for names, row, _ in _GROUPS if row in outputs for name in names)


def stated_of(outputs: Table) -> tuple[str, ...]:
    """Those of `channels_of` whose standard deviation the estimator states."""
    return tuple(name for names, row, sigma in _GROUPS if row in outputs and sigma in outputs for name in names)


def error_of(channels: Sequence[str], found: Values, truth: Values) -> Any:
    """Estimate minus truth by channel (deg, m, m/s); found, truth: outputs by row name."""
    parts = []
    if "roll_deg" in channels:
        angles = zip(attitude.to_euler(found.q_nb), attitude.to_euler(truth.q_nb), strict=True)
        parts += [DEGREES * wrap_angle(estimate - true) for estimate, true in angles]
    if "north_m" in channels:
        places = [(v.latitude, v.longitude, v.height) for v in (found, truth)]
        parts.append(geodesy.position_error(*places[0], *places[1]))
    if "vn_mps" in channels:
        parts.append(found.velocity_n - truth.velocity_n)
    return ca.vertcat(*parts)


def sigma_of(stated: Sequence[str], found: Values) -> Any:
    """The standard deviation that an estimator states, by channel (deg, m, m/s); found: its outputs by row name."""
    parts = []
    for names, _, row in _GROUPS:
        if names[0] not in stated:
            continue
        sigma = getattr(found, row)
        if names is ATTITUDE:
            s, c = sin_cos(attitude.to_euler(found.q_nb)[2])
            north, east = sigma[0] * sigma[0], sigma[1] * sigma[1]
            level = (north * c * c + east * s * s, north * s * s + east * c * c)
            sigma = DEGREES * ca.vertcat(*(ca.sqrt(square) for square in level), sigma[2])
        parts.append(sigma)
    return ca.vertcat(*parts)
