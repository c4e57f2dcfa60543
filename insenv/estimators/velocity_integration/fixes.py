"""GNSS: the velocity of the antenna over the Earth; lever arm and delay of the fixes are its constant errors."""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.estimators.parts import rows
from insenv.estimators.velocity_integration.source import (
    ALPHA,
    OF_SCALAR,
    OF_VECTOR,
    N,
    Seen,
    Source,
    at_point,
    earth_turn,
    pull_rate,
)
from insenv.sensors.instruments import GNSS_TOLD

LONGEST_GAP = 20.0
"""s: beta is then wrong by g a T^3 / (12 R) and by the Coriolis term of what a turn adds: for an aircraft by 0.05 m/s."""


def _seen(p: Any, x: Any, u: Any, kept: Any) -> Seen:
    q_i0e = earth_turn(x, u.gnss_age)
    place = {"latitude": u.gnss_latitude, "longitude": u.gnss_longitude, "height": u.gnss_height}
    C_en = geodesy.C_en(u.gnss_latitude, u.gnss_longitude)
    alpha, alpha_rate, by_arm, _ = at_point(x, p.antenna_lever_arm, u.gnss_age)
    error = ca.SX(3, N)
    # of the velocity that a delay misses, gravity's part is a constant and counts as little as that of alpha and beta
    error[:, ALPHA], error[:, OF_VECTOR], error[:, OF_SCALAR] = ca.SX.eye(3), by_arm, alpha_rate
    return Seen(
        alpha=alpha,
        error=error,
        velocity=attitude.rotate(q_i0e, C_en @ u.gnss_velocity_n),
        pull_rate=pull_rate(u.gnss_velocity_n, u.gnss_latitude, u.gnss_longitude, u.gnss_height, q_i0e),
        variance=(u.gnss_velocity_sigma[0] ** 2 + u.gnss_velocity_sigma[1] ** 2) / 2,
        place={**place, "velocity_n": u.gnss_velocity_n},
    )


FIXES = Source(
    arrives="gnss_velocity_valid",
    age="gnss_age",
    inputs=rows.FIX_INPUTS,
    parameters=rows.LEVER_ARM + GNSS_TOLD,
    sigma=lambda p: ca.vertcat(p.antenna_lever_arm_sigma, p.gnss_delay_sigma),
    seen=_seen,
    exact=lambda p, of_alpha, of_beta: of_alpha,
    longest_gap=LONGEST_GAP,
)
