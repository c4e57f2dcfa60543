"""Whether a vehicle stands, from what its inertial unit shows over a window and from the velocity estimated.

At rest the specific force is gravity, constant but for white noise and what an engine, the wind and people shake, and the
rate is that of the same shaking.  With these as normal noise of variance s_f^2 and s_w^2 an axis, the generalised likelihood
ratio of standing against any motion comes down to (Skog, Haendel, Nilsson, Rantakokko, "Zero-velocity detection - an
algorithm evaluation", IEEE Trans. Biomed. Eng. 57 (2010))

    L = mean |f - mean f|^2 / (3 s_f^2) + mean |w|^2 / (3 s_w^2) < THRESHOLD

An inertial unit alone cannot tell standing from a smooth straight ride.  So it must also hold that the velocity carried has not
changed over the window by more than `GATE` standard deviations of what tilt and bias errors make of it, and that zero lies
within `GATE` of the filter's own standard deviations of its velocity.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.estimators.parts.error_model import ACCEL, TILT, VELOCITY
from insenv.geodesy import NOMINAL_GRAVITY

THRESHOLD = 1.5
GATE = 3.0


def watched(p: Any, x: Any, delta_angle: Any, delta_velocity: Any, change_w: Any, dt: Any) -> dict[str, Any]:
    """Rows of the window after one more sample; it begins anew after the one that filled it."""
    goes_on = 1 - x.still_due
    time = goes_on * x.still_time + dt
    return {
        "still_samples": goes_on * x.still_samples + 1,
        "still_time": time,
        "still_angle_square": goes_on * x.still_angle_square + ca.sumsqr(delta_angle),
        "still_velocity": goes_on * x.still_velocity + delta_velocity,
        "still_velocity_square": goes_on * x.still_velocity_square + ca.sumsqr(delta_velocity),
        "still_change_w": goes_on * x.still_change_w + change_w,
        "still_due": ca.logic_and(p.standing_window > 0, time + dt / 2 > p.standing_window),
    }


def likelihood(p: Any, x: Any) -> Any:
    """L of the full window."""
    n, dt = x.still_samples, x.still_time / x.still_samples
    scatter = x.still_velocity_square - ca.sumsqr(x.still_velocity) / n
    force = scatter / (n * dt * dt) / (3 * (p.velocity_random_walk**2 / dt + p.standing_force**2))
    rate = x.still_angle_square / (n * dt * dt) / (3 * (p.angle_random_walk**2 / dt + p.standing_rate**2))
    return force + rate


def found(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The full window judged: `standing_now` stays 1 where it was said."""
    steady = ca.sumsqr(x.still_change_w) < GATE**2 * (p.standing_sigma**2 + x.still_time**2 * _force_variance(x))
    quiet = ca.logic_and(likelihood(p, x) < THRESHOLD, steady)
    for i in range(VELOCITY.start, VELOCITY.stop):
        variance = x.covariance[symmetric.place(i, i)] + p.standing_sigma**2
        quiet = ca.logic_and(quiet, x.velocity_w[i - VELOCITY.start] ** 2 < GATE**2 * variance)
    return {"standing_now": select(quiet, 1.0, x.standing_now)}


def _force_variance(x: Any) -> Any:
    """Variance (m^2/s^4) of the acceleration that the estimate sees at rest: of its tilts and accelerometer biases."""
    tilt = sum(x.covariance[symmetric.place(i, i)] for i in range(TILT.start, TILT.start + 2))
    return NOMINAL_GRAVITY**2 * tilt + sum(x.covariance[symmetric.place(i, i)] for i in range(ACCEL.start, ACCEL.stop))
