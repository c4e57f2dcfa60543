"""What measures the velocity: its rows, its errors, and one measurement as the sums take it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core.tables import Table
from insenv.estimators.parts import frozen_frame, lever_arm, rows
from insenv.sensors.gnss import GNSS_STATED

DRIFT, ALPHA, MEAN, SUM, KEPT, GYRO, ACCEL, OF_VECTOR = (slice(i, i + 3) for i in range(0, 24, 3))
OF_SCALAR, N = 24, 25
"""Errors: drift of C_b^i (rad), of alpha and of its mean (m/s), y, phi of the answer kept (rad), biases (rad/s, m/s^2), and a
vector and a scalar of constant errors of the instrument.
"""
LARGEST_LINEAR = 0.35  # rad: a larger standard deviation is that of no linear problem
EARTH_AXIS = (0.0, 0.0, 1.0)  # in e


@dataclass(frozen=True)
class Seen:
    """One measurement.

    alpha (3, m/s, i): without what the module's docstring leaves to beta; error (3xN): its derivative by the errors.
    velocity (3, m/s, i0): the velocity in beta; pull_rate (3, m/s^2, i0): the rate of beta's integral.
    variance: of each component of the noise, m^2/s^2.  place: rows `latitude`, `longitude`, `height`, `velocity_n`, own ones.
    """

    alpha: Any
    error: Any
    velocity: Any
    pull_rate: Any
    variance: Any
    place: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Source:
    """An instrument that measures velocity.

    arrives: the input row that is 1 with a measurement; age: that of its age (s).  inputs, parameters, state: its rows.
    sigma: ``p -> (4)``, standard deviations of its constant errors, vector and scalar.  start: ``p -> state rows``.
    seen: ``(p, x, u, kept) -> Seen``; kept: ``(p, x) -> (4), 1 or 0``, takes i components to n components by the answer kept,
        and whether its heading is known.
    largest_heading: ``p -> rad``; a larger standard deviation of the heading is stated as unknown.
    longest_gap: longest time (s) between two measurements that the integral of beta, a trapezoid, spans; None: any.
    exact: ``(p, that of alpha and i, that of beta and i0) -> the one that has no noise of measurements``.
    """

    arrives: str
    age: str
    inputs: Table
    parameters: Table
    sigma: Callable[[Any], Any]
    seen: Callable[[Any, Any, Any, Callable[[Any, Any], tuple[Any, Any]]], Seen]
    exact: Callable[[Any, Any, Any], Any]
    largest_heading: Callable[[Any], Any] = field(default=lambda p: LARGEST_LINEAR)
    state: Table = field(default_factory=Table)
    longest_gap: float | None = None
    start: Callable[[Any], dict[str, Any]] = field(default=lambda p: {})


def at_point(x: Any, arm: Any, age: Any) -> tuple[Any, Any, Any, Any]:
    """alpha (3, m/s, i) of the point at `arm` (3, m, b) `age` seconds ago, its rate (3, m/s^2), and what else is of that time.

    That is its derivative by the lever arm (3x3, 1/s), and C_b^i (3x3).
    """
    rate = x.previous_delta_angle / x.dt  # that of the middle of the sample
    change = lever_arm.angular_acceleration(x, rate, x.dt)
    now = rate + change * (x.dt / 2)
    bend = skew(change) + skew(now) @ skew(now)
    C_ib = attitude.to_dcm(x.q_ib)
    by_arm = C_ib @ (skew(now) - age * bend)  # as `lever_arm.then`
    back = attitude.to_dcm(attitude.from_small_rotation_vector((change * (age / 2) - now) * age))
    return x.alpha - x.force * age + by_arm @ arm, x.force + C_ib @ bend @ arm, by_arm, C_ib @ back


def pull_rate(velocity_n: Any, latitude: Any, longitude: Any, height: Any, q_i0e: Any) -> Any:
    """Rate of beta's integral (3, m/s^2, i0), omega_ie x v - g, at a velocity over the Earth and a place."""
    C_en = geodesy.C_en(latitude, longitude)
    gravity = C_en @ geodesy.normal_gravity_about_axis(C_en[2, :].T, height)
    coriolis = ca.cross(geodesy.OMEGA_IE * ca.SX(EARTH_AXIS), C_en @ velocity_n)
    return attitude.rotate(q_i0e, coriolis - gravity)


def earth_turn(x: Any, age: Any) -> Any:
    """Takes e components `age` seconds ago to i0 components (4)."""
    return frozen_frame.q_n0n(frozen_frame.turned(x.half_turn, -age), ca.SX(EARTH_AXIS))


# GNSS: the velocity of the antenna over the Earth; lever arm and delay of the fixes are its constant errors.

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
    parameters=rows.LEVER_ARM + GNSS_STATED,
    sigma=lambda p: ca.vertcat(p.antenna_lever_arm_sigma, p.gnss_delay_sigma),
    seen=_seen,
    exact=lambda p, of_alpha, of_beta: of_alpha,
    longest_gap=LONGEST_GAP,
)
