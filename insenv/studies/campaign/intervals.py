"""Confidence intervals of the statistics of independent runs, 95 %, without assuming a distribution of the errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OUTSIDE = 0.025
"""Probability outside each end of an interval."""


@dataclass(frozen=True)
class Estimate:
    """A statistic of runs and its 95 % interval; NaN where so few runs give no end."""

    value: float
    low: float
    high: float

    def as_json(self) -> dict[str, float]:
        """The documented JSON form."""
        return {"value": self.value, "low": self.low, "high": self.high}


def percentile(values: Array, percent: float) -> Estimate:
    """A percentile of values (n,): the interval of order statistics (David and Nagaraja 2003, section 7.1).

    The number of values below the true percentile is binomial, whatever their distribution is.
    """
    from scipy.special import bdtr

    ordered, n, p = np.sort(values), len(values), percent / 100.0
    if not n:
        return Estimate(float("nan"), float("nan"), float("nan"))
    below = bdtr(np.arange(n + 1), n, p)  # P(at most k values below)
    first = int(np.searchsorted(below, OUTSIDE, side="right"))  # P(fewer than `first` below) is at most 2.5 %
    last = int(np.searchsorted(below, 1.0 - OUTSIDE, side="left"))  # P(more than `last` below) is at most 2.5 %
    low = float(ordered[first - 1]) if first >= 1 else float("nan")
    high = float(ordered[last]) if last < n else float("nan")
    return Estimate(float(np.percentile(ordered, percent)), low, high)


def root_mean_square(squares: Array) -> Estimate:
    """Root mean square over runs of which each has the mean square `squares` (n,): Student's interval of its logarithm."""
    n, mean = len(squares), float(np.mean(squares)) if len(squares) else float("nan")
    if n < 2 or not mean > 0.0:
        return Estimate(float(np.sqrt(mean)), float("nan"), float("nan"))
    reach = student(n - 1) * float(np.std(squares, ddof=1)) / (mean * np.sqrt(n)) / 2.0
    value = float(np.sqrt(mean))
    return Estimate(value, value * float(np.exp(-reach)), value * float(np.exp(reach)))


def student(degrees: int) -> float:
    """Student's t that is exceeded with the probability `OUTSIDE`."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 1.0 - OUTSIDE))


def horizontal(north: Array, east: Array) -> dict[str, Estimate]:
    """Horizontal errors of runs (n,): "cep", the radius that holds half of them, "r95"; "2drms", twice the rms distance."""
    radius = np.hypot(north, east)
    rms = root_mean_square(radius**2)
    return {
        "cep": percentile(radius, 50.0),
        "r95": percentile(radius, 95.0),
        "2drms": Estimate(2.0 * rms.value, 2.0 * rms.low, 2.0 * rms.high),
    }
