"""The states of a fusion filter, the errors that it estimates beside position, velocity and attitude; those of the unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from insenv.core.tables import Row, Table
from insenv.estimators.parts import rows
from insenv.estimators.parts.error_model import bias_sigma
from insenv.sensors.data_sheet import PROPORTIONAL
from insenv.sensors.imu_tables import COUPLINGS

LARGEST = 1e12


@dataclass(frozen=True, eq=False)
class Process:
    """A linear process of k numbers with white driving noise, over an interval of any length.

    called: what it is, for listings.  transition: ``(p, duration in s) -> (k x k)``, sparse.  noise: ``(p, duration in s) ->
    (k)``, the variances that the driving noise adds.
    """

    called: str
    transition: Callable[[Any, Any], Any]
    noise: Callable[[Any, Any], Any]


@dataclass(frozen=True, eq=False)
class ErrorState:
    """Errors of one kind, k numbers.

    value: the state row of the estimate: name, meaning, unit, shape (k,), frame.
    sigma: name of the parameter row of the standard deviation at the start, () or (k,).
    time: name of the parameter row of the correlation time (s) of a stationary first-order Gauss-Markov process; empty: the
        errors are constant.
    process: of errors that are neither constant nor such a process; its stationary standard deviation is `sigma`.
    rows: the parameter rows that it needs, those two among them.
    started: ``p -> (k)``, the estimate at the start.  None: 0.
    started_sigma: ``p -> () or (k)``, its standard deviation, if it is not the row `sigma`.
    less_position: whether it is relative to the stated position at the start, and known relative to the true one: its error
        then contains that of the position at the start, with the other sign.
    increments: ``(value, delta_angle, delta_velocity, dt) -> (delta_angle, delta_velocity)``: takes the error out of measured
        increments (rad, m/s, b).  None: it is none of the inertial unit.
    rate_w: ``value -> (3)``, rad/s in w: what the rotation of the Earth there is more than that of the estimated position.  A
        filter has at most one such state, and then the error of its attitude about the vertical is 0 at the start
        (`insenv.estimators.fusion.azimuth`).
    """

    value: Row
    sigma: str
    rows: Table
    time: str = ""
    process: Process | None = None
    started: Callable[[Any], Any] | None = None
    started_sigma: Callable[[Any], Any] | None = None
    less_position: bool = False
    increments: Callable[[Any, Any, Any, Any], tuple[Any, Any]] | None = None
    rate_w: Callable[[Any], Any] | None = None

    @property
    def name(self) -> str:
        """The name of its state row."""
        return self.value.name

    @property
    def size(self) -> int:
        """k."""
        return self.value.size

    def start_sigma(self, p: Any) -> Any:
        """Standard deviation at the start, () or (k)."""
        return getattr(p, self.sigma) if self.started_sigma is None else self.started_sigma(p)


def sigma_row(
    name: str, meaning: str, unit: str, size: int = 0, frame: str = "", start: float | tuple[float, ...] = 0.0
) -> Row:
    """A parameter row of standard deviations."""
    return Row(name, meaning, unit, (size,) if size else (), frame, start, 0.0, LARGEST)


def constant(
    name: str, meaning: str, unit: str, size: int, sigma: Row, frame: str = "", rows: Table | None = None, **more: Any
) -> ErrorState:
    """A constant error with the parameter row `sigma` of its standard deviation at the start."""
    return ErrorState(
        Row(name, f"Estimated {meaning}", unit, (size,), frame), sigma=sigma.name, rows=_with(sigma, rows), **more
    )


def drifting(name: str, meaning: str, unit: str, size: int, sigma: Row, time: Row, frame: str = "") -> ErrorState:
    """A stationary first-order Gauss-Markov error with the parameter rows of its standard deviation and correlation time."""
    value = Row(name, f"Estimated {meaning}", unit, (size,), frame)
    return ErrorState(value, sigma=sigma.name, time=time.name, rows=Table((sigma, time)))


def _with(row: Row, rows: Table | None) -> Table:
    return Table((row,)) if rows is None else rows + Table((row,))


# Error states of the inertial unit: what its increments lack.
#
#     true delta angle    = (I - S - M) (measured - (bias + G f) dt)
#     true delta velocity = (I - S - M) (measured - bias dt)
#
# S is diagonal (scale factor), M has the six couplings of the axes (misalignment), G is the g-sensitivity of the gyros; f is
# the specific force.  These are the errors of `insenv.sensors.imu` the other way round: I - S - M is the inverse of I + S + M
# there.  Groves (2013), section 4.4.


def coupled(matrix: Any, vector: Any) -> Any:
    """M times a vector; matrix: the six `COUPLINGS`."""
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


def _drifting(triad: str, what: str) -> dict[str, ErrorState]:
    """The errors of a triad that are in proportion to its increments with a correlation time, by name."""
    meaning = f"Correlation time of scale factor and misalignment of the {what}"
    time = Row(f"{triad}_scale_time", meaning, "s", start=1e9, lower=1e-3, upper=LARGEST)
    chosen = [state for state in STATES if state.name in PROPORTIONAL[triad]]
    return {state.name: replace(state, time=time.name, rows=state.rows + Table((time,))) for state in chosen}


DRIFTING = {**_drifting("gyro", "gyros"), **_drifting("accel", "accelerometers")}
"""By name, the states whose errors are first-order Gauss-Markov processes where the unit has a correlation time of them."""
