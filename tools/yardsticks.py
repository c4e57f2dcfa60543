"""What pages and tests compare filters with beside the limit: position errors of the optimal filter and of the optimal
smoother, drawn as whole paths (`error_paths`), and the smallest errors of the inertial unit (`bound_of_unit`).

The limit is a standard deviation at one instant.  A statistic of a stretch of time, such as the largest error in an outage,
also depends on how the errors of its instants belong together.  The optimal filter of `recursion` is therefore run on drawn
start errors and noises: all is linear, so its errors have exactly the limit's covariance.  The smoother, which uses the
measurements of the whole run, is the adjoint filter of Bryson and Frazier (1963) in the form of Bierman (1973), "Fixed
interval smoothing with discrete measurements", Int. J. Control 18, 65-75: e and P being those of the filter,

    smoothed error = e - P s,    s <- s + H^T (S^-1 z - K^T s) over a measurement z = H e + v,    s <- Phi^T s over a step

Draws of one run share its trajectory.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insenv.core.model import Model
from insenv.core.tables import Array
from insenv.evaluation.limits.bound import blocks_of, layout_of
from insenv.evaluation.limits.recursion import CovarianceFilter, Layout, Moves, Prior
from insenv.evaluation.limits.steps import DR, NAVIGATION, Steps, earth_axes


@dataclass(frozen=True)
class Paths:
    """Errors (estimate minus truth) of position in n, m: `filtered` and `smoothed` (instants, 3, draws); time (instants,) s."""

    time: Array
    filtered: Array
    smoothed: Array


def error_paths(blocks: Iterable[Steps], layout: Layout, prior: Prior, windows: Array, draws: int, seed: int) -> Paths:
    """Draw errors of position in the windows [begin, end) (k, 2), s, along a trajectory of a vehicle that is not moored.

    A fix counts from its epoch on: latency, which only delays what is known, is left out.
    """
    if layout.mooring is not None:
        raise ValueError("error_paths: layout.mooring is a mooring; allowed is None")
    if layout.fixes is not None:
        layout = replace(layout, fixes=replace(layout.fixes, latency=0))
    filter_ = None
    for steps in blocks:
        filter_ = filter_ or _Drawn(layout, prior, steps, draws, seed)
        C_en = earth_axes(steps.latitude, steps.longitude)
        wanted = np.any((steps.time[:, None] >= windows[:, 0]) & (steps.time[:, None] < windows[:, 1] - 1e-9), axis=1)
        for k in filter_.each(steps):
            if wanted[k]:
                filter_.keep(float(steps.time[k]), C_en[k].T)
    assert filter_ is not None
    return filter_.paths()


@dataclass(frozen=True)
class _Move:
    """A step: the transition of the navigation errors (9, s) and the factors (s - 9,) of the other states."""

    both: Array
    decay: Array

    def back(self, s: Array) -> Array:
        moved = self.both.T @ s[:NAVIGATION]
        moved[NAVIGATION:] += self.decay[:, None] * s[NAVIGATION:]
        return np.asarray(moved)


@dataclass(frozen=True)
class _Measurement:
    """H (r, s), the gain K (s, r), and S^-1 z (r, draws)."""

    H: Array
    gain: Array
    weighted: Array

    def back(self, s: Array) -> Array:
        return np.asarray(s + self.H.T @ (self.weighted - self.gain.T @ s))


@dataclass(frozen=True)
class _Instant:
    """After all measurements of an instant: errors of position (3, draws), and their covariance (3, s) with all states."""

    time: float
    error: Array
    covariance: Array


class _Drawn(CovarianceFilter):
    """The recursion with the errors (s, draws) of as many filters, and a record for the way back."""

    def __init__(self, layout: Layout, prior: Prior, first: Steps, draws: int, seed: int) -> None:
        super().__init__(layout, prior, first)
        self.random = np.random.default_rng(seed)
        self.errors = _root(self.P) @ self.random.standard_normal((len(self.P), draws))
        self.record: list[_Move | _Measurement | _Instant] = []

    def move(self, moves: Moves, k: int) -> None:
        """As of the covariance, and of the errors."""
        super().move(moves, k)
        decay, added = np.ones(len(self.variance)), np.zeros(len(self.variance))
        decay[self.decaying], added[self.decaying] = moves.decay[k], moves.grown[k]
        added[self.walking] += moves.walked[k]
        noise = self.random.standard_normal(self.errors.shape)
        self.errors = np.concatenate([
            moves.both[k] @ self.errors + _root(moves.drive[k]) @ noise[:NAVIGATION],
            decay[:, None] * self.errors[NAVIGATION:] + np.sqrt(added)[:, None] * noise[NAVIGATION:],
        ])  # fmt: skip
        self.record.append(_Move(moves.both[k], decay))

    def measure(self, H: Array, variance: Array) -> None:
        """As of the covariance, and of the errors."""
        crossed = H @ self.P
        inverse = np.linalg.inv(crossed @ H.T + np.diag(variance))
        draws = self.errors.shape[1]
        z = H @ self.errors + np.sqrt(variance)[:, None] * self.random.standard_normal((len(variance), draws))
        gain = crossed.T @ inverse
        self.errors = self.errors - gain @ z
        self.record.append(_Measurement(H, gain, inverse @ z))
        super().measure(H, variance)

    def keep(self, time: float, C_ne: Array) -> None:
        """This instant is wanted."""
        self.record.append(_Instant(time, C_ne @ self.errors[DR], C_ne @ self.P[DR]))

    def paths(self) -> Paths:
        """The way back."""
        s = np.zeros_like(self.errors)
        points: list[tuple[float, Array, Array]] = []
        for entry in reversed(self.record):
            if isinstance(entry, _Instant):
                points.append((entry.time, entry.error, entry.error - entry.covariance @ s))
            else:
                s = entry.back(s)
        time, filtered, smoothed = zip(*reversed(points), strict=True)
        return Paths(np.array(time), np.array(filtered), np.array(smoothed))


def _root(P: Array) -> Array:
    """R with R R^T = P, which may be singular and whose states may differ widely in size."""
    scale = np.sqrt(np.diag(P))
    scale[scale == 0.0] = 1.0
    values, vectors = np.linalg.eigh(P / scale / scale[:, None])
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


# The smallest errors of the inertial unit itself.


def bound_of_unit(model: Model, rows: Mapping[str, Any], prior: Prior, samples: int, *, in_place: bool) -> dict[str, Array]:
    """The smallest standard deviations of the errors of the inertial unit at the end of a trajectory, SI.

    As `insenv.evaluation.limits.bound`.  By the names of the error states of `fusion`: gyro_bias, accel_bias (3; all that a
    bias is made of), gyro_scale, accel_scale (3), gyro_misalignment, accel_misalignment (6); those that the unit has.
    """
    interval = float(rows["sample_interval"])
    layout = layout_of(rows, interval, in_place)
    P = errors_left(blocks_of(model, rows, interval, samples, layout), layout, prior)
    picks: dict[str, dict[int, Array]] = {}  # by name and component, which states make it up
    for source in layout.unit.sources:
        if source.triad not in (0, 1):
            continue
        begin = layout.place(source).start - NAVIGATION
        for number, place in enumerate(source.place.tolist()):
            named = _named(source.name, "gyro" if source.triad == 0 else "accel", place)
            if named is not None:
                name, component = named
                picks.setdefault(name, {}).setdefault(component, np.zeros(len(P)))[begin + number] = 1.0
    return {name: np.array([np.sqrt(w @ P @ w) for _, w in sorted(components.items())]) for name, components in picks.items()}


def _named(source: str, triad: str, place: int) -> tuple[str, int] | None:
    """The error state that a component of a source belongs to, and which of its components; None for others."""
    if source == "matrix":
        row, column = divmod(place, 3)
        return (f"{triad}_scale", row) if row == column else (f"{triad}_misalignment", place)
    return (f"{triad}_bias", place) if "bias" in source or "flicker" in source else None


def errors_left(blocks: Iterable[Steps], layout: Layout, prior: Prior) -> Array:
    """The covariance of the states of `Layout.sources`, in their order, after all blocks."""
    filter_ = None
    for steps in blocks:
        filter_ = filter_ or CovarianceFilter(layout, prior, steps)
        filter_.block(steps)
    assert filter_ is not None
    return filter_.P[NAVIGATION:, NAVIGATION:]
