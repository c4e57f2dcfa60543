"""The Allan deviation of a rate, and how far it can be trusted: its statistics for the fit of noise terms.

The deviation is that of the package allantools. The estimates at averaging times a factor of 2 apart are correlated by about
0.5, because they are made of the same samples; the fit needs these correlations. They follow from the spectra: an Allan
variance is the integral of the power spectrum S(f) times |H(f)|^2 = 2 sin^4(pi f tau) / (pi f tau)^2 (IEEE Std 952-1997,
eq. C.3), and two of them have a covariance proportional to the integral of the product of both integrands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from insenv.base.installing import need

Array = NDArray[np.float64]

LONGEST_PART = 4
"""The longest averaging time is the duration over this: there the estimate has about 4 degrees of freedom."""
_EXPONENTS = (2, 1, 0, -1, -2)
"""Exponents of f in the spectrum of the rate; the slope of the Allan variance is -2, -2, -1, 0, 1."""
_FREQUENCIES = 20000


def allantools() -> ModuleType:
    """The package allantools.  Raises `InputError` if it is not installed."""
    need("an Allan deviation", "allantools", extra="workbench")
    import allantools as found

    return found


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
    found = allantools().oadev(rate - rate.mean(), rate=1.0 / interval, data_type="freq", taus=sizes * interval)
    return np.asarray(found[1], dtype=np.float64)


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

    The degrees of freedom are those of Greenhall and Riley, "Uncertainty of stability variances based on finite
    differences", PTTI 2003, as allantools has them, for the local slope of the curve.
    """
    slope = np.log(variance(tau * 1.1) / variance(tau / 1.1)) / np.log(1.21)
    sizes = np.rint(tau / curve.interval).astype(int)
    freedom = curve.axes * np.array([_freedom(s, int(m), curve.samples) for s, m in zip(slope, sizes, strict=True)])
    frequency = np.geomspace(0.02 / tau[-1], 0.5 / curve.interval, _FREQUENCIES)
    phase = np.pi * frequency * tau[:, None]
    power = 2.0 * np.sin(phase) ** 4 / phase**2 * spectrum(frequency) * np.sqrt(frequency)  # df = f dlog(f), for each half
    product = power @ power.T
    size = np.sqrt(np.diag(product))
    sigma = np.sqrt(polygamma(1, 0.5 * freedom))
    correlation = product / np.outer(size, size)
    return Spread(digamma(0.5 * freedom) - np.log(0.5 * freedom), correlation * np.outer(sigma, sigma), freedom)


def _freedom(slope: float, size: int, samples: int) -> float:
    """Degrees of freedom of the estimate where the Allan variance has this slope, between those of the pure noises."""
    exponent = float(np.clip(-1.0 - slope if slope > -1.0 else 2.0 * (-1.0 - slope), -2.0, 2.0))
    at = [float(allantools().edf_greenhall(each, 2, size, samples + 1, overlapping=True)) for each in _EXPONENTS]
    return float(np.exp(np.interp(exponent, _EXPONENTS[::-1], np.log(at[::-1]))))
