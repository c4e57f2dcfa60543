"""Zero velocity: the vehicle is known, or detected by its inertial unit and the estimated velocity, to be at rest.

At rest the specific force is gravity, constant except for white noise and the vibration that an engine, wind and people
cause, and the rate is that of the same vibration. With these as normal noise of variance s_f^2 and s_w^2 per axis, the
generalised likelihood ratio of rest against any motion reduces to (Skog, Haendel, Nilsson, Rantakokko, "Zero-velocity
detection - an algorithm evaluation", IEEE Trans. Biomed. Eng. 57 (2010))

    L = mean |f - mean f|^2 / (3 s_f^2) + mean |w|^2 / (3 s_w^2) < THRESHOLD

An inertial unit alone cannot distinguish rest from a smooth straight ride. So two more conditions must hold: over the
window the estimated velocity has changed by at most `GATE` standard deviations of what tilt and bias errors cause, and
zero lies within `GATE` of the filter's own standard deviations of its velocity, which must be below `UNCERTAIN`: a filter
that does not know its speed takes a smooth ride for rest.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, waited
from insenv.estimators.parts import rows
from insenv.estimators.parts.error_model import ACCEL, TILT, VELOCITY
from insenv.geodesy import NOMINAL_GRAVITY

THRESHOLD = 1.5
GATE = 3.0
UNCERTAIN = 0.7  # m/s: with GATE, a ride at more than 2.1 m/s is never taken for rest because of it

PARAMETERS = rows.STANDING_SIGMA + Table((
    Row("standing_window", "Window over which rest is detected; 0: no detection", "s", start=1.0, lower=0, upper=60.0),
    Row("standing_rate", "Angular rate that engine, wind and people cause at rest", "rad/s", start=5e-3, lower=0, upper=10.0),
    Row("standing_force", "Specific force that they cause", "m/s^2", start=0.05, lower=0, upper=100.0),
    Row("standing_angle_random_walk", "White noise of the gyros at rest, where it is less than angle_random_walk; 0: as that",
        "rad/s^0.5", lower=0, upper=1.0),
    Row("standing_velocity_random_walk", "White noise of the accelerometers at rest, likewise; 0: velocity_random_walk",
        "m/s^1.5", lower=0, upper=100.0),
))  # fmt: skip

STATE = Table((
    Row("still_samples", "Samples in the window of the detection of rest"),
    Row("still_time", "Length of that window so far", "s"),
    Row("still_angle_square", "Sum of its squared delta angles", "rad^2"),
    Row("still_velocity", "Sum of its delta velocities", "m/s", (3,), "b"),
    Row("still_velocity_square", "Sum of their squares", "m^2/s^2"),
    Row("still_change_w", "Change of velocity over it", "m/s", (3,), "w"),
    Row("still_due", "1 when the window is full"),
    Row("standing_now", "1 when the vehicle is known or detected to be at rest"),
))  # fmt: skip


def on_sample(p: Any, x: Any, u: Any, delta_angle: Any, delta_velocity: Any, change_w: Any) -> dict[str, Any]:
    """Rows of the window after one more sample; a new window starts after the sample that filled it."""
    goes_on = 1 - x.still_due
    time = goes_on * x.still_time + u.dt
    return {
        "still_samples": goes_on * x.still_samples + 1,
        "still_time": time,
        "still_angle_square": goes_on * x.still_angle_square + ca.sumsqr(delta_angle),
        "still_velocity": goes_on * x.still_velocity + delta_velocity,
        "still_velocity_square": goes_on * x.still_velocity_square + ca.sumsqr(delta_velocity),
        "still_change_w": goes_on * x.still_change_w + change_w,
        "still_due": ca.logic_and(p.standing_window > 0, time + u.dt / 2 > p.standing_window),
    }


def likelihood(p: Any, x: Any) -> Any:
    """The likelihood ratio L of the full window."""
    n, dt = x.still_samples, x.still_time / x.still_samples
    scatter = x.still_velocity_square - ca.sumsqr(x.still_velocity) / n
    force = scatter / (n * dt * dt) / (3 * (_at_rest(p, "velocity_random_walk") ** 2 / dt + p.standing_force**2))
    rate = x.still_angle_square / (n * dt * dt) / (3 * (_at_rest(p, "angle_random_walk") ** 2 / dt + p.standing_rate**2))
    return force + rate


def _at_rest(p: Any, row: str) -> Any:
    """A density of white noise of a unit that nothing shakes."""
    at_rest = getattr(p, f"standing_{row}")
    return select(at_rest > 0, at_rest, getattr(p, row))


def detected(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """`standing_now` after a full window; it stays 1 where the vehicle is known to be at rest."""
    steady = ca.sumsqr(x.still_change_w) < GATE**2 * (p.standing_sigma**2 + x.still_time**2 * _force_variance(x))
    quiet = ca.logic_and(likelihood(p, x) < THRESHOLD, steady)
    for i in range(VELOCITY.start, VELOCITY.stop):
        variance = x.covariance[symmetric.place(i, i)] + p.standing_sigma**2
        quiet = ca.logic_and(quiet, x.velocity_w[i - VELOCITY.start] ** 2 < GATE**2 * variance)
        quiet = ca.logic_and(quiet, variance < UNCERTAIN**2)
    return {"standing_now": select(quiet, 1.0, x.standing_now)}


def _force_variance(x: Any) -> Any:
    """Variance (m^2/s^4) of the apparent acceleration at rest, from the errors of tilt and accelerometer bias."""
    tilt = sum(x.covariance[symmetric.place(i, i)] for i in range(TILT.start, TILT.start + 2))
    return NOMINAL_GRAVITY**2 * tilt + sum(x.covariance[symmetric.place(i, i)] for i in range(ACCEL.start, ACCEL.stop))


AT_EACH_SAMPLE = Aid(
    id="zero_velocity",
    title="zero velocity",
    size=3,
    what="three components, while the vehicle is at rest",
    causes="whether the vehicle stands still there (a log's `standing`, standing_rate, standing_force) and standing_sigma",
    unit="m/s",
    holds=("horizontal",),
    residual=lambda p, seen, u: seen.velocity_w,
    variance=lambda p, x, u, spread: ca.repmat(p.standing_sigma**2, 3, 1),
    due=lambda p, x, u: u.standing,
    inputs=rows.STANDING_INPUT,
    parameters=PARAMETERS,
    state=STATE,
    on_sample=on_sample,
    steps={"still": Step(detected, when="still_due")},
    triggers="still_due",
    flag="standing_now",
)
"""A vehicle known to be at rest has a zero velocity at each sample."""
AID = replace(
    AT_EACH_SAMPLE,
    due=lambda p, x, u: select(u.standing * waited(x.zero_velocity_since, u, p.standing_interval), 1.0, 0.0),
    parameters=PARAMETERS
    + Table((
        Row("standing_interval", "Time between zero velocities of a vehicle known to be at rest", "s", start=0.2,
            lower=0.0, upper=3600.0),
    )),
)  # fmt: skip
"""It has one every `standing_interval`."""
