"""The end of a lever arm some time ago, and the angular acceleration that it needs.

With the rate w and the angular acceleration w' of the body now, the lever arm l was, `age` seconds ago and in the present
body axes,

    arm   = l - age (w x l) + age^2 / 2 (w' x l + w x (w x l))
    swing =         w x l  - age       (w' x l + w x (w x l))

and `swing` was the velocity of its end. w' from differences of two samples would have their full noise. Instead w' is the
difference between the rate and its first-order low-pass, over the lag of the latter. With half the age of a fix as the lag,
w - age w' is the rate at the time of the fix to second order, with the noise of one sample.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.attitude import skew
from insenv.core.elementary import maximum, select
from insenv.core.tables import Row, Table

SHORTEST = 4.0
"""Samples: the smallest lag, which keeps the noise of the angular acceleration bounded."""

MEMORY = Table((
    Row("mean_rate", "Angular rate as it was `rate_lag` ago", "rad/s", (3,), "b"),
    Row("rate_lag", "Lag of that rate: half the age of the last fix", "s", start=0.1),
))  # fmt: skip
"""State rows of a filter that uses late fixes."""


def followed(x: Any, rate: Any, dt: Any, first: Any) -> dict[str, Any]:
    """Row `mean_rate` after a sample of mean rate `rate` (3, rad/s, b) and length `dt` (s); first: 1 at the first one."""
    return {"mean_rate": lagging(x, x.mean_rate, rate, dt, first)}


def lagging(x: Any, mean: Any, value: Any, dt: Any, first: Any) -> Any:
    """A mean (3) of what changes slowly, as it was `rate_lag` ago, after a sample of mean `value` (3) and length `dt` (s)."""
    return select(first, value, mean + (value - mean) * (dt / (_lag(x, dt) + dt)))


def angular_acceleration(x: Any, rate: Any, dt: Any) -> Any:
    """w' (3, rad/s^2, b) after a sample of mean rate `rate`, x being the state after it."""
    return (rate - x.mean_rate) / _lag(x, dt)


def lagged(age: Any) -> dict[str, Any]:
    """Row `rate_lag` after a fix of that age (s)."""
    return {"rate_lag": age / 2}


def then(rate: Any, change: Any, arm: Any, age: Any) -> tuple[Any, Any]:
    """arm (3, m, b) and swing (3, m/s, b) `age` seconds ago; rate (3, rad/s), change (3, rad/s^2): w and w' now."""
    turning = ca.cross(rate, arm)
    bend = ca.cross(change, arm) + ca.cross(rate, turning)
    return arm - age * turning + (age**2 / 2) * bend, turning - age * bend


def by_rate(rate: Any, arm: Any, age: Any) -> tuple[Any, Any]:
    """Derivatives (3x3) of the two results of `then` with respect to the rate."""
    L = skew(arm)
    bend = -skew(ca.cross(rate, arm)) - skew(rate) @ L
    return age * L + (age**2 / 2) * bend, -L - age * bend


def _lag(x: Any, dt: Any) -> Any:
    return maximum(x.rate_lag, SHORTEST * dt)
