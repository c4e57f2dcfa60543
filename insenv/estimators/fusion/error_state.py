"""The states of a fusion filter: errors that it estimates beside those of position, velocity and attitude."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from insenv.core.tables import Row, Table

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
