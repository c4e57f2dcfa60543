"""The noise terms of an inertial sensor, fitted to its Allan variance.

IEEE Std 952-1997, annex C, for the rate of a gyro; the same for an accelerometer. tau: averaging time, s.

==================  ======================================  ===========================================================
term                Allan variance                          figure
==================  ======================================  ===========================================================
quantization        3 Q^2 / tau^2                           Q, rad or m/s (a count is sqrt(12) Q)
white               N^2 / tau                               N, random walk
flicker             F^2                                     F, the floor
rate random walk    K^2 tau / 3                             K
Gauss-Markov        2 s^2 / x (1 - (3 - 4 e^-x + e^-2x)     standard deviation s, correlation time T, x = tau / T (eq. C.24)
                    / (2 x))
==================  ======================================  ===========================================================

The fit is by least squares of the logarithm of the variance, weighted with the covariance of the estimates. Which slow term
there is, if any, the data decide: a term is taken if it improves the fit by more than `WORTH`. The bounds of a figure are where
the best fit with that figure is worse by 3.84 (95 %), all other figures being adjusted; an upper bound may be infinite.  That
of a walk counts a Gauss-Markov bias that begins as the walk, which may fit better, by less than `TIME_WORTH`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import chi2

from insenv.base.installing import need
from insenv.core.tables import Array

# The Allan deviation of a rate, and how far it can be trusted: its statistics for the fit of noise terms.
#
# The deviation is that of the package allantools. The estimates at averaging times a factor of 2 apart are correlated by about
# 0.5, because they are made of the same samples; the fit needs these correlations. They follow from the spectra: an Allan
# variance is the integral of the power spectrum S(f) times |H(f)|^2 = 2 sin^4(pi f tau) / (pi f tau)^2 (IEEE Std 952-1997,
# eq. C.3), and two of them have a covariance proportional to the integral of the product of both integrands.

LONGEST_PART = 4
"""The longest averaging time is the duration over this: there the estimate has about 4 degrees of freedom."""
_EXPONENTS = (2, 1, 0, -1, -2)
"""Exponents of f in the spectrum of the rate; the slope of the Allan variance is -2, -2, -1, 0, 1."""
_FREQUENCIES = 20000
FEW = 64
"""Averaging times in a log below which its ends count."""


def allantools() -> ModuleType:
    """The package allantools.  Raises `InputError` if it is not installed."""
    need("an Allan deviation", "allantools", extra="workbench")
    import allantools as module

    return module


@dataclass(frozen=True)
class Curve:
    """Overlapping Allan deviation of one axis.

    samples: number of samples; interval: s; tau (k,): averaging times, s, a factor of 2 apart; deviation (k,): in the unit of
    the rate; impulses (k,): mean square of the differences behind the estimate over the square of their typical size, 1 for
    Gaussian noise and much more with knocks or steps; axes: number of sensors whose mean variance this is.
    """

    samples: int
    interval: float
    tau: Array
    deviation: Array
    impulses: Array
    axes: int = 1

    @property
    def variance(self) -> Array:
        """Allan variance (k,)."""
        return self.deviation**2


def octaves(samples: int) -> NDArray[np.int64]:
    """Averaging times in samples, a factor of 2 apart."""
    return 2 ** np.arange(int(np.log2(samples // LONGEST_PART)) + 1)


def deviation(rate: Array, interval: float, sizes: NDArray[np.int64]) -> Array:
    """Overlapping Allan deviation (k,) of a rate (n,) at averaging times of `sizes` samples of `interval` (s)."""
    computed = allantools().oadev(rate - rate.mean(), rate=1.0 / interval, data_type="freq", taus=sizes * interval)
    return np.asarray(computed[1], dtype=np.float64)


def curve(rate: Array, interval: float) -> Curve:
    """The curve of a rate (n,), 64 samples or more."""
    sizes = octaves(len(rate))
    impulses = np.array([_impulses(rate, int(size)) for size in sizes])
    tau = np.asarray(sizes * interval, dtype=np.float64)
    return Curve(len(rate), interval, tau, deviation(rate, interval, sizes), impulses)


def _impulses(rate: Array, size: int) -> float:
    """Mean square of the differences of neighbouring means of `size` samples over that of Gaussian ones of their mean size."""
    count = len(rate) // size
    difference = np.diff(rate[: count * size].reshape(count, size).mean(axis=1))
    typical = float(np.mean(np.abs(difference))) * float(np.sqrt(0.5 * np.pi))
    return float(np.mean(difference**2)) / typical**2 if typical > 0.0 else 1.0


@dataclass(frozen=True)
class Spread:
    """Statistics of log(estimated over true Allan variance): mean (k,) and covariance (k, k); freedom (k,): the degrees of
    freedom of each estimate."""

    mean: Array
    covariance: Array
    freedom: Array


def spread(curve: Curve, tau: Array, variance: Callable[[Array], Array], spectrum: Callable[[Array], Array]) -> Spread:
    """The statistics of the estimates at `tau` for noise of this Allan variance (function of tau, s) and spectrum (of f, Hz).

    An overlapping estimate is the mean of n - 2 m + 1 squares, whose degrees of freedom follow from the same spectrum:
    (integral)^2 over the integral of the square, times their number over the Nyquist frequency.  Where the log has few
    averaging times, the ends count: there they are those of Greenhall and Riley, "Uncertainty of stability variances based on
    finite differences", PTTI 2003, as allantools has them, for the local slope of the curve.  At one sample of white noise
    these are 20 % too many.
    """
    slope = np.log(variance(tau * 1.1) / variance(tau / 1.1)) / np.log(1.21)
    sizes = np.rint(tau / curve.interval).astype(int)
    nyquist = 0.5 / curve.interval
    frequency = np.geomspace(0.02 / tau[-1], nyquist, _FREQUENCIES)
    of_samples = np.sin(np.pi * frequency * curve.interval) / (np.pi * curve.interval)  # of a difference of samples
    window = 2.0 * np.sin(np.pi * frequency * tau[:, None]) ** 4 / (np.pi * of_samples * tau[:, None]) ** 2
    power = window * spectrum(of_samples) * np.sqrt(frequency)  # df = f dlog(f), for each half
    product = power @ power.T
    size = np.sqrt(np.diag(product))
    width = float(np.log(frequency[1] / frequency[0]))
    of_spectrum = (curve.samples - 2 * sizes + 1) * width * (power @ np.sqrt(frequency)) ** 2 / size**2 / nyquist
    of_slope = [
        edf if size * FEW <= curve.samples else _freedom(local, size, curve.samples)
        for local, size, edf in zip(slope, sizes.tolist(), of_spectrum.tolist(), strict=True)
    ]
    freedom = curve.axes * np.array(of_slope)
    sigma = np.sqrt(polygamma(1, 0.5 * freedom))
    correlation = product / np.outer(size, size)
    return Spread(digamma(0.5 * freedom) - np.log(0.5 * freedom), correlation * np.outer(sigma, sigma), freedom)


def _freedom(slope: float, size: int, samples: int) -> float:
    """Degrees of freedom of the estimate where the Allan variance has this slope, between those of the pure noises."""
    exponent = float(np.clip(-1.0 - slope if slope > -1.0 else 2.0 * (-1.0 - slope), -2.0, 2.0))
    at = [float(allantools().edf_greenhall(each, 2, size, samples + 1, overlapping=True)) for each in _EXPONENTS]
    return float(np.exp(np.interp(exponent, _EXPONENTS[::-1], np.log(at[::-1]))))


QUANTIZATION, WHITE, FLICKER, WALK, MARKOV = "quantization", "white", "flicker", "rate_random_walk", "markov"
TIME = "markov_time"
"""Name of the correlation time of the Gauss-Markov term."""
WORTH = 7.0
"""Improvement of the weighted sum of squares that a further figure must bring: 0.8 % of pure noise does."""
TIME_WORTH = 2.0
"""The same for the correlation time of a bias that has been seen: a walk without end is the stronger claim."""
CHI_SQUARE = 3.841
"""95 % of a chi-square variable of one degree of freedom."""
STEPS = 80
"""Steps of a descent, at most."""
MODEL_ERROR = 0.02
"""Error of the logarithm of the variance that the model itself is granted, 1 % of a deviation, where the terms do not explain
the curve as well as its statistics are known."""
EXPLAINED = 0.99
"""Share of the curves of such terms that differ less from their fit than one that they explain."""
_SLOW: tuple[tuple[str, ...], ...] = ((), (FLICKER,), (WALK,), (MARKOV,), (FLICKER, WALK))
_POWERS = {QUANTIZATION: (3.0, -2), WHITE: (1.0, -1), FLICKER: (1.0, 0), WALK: (1.0 / 3.0, 1)}


def markov_variance(tau: Array, time: float) -> Array:
    """Allan variance of a Gauss-Markov process of unit variance (IEEE Std 952-1997, eq. C.24)."""
    x = np.asarray(tau) / time
    # the closed form cancels below x = 1e-3; the series is exact there
    small = 2.0 * x / 3.0 - 0.5 * x**2 + 7.0 / 30.0 * x**3
    with np.errstate(divide="ignore", invalid="ignore"):
        full = 2.0 / x * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x))
    return np.where(x < 1e-3, small, full)


@dataclass(frozen=True)
class Figure:
    """A fitted figure and its bounds (95 %), in the units of the rate; high may be infinite, low 0."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Terms:
    """The noise terms of one axis.

    figures: by name (`QUANTIZATION` ... `TIME`), in SI; a name that is missing was not seen. upper: upper bounds (95 %) of the
    terms that were not seen. residual (k,): logarithm of observed over fitted variance in standard deviations, at the times of
    the fit; NaN for those left out.
    """

    figures: Mapping[str, Figure]
    upper: Mapping[str, float]
    residual: Array = field(repr=False)
    freedom: Array = field(repr=False)

    def variance(self, tau: Array) -> Array:
        """The fitted Allan variance."""
        return total({name: figure.value for name, figure in self.figures.items()}, tau)

    def one(self, name: str, tau: Array) -> Array:
        """The Allan variance of one term."""
        names = (MARKOV, TIME) if name == MARKOV else (name,)
        return total({each: self.figures[each].value for each in names}, tau)

    @property
    def slow(self) -> tuple[str, ...]:
        """The terms of the bias."""
        return tuple(name for name in (FLICKER, WALK, MARKOV) if name in self.figures)


def total(values: Mapping[str, float], tau: Array) -> Array:
    """Allan variance of terms with these figures."""
    variance = np.zeros(np.shape(tau))
    for name, value in values.items():
        if name in _POWERS:
            factor, power = _POWERS[name]
            variance = variance + factor * value**2 * np.asarray(tau) ** power
        elif name == MARKOV:
            variance = variance + value**2 * markov_variance(tau, values[TIME])
    return variance


def spectrum(values: Mapping[str, float], interval: float, frequency: Array) -> Array:
    """One-sided power spectrum of the rate in samples of `interval` (s), in units of the white term's 2 N^2."""
    omega = 2.0 * np.pi * frequency
    power = np.zeros(np.shape(frequency))
    for name, value in values.items():
        square = value**2
        if name == QUANTIZATION:
            power = power + 2.0 * square * interval * omega**2
        elif name == WHITE:
            power = power + 2.0 * square
        elif name == FLICKER:
            power = power + square / (2.0 * np.log(2.0)) / frequency
        elif name == WALK:
            power = power + 2.0 * square / omega**2
        elif name == MARKOV:
            power = power + 4.0 * square * values[TIME] / (1.0 + (omega * values[TIME]) ** 2)
    return power


def fit(curve: Curve, use: NDArray[np.bool_] | None = None) -> Terms:
    """The noise terms of a curve.  use (k,): the averaging times that count; all if None."""
    use = np.ones(len(curve.tau), bool) if use is None else use
    tau, seen = curve.tau[use], curve.variance[use]
    white = {WHITE: float(np.sqrt(seen[0] * tau[0]))}
    best = white | {FLICKER: float(np.sqrt(seen.min())) * 0.5}
    for _ in range(2):  # the statistics are those of the noise that is fitted
        now = dict(best)
        statistics = spread(curve, tau, partial(total, now), partial(spectrum, now, curve.interval))
        problem = _Problem(tau, np.log(seen) - statistics.mean, statistics, curve.samples * curve.interval)
        best = problem.chosen(white)
    exact = _Problem(tau, problem.seen, statistics, problem.duration, model_error=0.0)
    cost, closer = exact.best(best)
    if cost <= chi2.ppf(EXPLAINED, len(tau) - len(best)):
        problem, best = exact, closer
    figures = {name: problem.bounded(best, name) for name in best}
    upper = {name: problem.upper(best, name) for name in (QUANTIZATION, FLICKER, WALK) if name not in best}
    if figures[WHITE].low == 0.0:  # of every fit, and so the only term whose bounds can hold 0: it was not seen
        upper[WHITE] = figures.pop(WHITE).high
    residual, freedom = np.full(len(use), np.nan), np.full(len(use), np.nan)
    sigma = np.sqrt(np.diag(problem.covariance))
    residual[use] = (problem.seen - np.log(total(best, tau))) / sigma
    freedom[use] = statistics.freedom
    return Terms(figures, upper, residual, freedom)


def _descended(
    differences: Callable[[Array], Array], slopes: Callable[[Array], Array], at: Array, low: Array, high: Array
) -> tuple[Array, float]:
    """The point within bounds with the least sum of squares, and this sum: Levenberg and Marquardt's steps, clipped.

    SciPy's solvers take milliseconds for problems of this size, and a fit asks for some hundred.
    """
    damping, residual = 1e-3, differences(at)
    cost = float(residual @ residual)
    for _ in range(STEPS):
        jacobian = slopes(at)
        free = ((at > low) | (jacobian.T @ residual < 0.0)) & ((at < high) | (jacobian.T @ residual > 0.0))
        if not free.any():
            break
        inner = jacobian[:, free]
        normal, gradient = inner.T @ inner, inner.T @ residual
        while True:
            step = np.zeros(len(at))
            step[free] = -np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), gradient)
            trial = np.clip(at + np.clip(step, -3.0, 3.0), low, high)
            tried = differences(trial)
            lower = float(tried @ tried)
            if lower < cost or damping > 1e9:
                break
            damping *= 8.0
        if lower >= cost:
            break
        gained, at, residual, cost, damping = cost - lower, trial, tried, lower, damping / 8.0
        if gained < 1e-9 * (1.0 + cost):
            break
    return at, cost


class _Problem:
    """The weighted least squares of one curve."""

    def __init__(self, tau: Array, seen: Array, statistics: Spread, duration: float, model_error: float = MODEL_ERROR) -> None:
        self.tau, self.seen, self.duration = tau, seen, duration
        self.covariance = statistics.covariance + model_error**2 * np.eye(len(tau))

    @property
    def longest(self) -> float:
        """The longest correlation time of the fit, s: a thousand times the duration, which no curve tells from a walk."""
        return 1e3 * self.duration

    @cached_property
    def _whitening(self) -> Array:
        return np.linalg.inv(np.linalg.cholesky(self.covariance))

    def cost(self, values: Mapping[str, float]) -> float:
        """The weighted sum of squares."""
        return float(np.sum((self._whitening @ (self.seen - np.log(total(values, self.tau)))) ** 2))

    def best(self, start: Mapping[str, float], fixed: Mapping[str, float] | None = None) -> tuple[float, dict[str, float]]:
        """The least cost and its figures; those of `fixed` stay."""
        fixed = dict(fixed or {})
        names = [name for name in start if name not in fixed]
        if not names:
            return self.cost(fixed), fixed
        lowest = np.log(np.sqrt(np.exp(self.seen.min()))) - 12.0
        low = np.array([np.log(2.0 * self.tau[0]) if name == TIME else lowest - 12.0 for name in names])
        high = np.array([np.log(self.longest) if name == TIME else lowest + 40.0 for name in names])

        def values(at: Array) -> dict[str, float]:
            return {**dict(zip(names, np.exp(at).tolist(), strict=True)), **fixed}

        def differences(at: Array) -> Array:
            return self._whitening @ (self.seen - np.log(total(values(at), self.tau)))

        def slopes(at: Array) -> Array:
            now = values(at)
            whole, columns = total(now, self.tau), []
            for name in names:
                if name == TIME:
                    later = total({**now, TIME: now[TIME] * 1.0001}, self.tau)
                    columns.append(np.log(later / whole) / np.log(1.0001))
                else:
                    part = (MARKOV, TIME) if name == MARKOV else (name,)
                    columns.append(2.0 * total({each: now[each] for each in part}, self.tau) / whole)
            return np.asarray(-self._whitening @ np.column_stack(columns))

        first = np.clip(np.log([start[name] for name in names]), low, high)
        logs, cost = _descended(differences, slopes, first, low, high)
        return cost, values(logs)

    def chosen(self, white: Mapping[str, float]) -> dict[str, float]:
        """The figures of the terms that the curve shows."""
        starts = self._starts(white)
        trials: list[tuple[float, dict[str, float]]] = []
        steep = self.seen[0] - self.seen[1] > 1.02 * np.log(2.0)
        for fast in ((), (QUANTIZATION,)) if steep else ((),):
            for slow in _SLOW:
                names = (WHITE, *fast, *slow, *((TIME,) if MARKOV in slow else ()))
                times = self._times() if MARKOV in slow else (1.0,)
                cheapest = min(
                    (self.best({name: starts[name] if name != TIME else time for name in names}) for time in times),
                    key=lambda one: one[0],
                )
                price = sum(TIME_WORTH if name == TIME else WORTH for name in names)
                trials.append((cheapest[0] + price, cheapest[1]))
        best = min(trials, key=lambda one: one[0])[1]
        if best.get(TIME, 0.0) > self.duration:  # all of the curve is the walk with which such a bias begins
            walk = best[MARKOV] * float(np.sqrt(2.0 / best[TIME]))
            others = {name: value for name, value in best.items() if name not in (MARKOV, TIME)}
            return self.best({**others, WALK: walk})[1]
        return best

    def _times(self) -> Sequence[float]:
        """Correlation times from which the fit starts."""
        return tuple(np.geomspace(10.0 * self.tau[0], self.duration, 4).tolist())

    def _starts(self, white: Mapping[str, float]) -> dict[str, float]:
        last, low = float(np.exp(0.5 * self.seen[-1])), float(np.exp(0.5 * self.seen.min()))
        return {
            **white,
            QUANTIZATION: float(np.exp(0.5 * self.seen[0])) * self.tau[0] / 3.0,
            FLICKER: low,
            WALK: last * np.sqrt(3.0 / self.tau[-1]),
            MARKOV: last,
        }

    def bounded(self, best: Mapping[str, float], name: str) -> Figure:
        """A figure with its bounds."""
        least, value = self.cost(best), best[name]
        alone = name == WALK and FLICKER not in best

        def excess(log: float) -> float:
            fixed = float(np.exp(log))
            cost = self.best(best, {name: fixed})[0]
            if alone and fixed > value:  # the walk was taken although such a bias may fit better, by less than its price
                cost = min(cost, self._as_markov(best, fixed) - TIME_WORTH)
            return cost - least - CHI_SQUARE

        low, high = (self._crossing(excess, np.log(value), sign) for sign in (-1.0, 1.0))
        if high is not None and self.best(best, {name: float(np.exp(high))})[1].get(TIME, 0.0) > 0.99 * self.longest:
            high = None  # a walk without end, which is worse only because the fit ends its times there
        return Figure(value, 0.0 if low is None else float(np.exp(low)), np.inf if high is None else float(np.exp(high)))

    def _as_markov(self, best: Mapping[str, float], walk: float) -> float:
        """The least cost with a bias that begins as this walk and ends it at any time: a log does not tell them apart."""
        others = {name: value for name, value in best.items() if name != WALK}
        return min(
            self.best(others, {MARKOV: walk * float(np.sqrt(time / 2.0)), TIME: time})[0]
            for time in np.geomspace(10.0 * self.tau[0], 10.0 * self.duration, 12).tolist()
        )

    def upper(self, best: Mapping[str, float], name: str) -> float:
        """Upper bound of the figure of a term that the fit has not, beside the slow terms that it has or in place of them."""
        start = self._starts({WHITE: best[WHITE]})[name] * 1e-3
        instead = {each: value for each, value in best.items() if name == QUANTIZATION or each in (WHITE, QUANTIZATION)}

        def excess(log: float) -> float:
            fixed = {name: float(np.exp(log))}
            return min(self.best(one, fixed)[0] for one in (best, instead)) - self.cost(best) - CHI_SQUARE

        high = self._crossing(excess, np.log(start), 1.0)
        return np.inf if high is None else float(np.exp(high))

    @staticmethod
    def _crossing(excess: object, start: float, sign: float) -> float | None:
        """Where the excess becomes positive, from `start` in one direction; None if it does not."""
        assert callable(excess)
        step, inside = 0.05, start
        for _ in range(12):
            outside = inside + sign * step
            if excess(outside) > 0.0:
                return float(brentq(excess, inside, outside, xtol=3e-3)) if excess(inside) < 0.0 else inside
            inside, step = outside, 1.7 * step
        return None
