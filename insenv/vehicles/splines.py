"""Uniform B-splines of degree 5: continuous up to the fourth derivative, so that acceleration, jerk and its rate have no steps.

On the interval k (k = 0, 1, ...) of length h a spline is the sum over j = 0 ... 5 of control point k + j times a polynomial of
u = t / h - k, `BASIS`.  De Boor, A Practical Guide to Splines, 2001, ch. IX.

`smoothed` finds the control points for measured points: least squares plus a weight times the mean square of the third
derivative, the jerk of a position (Eilers and Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11
(1996), eq. 12).  Unless the standard deviation of the points is known, the weight is that of generalized cross-validation
(Craven and Wahba, Numer. Math. 31 (1979)): points without noise are met, points with noise are not followed into it.  Where the
derivatives at the points are known too, values and derivatives are fitted together, with the largest weight that does not
fit them worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, factorial

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError

Array = NDArray[np.float64]

DEGREE = 5
POINTS = DEGREE + 1
CAUTION = 1.4
"""Factor of the degrees of freedom in the cross-validation, against fits that meet every point (Kim and Gu, J. R. Stat. Soc. B
66 (2004), section 2.3)."""
WEIGHTS = tuple(10.0 ** np.arange(-12.0, 8.1, 0.5))
"""Weights of the jerk that are tried."""
MARGIN = 1.002
"""With derivatives, what the spline leaves of the points at most, over what it leaves without a penalty."""
REACHED, ROUNDING = 1.05, 1e-10
"""The least standard deviation that a spline is fitted to, over what it leaves without a penalty and over the range of the
values.  Below, a few points or rounding alone decide the control points at the ends, and the spline rings there."""


def _basis() -> Array:
    found = np.zeros((POINTS, POINTS))
    for j in range(POINTS):
        for m in range(POINTS):  # coefficient of u^m of the polynomial of point j
            total = 0.0
            for s in range(j, POINTS):
                total += (-1.0) ** (s - j) * comb(POINTS, s - j) * float(DEGREE - s) ** (DEGREE - m)
            found[m, j] = comb(DEGREE, m) * total / factorial(DEGREE)
    return found


BASIS = _basis()
"""Coefficients (power of u, point) of the polynomials of an interval."""


@dataclass(frozen=True)
class Spline:
    """points (n, columns): control points; interval: length of an interval, s; the spline begins at `begin`, s."""

    points: Array
    interval: float
    begin: float

    def at(self, time: Array, derivative: int = 0) -> Array:
        """Values (m, columns) at times (m,), s, or their derivative of this order."""
        place, weights = weights_at(time - self.begin, self.interval, len(self.points), derivative)
        return np.einsum("mj,mjc->mc", weights, self.points[place[:, None] + np.arange(POINTS)])


def weights_at(time: Array, interval: float, count: int, derivative: int = 0) -> tuple[NDArray[np.int64], Array]:
    """First control point (m,) and weights (m, 6) of the values at `time` since the begin, or of a derivative."""
    place = np.clip(np.floor(time / interval).astype(np.int64), 0, count - POINTS)
    u = time / interval - place
    powers = np.zeros((len(time), POINTS))
    for m in range(derivative, POINTS):
        powers[:, m] = factorial(m) / factorial(m - derivative) * u ** (m - derivative)
    return place, powers @ BASIS / interval**derivative


def point_count(duration: float, interval: float) -> int:
    """Control points of a spline over a time (s)."""
    return int(np.ceil(duration / interval - 1e-9)) + DEGREE


def smoothed(
    time: Array,
    values: Array,
    interval: float,
    weight: Array | None = None,
    sigma: float | None = None,
    rates: Array | None = None,
) -> Spline:
    """The spline of measured values (m, columns).

    weight (m,): of each time, 1 if None; sigma: standard deviation of the values; 0 meets them as far as the knots can; None:
    found by cross-validation.  rates (m, columns): measured derivatives; those times the interval count as the values do.
    """
    from scipy.linalg import cho_solve_banded  # 0.1 s, which a run without a track need not wait

    count = point_count(float(time[-1] - time[0]), interval)
    place, rows = weights_at(time - time[0], interval, count)
    root = np.ones(len(time)) if weight is None else np.sqrt(weight / np.mean(weight))
    rows, values = rows * root[:, None], values * root[:, None]
    if rates is not None:
        places, slopes = weights_at(time - time[0], interval, count, 1)
        place = np.concatenate([place, places])
        rows = np.vstack([rows, interval * root[:, None] * slopes])
        values = np.vstack([values, interval * root[:, None] * rates])
    system = _System(place, rows, count)
    right = system.transposed(values)

    def left(factor: Array) -> tuple[Array, float]:
        points = cho_solve_banded((factor, True), right)
        return points, float(np.sqrt(np.mean((values - system.product(points)) ** 2)))

    factors = [found for weight in WEIGHTS if (found := system.factor(weight)) is not None]
    if not factors:
        raise InputError(f"a gap of {np.diff(time).max():.6g} s with knots every {interval:g} s: allowed is a shorter gap")
    if sigma is None and rates is None:
        probes = np.where(np.random.default_rng(0).random((len(time), 8)) < 0.5, -1.0, 1.0)
        probed = system.transposed(probes)

        def score(factor: Array) -> float:
            trace = float(np.mean(np.sum(probed * cho_solve_banded((factor, True), probed), axis=0))) / len(time)
            free = 1.0 - CAUTION * trace
            return left(factor)[1] ** 2 / free**2 if free > 0.0 else np.inf

        best = int(np.argmin([score(each) for each in factors]))
    else:
        fits = [left(each)[1] for each in factors]
        sigma = (
            MARGIN * fits[0] if sigma is None else max(sigma, REACHED * fits[0], ROUNDING * float(np.ptp(values, axis=0).max()))
        )
        best = max(int(np.searchsorted(np.maximum.accumulate(fits), sigma)) - 1, 0)
    return Spline(left(factors[best])[0], interval, float(time[0]))


class _System:
    """The banded normal equations of a fit."""

    def __init__(self, place: NDArray[np.int64], rows: Array, count: int) -> None:
        self.place, self.rows, self.count = place, rows, count
        self.columns = place[:, None] + np.arange(POINTS)
        self.normal = np.zeros((POINTS, count))
        for j in range(POINTS):
            for i in range(j, POINTS):
                np.add.at(self.normal[i - j], place + j, rows[:, i] * rows[:, j])
        third = np.diff(np.eye(4), 3, axis=0)[0]
        self.penalty = np.zeros((POINTS, count))
        for start in range(count - 3):
            for j in range(4):
                for i in range(j, 4):
                    self.penalty[i - j, start + j] += third[i] * third[j]

    def transposed(self, values: Array) -> Array:
        """Rows^T times values."""
        found = np.zeros((self.count, values.shape[1]))
        for j in range(POINTS):
            np.add.at(found, self.place + j, self.rows[:, j : j + 1] * values)
        return found

    def product(self, points: Array) -> Array:
        """Rows times control points."""
        return np.einsum("mj,mjc->mc", self.rows, points[self.columns])

    def factor(self, weight: float) -> Array | None:
        """Cholesky factor of the normal equations with this weight of the jerk.

        None where points and penalty do not determine the spline: in a long gap rounding loses a small weight.
        """
        from scipy.linalg import cholesky_banded

        try:
            return np.asarray(cholesky_banded(self.normal + weight * self.penalty, lower=True))
        except np.linalg.LinAlgError:
            return None
