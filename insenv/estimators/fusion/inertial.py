"""Error states of the inertial unit: what its increments lack.

    true delta angle    = (I - S - M) (measured - (bias + G f) dt)
    true delta velocity = (I - S - M) (measured - bias dt)

S is diagonal (scale factor), M has the six couplings of the axes (misalignment), G is the g-sensitivity of the gyros; f is
the specific force.  These are the errors of `insenv.sensors.imu` the other way round: I - S - M is the inverse of I + S + M
there.  Groves (2013), section 4.4.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.estimators.fusion.error_state import ErrorState, constant, sigma_row
from insenv.estimators.parts import rows
from insenv.estimators.parts.error_model import bias_sigma

COUPLINGS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
"""Row and column of the couplings xy, xz, yx, yz, zx, zy."""


def coupled(matrix: Any, vector: Any) -> Any:
    """M times a vector; matrix: the six couplings."""
    sums = [ca.SX(0)] * 3
    for value, (row, column) in zip(ca.vertsplit(matrix), COUPLINGS, strict=True):
        sums[row] = sums[row] + value * vector[column]
    return ca.vertcat(*sums)


GYRO_BIAS = ErrorState(
    rows.BIASES["gyro_bias"],
    sigma="gyro_bias_sigma",
    time="gyro_correlation_time",
    rows=rows.chosen(rows.SENSORS, "gyro_bias_sigma", "gyro_correlation_time", gyro_bias_sigma=1e-6),
    started=lambda p: p.start_gyro_bias,
    started_sigma=bias_sigma,
    increments=lambda bias, angle, velocity, dt: (angle - bias * dt, velocity),
)
ACCEL_BIAS = ErrorState(
    rows.BIASES["accel_bias"],
    sigma="accel_bias_sigma",
    time="accel_correlation_time",
    rows=rows.chosen(rows.SENSORS, "accel_bias_sigma", "accel_correlation_time", accel_bias_sigma=1e-2),
    started=lambda p: p.start_accel_bias,
    increments=lambda bias, angle, velocity, dt: (angle, velocity - bias * dt),
)


def _fixed(name: str, meaning: str, unit: str, size: int, increments: Any) -> ErrorState:
    sigma = sigma_row(f"{name}_sigma", f"Standard deviation of the {meaning}", unit)
    return constant(name, meaning, unit, size, sigma, "b", increments=increments)


STATES = (
    GYRO_BIAS,
    ACCEL_BIAS,
    _fixed("gyro_g_sensitivity", "gyro g-sensitivity, each gyro along its own axis", "rad s/m", 3,
           lambda value, angle, velocity, dt: (angle - value * velocity, velocity)),
    _fixed("gyro_scale", "gyro scale factor", "1", 3, lambda value, angle, velocity, dt: (angle - value * angle, velocity)),
    _fixed("gyro_misalignment", "gyro misalignment: couplings xy, xz, yx, yz, zx, zy", "1", 6,
           lambda value, angle, velocity, dt: (angle - coupled(value, angle), velocity)),
    _fixed("accel_scale", "accelerometer scale factor", "1", 3,
           lambda value, angle, velocity, dt: (angle, velocity - value * velocity)),
    _fixed("accel_misalignment", "accelerometer misalignment: couplings xy, xz, yx, yz, zx, zy", "1", 6,
           lambda value, angle, velocity, dt: (angle, velocity - coupled(value, velocity))),
)  # fmt: skip
