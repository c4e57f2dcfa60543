"""Statistics of the inertial samples and fixes since the last decision, as a part of a model."""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.compose import Part
from insenv.core.elementary import clamp, maximum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.envs.filter_inside import log10
from insenv.scenario.loop import PREFIX

LARGEST_RATIO = 100.0
"""Bound on the magnitude of a test ratio."""

_SUMS = Table((
    Row("window_samples", "Samples received since the last step"),
    Row("window_delta_angle", "Their gyro increments, summed", "rad", (3,), "b"),
    Row("window_delta_velocity", "Their accelerometer increments, summed", "m/s", (3,), "b"),
    Row("window_delta_angle_square", "Squares of their gyro increments, summed", "rad^2", (3,), "b"),
    Row("window_delta_velocity_square", "Squares of their accelerometer increments, summed", "m^2/s^2", (3,), "b"),
    Row("window_fixes", "Fixes since the last step"),
    Row("window_ratio", "Their test ratios, summed", "1", (6,), "n"),
    Row("window_ratio_square", "Squares of their test ratios, summed", "1", (6,), "n"),
    Row("window_innovation_square", "Squares of their innovations, summed", "m^2, m^2/s^2", (6,), "n"),
))  # fmt: skip
_FIX_TIME = Row("fix_time", "Time at which the latest fix was delivered", "s")

SHOWN = Table((
    Row("fixes", "Fixes since the last step", lower=0.0, upper=1e6),
    Row("fix_age", "Time since the epoch of the latest fix", "s", lower=0.0, upper=1e6),
    Row("innovation_rms", "Root mean square of the fixes' innovations: position (m), velocity (m/s)", "m, m/s", (6,), "n",
        lower=0.0, upper=1e6),
    Row("test_ratio_mean", "Mean of the test ratios: innovations over their standard deviations", "1", (6,), "n",
        lower=-LARGEST_RATIO, upper=LARGEST_RATIO),
    Row("test_ratio_level", "Decimal logarithm of their root mean square; 0 for a consistent filter, and without fixes", "1",
        (6,), "n", lower=-6.0, upper=2.0),
    Row("rate_mean", "Mean of the gyros", "rad/s", (3,), "b", lower=-1e3, upper=1e3),
    Row("rate_deviation", "Standard deviation of a gyro sample", "rad/s", (3,), "b", lower=0.0, upper=1e3),
    Row("force_mean", "Mean of the accelerometers", "m/s^2", (3,), "b", lower=-1e5, upper=1e5),
    Row("force_deviation", "Standard deviation of an accelerometer sample", "m/s^2", (3,), "b", lower=0.0, upper=1e5),
))  # fmt: skip
"""Observation rows of the window."""


def window_part() -> Part:
    """Return the part that sums after the filter's steps; `begun` sets the sums to zero."""
    return Part(
        state=_SUMS + Table((_FIX_TIME,)),
        steps={"window": Step(_sample), "window_fix": Step(_fix, when="gnss_valid")},
    )


def begun() -> dict[str, Any]:
    """Return the state rows of an empty window."""
    return {row.name: ca.SX.zeros(row.size) for row in _SUMS}


def _sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    angle, velocity = x.imu_valid * x.delta_angle, x.imu_valid * x.delta_velocity
    return {
        "window_samples": x.window_samples + x.imu_valid,
        "window_delta_angle": x.window_delta_angle + angle,
        "window_delta_velocity": x.window_delta_velocity + velocity,
        "window_delta_angle_square": x.window_delta_angle_square + angle * angle,
        "window_delta_velocity_square": x.window_delta_velocity_square + velocity * velocity,
    }


def _fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    ratio = clamp(getattr(x, f"{PREFIX}test_ratio"), -LARGEST_RATIO, LARGEST_RATIO)
    innovation = getattr(x, f"{PREFIX}innovation")
    return {
        "window_fixes": x.window_fixes + 1.0,
        "window_ratio": x.window_ratio + ratio,
        "window_ratio_square": x.window_ratio_square + ratio * ratio,
        "window_innovation_square": x.window_innovation_square + innovation * innovation,
        "fix_time": x.time,
    }


def shown(p: Any, x: Any) -> dict[str, Any]:
    """Return the values of `SHOWN`, not yet clipped to their bounds."""
    count, fixes = maximum(x.window_samples, 1.0), maximum(x.window_fixes, 1.0)
    rate = 1.0 / p.sample_interval
    some = x.window_fixes > 0.0
    return {
        "fixes": x.window_fixes,
        "fix_age": (x.time - x.fix_time) + select(x.fix_time > 0.0, x.gnss_age, 0.0),
        "innovation_rms": ca.sqrt(x.window_innovation_square / fixes),
        "test_ratio_mean": x.window_ratio / fixes,
        "test_ratio_level": select(some, 0.5 * log10(x.window_ratio_square / fixes), 0.0),
        "rate_mean": x.window_delta_angle * (rate / count),
        "rate_deviation": rate * _deviation(x.window_delta_angle, x.window_delta_angle_square, count),
        "force_mean": x.window_delta_velocity * (rate / count),
        "force_deviation": rate * _deviation(x.window_delta_velocity, x.window_delta_velocity_square, count),
    }


def _deviation(total: Any, squares: Any, count: Any) -> Any:
    mean = total / count
    return ca.sqrt(maximum(squares / count - mean * mean, 0.0))
