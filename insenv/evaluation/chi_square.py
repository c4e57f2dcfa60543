"""Quantiles of the chi-square distribution in plain Python: to import SciPy's takes longer than a whole short run."""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

POLYNOMIAL_FROM = 0.5
"""Degrees of freedom from which `bound_polynomial` holds."""
_DEGREE = 20
_STIRLING = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188, -691 / 360360, 1 / 156)
_LARGE = 10.0
"""Argument from which Stirling's series with these terms is exact."""


def quantile(probability: ArrayLike, degrees: float) -> Any:
    """The value below which a chi-square of so many degrees of freedom lies with these probabilities, each within (0, 1).

    Abramowitz and Stegun 1964, eq. 26.4.19: P(chi^2 | n) is the regularised incomplete gamma function P(n/2, chi^2/2).
    """
    values = [2.0 * _inverse(float(each), degrees / 2.0) for each in np.ravel(probability)]
    return np.reshape(values, np.shape(probability))[()]


def _inverse(probability: float, a: float) -> float:
    """The x at which P(a, x) is the probability, by Newton's method from Wilson and Hilferty's approximation (26.4.17)."""
    third = 1.0 / (9.0 * a)
    x = a * max(1.0 - third + NormalDist().inv_cdf(probability) * math.sqrt(third), 0.0) ** 3
    x = max(x, math.exp((math.log(probability) + math.lgamma(a + 1.0)) / a))  # P(a, x) < x^a / Gamma(a + 1)
    for _ in range(100):
        lower, upper, density = _incomplete(a, x)
        # the smaller of the two shares is the one without cancellation
        error = lower - probability if lower <= upper else (1.0 - probability) - upper
        step = error / density
        step /= max(1.0 - 0.5 * step * ((a - 1.0) / x - 1.0), 0.5)  # Halley's correction
        x = max(x - step, 0.1 * x)
        if abs(step) <= 4e-16 * x:
            break
    return x


def _incomplete(a: float, x: float) -> tuple[float, float, float]:
    """P(a, x), 1 - P(a, x) and the density dP/dx: the series 6.5.29 below the mean, the continued fraction 6.5.31 above it."""
    factor = _power(a, x)  # x^a exp(-x) / Gamma(a)
    if x < a + 1.0:
        term = total = 1.0 / a
        k = a
        while term > 1e-17 * total:
            k += 1.0
            term *= x / k
            total += term
        share = factor * total
        return share, 1.0 - share, factor / x
    b = x + 1.0 - a
    c, d = 1e300, 1.0 / b
    fraction, n, change = d, 0, 0.0
    while abs(change - 1.0) > 1e-16 and n < 100000:  # Lentz's method
        n += 1
        b += 2.0
        numerator = n * (a - n)
        d = 1.0 / (numerator * d + b)
        c = b + numerator / c
        change = c * d
        fraction *= change
    share = factor * fraction
    return 1.0 - share, share, factor / x


def _power(a: float, x: float) -> float:
    """x^a exp(-x) / Gamma(a), without the loss of digits that large exponents bring."""
    if a < _LARGE:
        return math.exp(a * math.log(x) - x - math.lgamma(a))
    excess = (x - a) / a
    rest = sum(c * a ** -(2 * k + 1) for k, c in enumerate(_STIRLING))
    return math.sqrt(a / (2.0 * math.pi)) * math.exp(a * (math.log1p(excess) - excess) - rest)


@lru_cache
def bound_polynomial(probability: float) -> tuple[float, ...]:
    """Coefficients c of sum c[k] n^(-k/2), the cube root of the quantile over the degrees of freedom n >= `POLYNOMIAL_FROM`.

    For those who have no incomplete gamma function (a live page): good to 3e-7 of the quantile, 1e-8 from n = 2 on.  The cube
    root is nearly normal (Wilson and Hilferty: Abramowitz and Stegun 1964, eq. 26.4.17), so it is smooth in n^(-1/2).
    """
    from numpy.polynomial import Chebyshev, Polynomial

    def root(inverse: Any) -> Any:
        return [np.cbrt(quantile(probability, one**-2) * one**2) for one in inverse]

    made = Chebyshev.interpolate(root, _DEGREE, domain=[0.0, POLYNOMIAL_FROM**-0.5])
    return tuple(made.convert(kind=Polynomial).coef.tolist())
