"""A vehicle on a prescribed track: position and attitude are splines of degree 5 over time (`insenv.vehicles.track`).

Latitude, longitude, height, roll, pitch and heading are the channels; their control points are rows of a parameter. The model
holds the six points of the interval that it is in; at a knot it looks up the next one. The velocity is the exact derivative:

    v_N = (R_M + h) dL/dt,    v_E = (R_N + h) cos L dl/dt,    v_D = -dh/dt        (Groves 2013, eq. 2.111)

so that the integral of the velocity, the position of the truth, stays on the track.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.elementary import minimum
from insenv.core.instructions import row_of
from insenv.core.model import Step, Values
from insenv.core.tables import Array, Row, Table
from insenv.geodesy import radii
from insenv.vehicles.truth import PLACES, SineCosine, Vehicle

# Uniform B-splines of degree 5: continuous up to the fourth derivative, so that acceleration, jerk and its rate have no steps.
#
# On the interval k (k = 0, 1, ...) of length h a spline is the sum over j = 0 ... 5 of control point k + j times a polynomial
# of u = t / h - k, `BASIS`.  De Boor, A Practical Guide to Splines, 2001, ch. IX.
#
# `smoothed` finds the control points for measured points: least squares plus a weight times the mean square of the third
# derivative, the jerk of a position (Eilers and Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11
# (1996), eq. 12).  Unless the standard deviation of the points is known, the weight is that of generalized cross-validation
# (Craven and Wahba, Numer. Math. 31 (1979)): points without noise are met, points with noise are not followed into it.  Where
# the derivatives at the points are known too, values and derivatives are fitted together, with the largest weight that does not
# fit them worse.


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
    coefficients = np.zeros((POINTS, POINTS))
    for j in range(POINTS):
        for m in range(POINTS):  # coefficient of u^m of the polynomial of point j
            total = 0.0
            for s in range(j, POINTS):
                total += (-1.0) ** (s - j) * comb(POINTS, s - j) * float(DEGREE - s) ** (DEGREE - m)
            coefficients[m, j] = comb(DEGREE, m) * total / factorial(DEGREE)
    return coefficients


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

    factors = [factor for weight in WEIGHTS if (factor := system.factor(weight)) is not None]
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
        product = np.zeros((self.count, values.shape[1]))
        for j in range(POINTS):
            np.add.at(product, self.place + j, self.rows[:, j : j + 1] * values)
        return product

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


CHANNELS = ("latitude", "longitude", "height", "roll", "pitch", "heading")
SIZES = (64, 256, 1024, 4096, 16384)
"""Numbers of control points for which there is a model."""


@lru_cache(maxsize=len(SIZES))
def track(points: int) -> Vehicle:
    """A vehicle on a track of at most `points` control points, one of `SIZES`.

    Parameters: ``track_points`` (points, 6): control points of `CHANNELS`, rad and m, latitude, longitude and height less those
    of the origin; ``track_interval`` s between knots; ``track_latitude``, ``track_height`` of the origin; mean_roll,
    mean_pitch, start_heading are added to the angles.
    """
    channels = len(CHANNELS)
    parameters = Table((
        Row("track_points", "Control points of latitude, longitude, height (less those of the origin), roll, pitch, heading",
            "1", (points, channels)),
        Row("track_interval", "Time between knots", "s", start=1.0, lower=1e-3, upper=3600.0),
        Row("track_latitude", "Latitude of the origin", "rad", lower=-1.571, upper=1.571),
        Row("track_height", "Height of the origin above the ellipsoid", "m"),
        Row("mean_roll", "Added to the roll of the track", "rad"),
        Row("mean_pitch", "Added to the pitch of the track", "rad"),
        Row("start_heading", "Added to the heading of the track", "rad"),
    ))  # fmt: skip
    state = Table((
        Row("track_window", "Control points of the interval", "1", (POINTS, channels)),
        Row("track_next", "The control point that comes at the next knot", "1", (channels,)),
        Row("track_number", "Number of that point"),
        Row("track_time", "Time since the knot", "s"),
        Row("track_due", "Whether a knot is reached (1) or not (0)"),
    ))  # fmt: skip

    def start(p: Values) -> dict[str, Any]:
        window = p.track_points[:POINTS, :]
        return {"track_window": window, "track_next": p.track_points[POINTS, :].T, "track_number": POINTS + 0.0}

    def look_up(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {"track_next": ca.vertcat(*row_of(p.track_points, x.track_number))}

    def advance(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {
            "track_window": ca.vertcat(x.track_window[1:, :], x.track_next.T),
            "track_number": minimum(x.track_number + 1.0, points - 1.0),
            "track_time": x.track_time - p.track_interval,
            "track_due": 0.0,
        }

    def hold(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {"track_due": x.track_time + 1.5 * p.sample_interval > p.track_interval}

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        return [{"track_time": x.track_time + place * p.sample_interval} for place in PLACES]

    def derivative(p: Values, x: Values) -> dict[str, Any]:
        return {"track_time": 1.0}

    def values(p: Values, x: Values) -> tuple[list[Any], list[Any]]:
        """The channels and their derivatives."""
        u = x.track_time / p.track_interval
        series, rates = [], []
        for channel in range(channels):
            terms = [sum(float(w) * x.track_window[j, channel] for j, w in enumerate(row) if w) for row in BASIS]
            value: Any = 0.0
            rate: Any = 0.0
            for power in reversed(range(POINTS)):
                value = value * u + terms[power]
                rate = rate * u + power * terms[power] if power else rate
            series.append(value)
            rates.append(rate / p.track_interval)
        return series, rates

    def angles(p: Values, x: Values) -> list[Any]:
        latitude, _, _, roll, pitch, heading = values(p, x)[0]
        return [p.mean_roll + roll, p.mean_pitch + pitch, p.start_heading + heading, p.track_latitude + latitude]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        sine, cosine = pairs[3]
        series, rates = values(p, x)
        R_M, R_N = radii(sine)
        height = p.track_height + series[2]
        return ca.vertcat((R_M + height) * rates[0], (R_N + height) * cosine * rates[1], -rates[2])

    return Vehicle(
        id=f"track-{points}",
        title="A vehicle on a given track",
        parameters=parameters,
        state=state,
        along=along,
        derivative=derivative,
        angles=angles,
        velocity_n=velocity_n,
        start=start,
        hold=hold,
        steps={"track_look_up": Step(look_up, when="track_due"), "track_advance": Step(advance, when="track_due")},
    )
