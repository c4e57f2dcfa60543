"""Doppler velocity log that tracks the ground: velocity in body axes; misalignment and scale factor are its constant errors.

Beta is then the integral of gravity alone, which the rotation of the Earth turns: that shows the heading, to gyros that are
good enough for it.  So does the way over the ground, 2 % as fast at 6 m/s.  It counts in the place as soon as the heading
is known; that neither it nor the Coriolis term counts in gravity before is a small share of an angle that is not known
well then.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core.elementary import maximum, select, sin_cos
from insenv.core.tables import Row, Table
from insenv.estimators.parts import rows
from insenv.estimators.parts.error_model import bias_sigma
from insenv.estimators.velocity_integration.source import (
    ALPHA,
    DRIFT,
    OF_SCALAR,
    OF_VECTOR,
    N,
    Seen,
    Source,
    at_point,
    earth_turn,
    pull_rate,
)
from insenv.sensors.dvl import DVL

LARGEST_HEADING = 0.12
"""rad: standard deviation of a heading that may be wrong by atan(b_east / (Omega cos L + b_north)), which a bias b of the gyros
enters linearly only where it is small.
"""
LEAST_NOISE = 1e-3
"""m/s: standard deviation of a log that is told to have no noise."""


def _seen(p: Any, x: Any, u: Any, kept: Any) -> Seen:
    since = x.time - u.dvl_age - x.epoch
    alpha, _, _, C_ib = at_point(x, p.dvl_lever_arm_b, u.dvl_age)
    velocity_i = C_ib @ u.dvl_velocity_b
    q_ni, known = kept(p, x)
    velocity_n, gone_n = (known * attitude.rotate(q_ni, vector) for vector in (velocity_i, x.way))
    place = geodesy.geodetic_from_ned_offset(x.velocity_n * since + gone_n, x.latitude, x.longitude, x.height)
    error = ca.SX(3, N)
    error[:, ALPHA], error[:, DRIFT] = ca.SX.eye(3), skew(velocity_i)
    error[:, OF_VECTOR], error[:, OF_SCALAR] = -C_ib @ skew(u.dvl_velocity_b), -velocity_i
    return Seen(
        alpha=alpha - velocity_i,
        error=error,
        velocity=ca.SX.zeros(3),
        pull_rate=pull_rate(velocity_n, *place, earth_turn(x, u.dvl_age)),
        variance=maximum(p.dvl_noise, LEAST_NOISE) ** 2,
        place={
            **dict(zip(("latitude", "longitude", "height"), place, strict=True)),
            "velocity_n": velocity_n,
            "way": (1 - known) * (x.way + velocity_i * since),
        },
    )


def finds_north(gyro_bias: Any, latitude: Any) -> Any:
    """Whether gyros with a bias (rad/s, 1 sigma) show the heading at a latitude (rad), numbers or symbols."""
    return gyro_bias < LARGEST_HEADING * geodesy.OMEGA_IE * sin_cos(latitude)[1]


def _finds_north(p: Any) -> Any:
    return finds_north(bias_sigma(p), p.start_latitude)


def _exact(p: Any, of_alpha: Any, of_beta: Any) -> Any:
    """That of beta; for gyros that turn alpha more than the Earth does that of alpha, which shows the level alone then."""
    return select(_finds_north(p), of_beta, of_alpha)


_STATED = ("dvl_lever_arm_b", "dvl_noise", "dvl_scale_factor_sigma", "dvl_misalignment_sigma")
LOG = Source(
    arrives="dvl_new",
    age="dvl_age",
    inputs=DVL.measurement,
    parameters=rows.chosen(DVL.stated_errors, *_STATED)
    + rows.chosen(rows.START, "start_latitude", "start_longitude", "start_height"),
    sigma=lambda p: ca.vertcat(ca.repmat(p.dvl_misalignment_sigma, 3, 1), p.dvl_scale_factor_sigma),
    seen=_seen,
    state=Table((Row("way", "Way over the ground before the heading was known", "m", (3,), "i"),)),
    exact=_exact,
    largest_heading=lambda p: select(_finds_north(p), LARGEST_HEADING, 0.0),
    start=lambda p: {"latitude": p.start_latitude, "longitude": p.start_longitude, "height": p.start_height},
)
