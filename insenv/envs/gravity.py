"""Gravity seen in the body frame that the gyros keep frozen at the start: a short observation and a correcting action.

In the frozen frame the vehicle does not turn, and gravity turns with the Earth.  The mean of its direction is the vertical
at the middle of the time, and its slope is the rotation of the Earth; both are weighted by 30 u^2 (1 - u)^2, with u the
share of the time so far, so that sway averages out.  An attitude R from the frozen frame to n at the start is held: it
starts as reported, and an action turns it.  The observation is the difference between gravity rotated by R and the
gravity expected from the Earth's rotation.
"""

from __future__ import annotations

from math import log as ln
from math import pi
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.compose import Part
from insenv.core.elementary import clamp, exp, log, maximum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table

POWERS = (2, 3, 4, 5)
"""Powers of time by which the force is multiplied in the sums: those of the weights, times u."""
RATE = 6.3e-5
"""Unit of the slope of the vertical, rad/s: the Earth's rate at 30 deg of latitude."""
VERTICAL, SLOPE = (1e-5, 1.0), (1e-3, 30.0)
"""Where the logarithmic scales of the vertical (rad) and of its slope (`RATE`) begin, and where they reach 1."""
STEPS = ((1e-5, 0.8), (1e-5, 0.8), (5.8e-4, pi))
"""Of each component of a correction, rad: where its logarithmic scale begins, and its value for an action of 1."""

CORRECTION = Row(
    "correction", "Rotation vector in n by which the held attitude is turned, on a logarithmic scale: 1 is 0.8, 0.8 and pi rad",
    "1", (3,), "n", 0.0, -1.0, 1.0,
)  # fmt: skip
DECLARE_ABOVE = 0.9
"""An agent that explores about 0 would declare at half of its first steps with a threshold of 0."""
ACTIONS = Table((
    CORRECTION,
    Row("declare", f"Above {DECLARE_ABOVE:g}: aligned, end the episode", start=-1.0, lower=-1.0, upper=1.0),
))  # fmt: skip
OBSERVED = Table((
    Row("time_share", "Share of the time used", lower=0.0, upper=1.0),
    Row("time_level", "ln(1 + time / 5 s) / 4", lower=0.0, upper=4.0),
    Row("vertical_level", "Mean direction of gravity less the expected, north and east; logarithmic", "1", (2,), "n",
        lower=-1.0, upper=1.0),
    Row("vertical", "The same in rad", "rad", (2,), "n", lower=-2.0, upper=2.0),
    Row("slope_level", "Slope of that direction less the expected; logarithmic", "1", (2,), "n", lower=-1.0, upper=1.0),
    Row("slope", f"The same in {RATE:g} rad/s", "1", (2,), "n", lower=-3.0, upper=3.0),
    Row("reported_sigma", "Reported standard deviations of tilt and heading, in half turns", "1", (2,), lower=0.0, upper=4.0),
))  # fmt: skip
"""Rows of the compact observation."""
_STATE = Table((
    Row("turned_q", "From the body to the frozen body frame", "1", (4,), start=(1.0, 0.0, 0.0, 0.0)),
    Row("held_q", "From the frozen body frame to n at the start, after the latest correction", "1", (4,)),
    *(Row(f"force_time_{k}", f"Integral of force times time^{k}, frozen frame", f"m/s^2 s^{k + 1}", (3,)) for k in POWERS),
))  # fmt: skip


def gravity_part() -> Part:
    """Return the part that turns and sums the inertial samples; it reads the rows of the inertial unit and `time`."""

    def gather(p: Any, x: Any, u: Any) -> dict[str, Any]:
        half = attitude.from_rotation_vector(x.imu_valid * x.delta_angle / 2.0)
        middle = attitude.multiply(x.turned_q, half)
        force = attitude.rotate(middle, x.imu_valid * x.delta_velocity)
        time = x.time - p.sample_interval / 2.0
        power, rows = time, {"turned_q": attitude.multiply(middle, half)}
        for k in POWERS:
            power = power * time
            rows[f"force_time_{k}"] = getattr(x, f"force_time_{k}") + power * force
        return rows

    return Part(state=_STATE, steps={"sum_gravity": Step(gather)})


def held(p: Any, x: Any) -> Any:
    """Return the held attitude: the reported one before the first action."""
    reported = attitude.from_euler(*(p.known_attitude[k] for k in range(3)))
    return select(x.decisions > 0.0, x.held_q, reported)


def corrected(p: Any, x: Any, action: Any) -> Any:
    """Return the held attitude after a correction (3,) in [-1, 1]."""
    sizes = [scale * (exp(ca.fabs(action[k]) * ln(1.0 + most / scale)) - 1.0) for k, (scale, most) in enumerate(STEPS)]
    turn = ca.vertcat(*(select(action[k] < 0.0, -size, size) for k, size in enumerate(sizes)))
    q = attitude.multiply(attitude.from_rotation_vector(turn), held(p, x))
    return q / ca.sqrt(ca.sumsqr(q))


def stated(p: Any, x: Any, held_q: Any) -> Any:
    """Return the attitude q_nb that a held attitude states now: n has turned with the Earth, and b as the gyros say."""
    earth = attitude.from_rotation_vector(-x.time * geodesy.earth_rate_n(p.known_latitude))
    return attitude.multiply(earth, attitude.multiply(held_q, x.turned_q))


def observed(p: Any, x: Any) -> dict[str, Any]:
    """Return the values of `OBSERVED`."""
    time = maximum(x.time, p.sample_interval)
    moments, power = {}, time * time
    for k in POWERS:
        power = power * time
        moments[k] = getattr(x, f"force_time_{k}") / power
    mean = 30.0 * (moments[2] - 2.0 * moments[3] + moments[4])
    first = 30.0 * (moments[3] - 2.0 * moments[4] + moments[5]) - 0.5 * mean
    size = ca.sqrt(ca.sumsqr(mean))
    known = size > 0.0
    per = 1.0 / select(known, size, 1.0)
    rotation, earth = held(p, x), geodesy.earth_rate_n(p.known_latitude)
    up = attitude.rotate(attitude.from_rotation_vector(earth * time / 2.0), ca.SX([0, 0, -1]))
    vertical = select(known, (attitude.rotate(rotation, mean) * per - up)[:2], 0.0)
    # the variance of u with these weights is 1/28
    slope = select(known, ((attitude.rotate(rotation, first) * (28.0 * per / time) - ca.cross(earth, up)) / RATE)[:2], 0.0)
    return {
        "time_share": x.decisions / p.decision_limit,
        "time_level": clamp(log(1.0 + x.time / 5.0) / 4.0, 0.0, 4.0),
        "vertical_level": _level(vertical, *VERTICAL),
        "vertical": clamp(vertical, -2.0, 2.0),
        "slope_level": _level(slope, *SLOPE),
        "slope": clamp(slope, -3.0, 3.0),
        "reported_sigma": ca.vertcat(p.known_tilt_sigma, p.known_heading_sigma) / pi,
    }


def _level(value: Any, scale: float, most: float) -> Any:
    """Return the signed logarithm of the elements of a value, 0 at 0 and 1 at `most`."""
    sizes = [log(1.0 + ca.fabs(value[k]) / scale) / ln(1.0 + most / scale) for k in range(value.numel())]
    return clamp(ca.vertcat(*(select(value[k] < 0.0, -size, size) for k, size in enumerate(sizes))), -1.0, 1.0)
