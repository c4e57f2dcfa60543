"""Position errors of the optimal filter and of the optimal smoother, drawn as whole paths.

The limit is a standard deviation at one instant.  A statistic of a stretch of time, such as the largest error in an outage,
also depends on how the errors of its instants belong together.  The optimal filter of `recursion` is therefore run on drawn
start errors and noises: all is linear, so its errors have exactly the limit's covariance.  The smoother, which uses the
measurements of the whole run, is the adjoint filter of Bryson and Frazier (1963) in the form of Bierman (1973), "Fixed
interval smoothing with discrete measurements", Int. J. Control 18, 65-75: e and P being those of the filter,

    smoothed error = e - P s,    s <- s + H^T (S^-1 z - K^T s) over a measurement z = H e + v,    s <- Phi^T s over a step

Draws of one run share its trajectory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from insenv.core.tables import Array
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
