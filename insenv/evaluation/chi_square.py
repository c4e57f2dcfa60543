"""Quantiles of the chi-square distribution, without the import of the whole of scipy.stats, which takes half a second."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

LEAST_DEGREES = 0.5
"""Degrees of freedom from which `bound_polynomial` holds."""
_DEGREE = 20


def quantile(probability: ArrayLike, degrees: float) -> Any:
    """The value below which a chi-square of so many degrees of freedom lies with the given probabilities.

    Abramowitz and Stegun 1964, eq. 26.4.19: P(chi^2 | n) is the regularised incomplete gamma function P(n/2, chi^2/2).
    """
    from scipy.special import gammaincinv

    return 2.0 * gammaincinv(degrees / 2.0, probability)


@lru_cache
def bound_polynomial(probability: float) -> tuple[float, ...]:
    """Coefficients c of sum c[k] n^(-k/2), the cube root of the quantile over the degrees of freedom n >= `LEAST_DEGREES`.

    For those who have no incomplete gamma function (a live page): good to 3e-7 of the quantile, 1e-8 from n = 2 on.  The cube
    root is nearly normal (Wilson and Hilferty: Abramowitz and Stegun 1964, eq. 26.4.17), so it is smooth in n^(-1/2).
    """
    from numpy.polynomial import Chebyshev, Polynomial

    def root(inverse: Any) -> Any:
        return [np.cbrt(quantile(probability, one**-2) * one**2) for one in inverse]

    made = Chebyshev.interpolate(root, _DEGREE, domain=[0.0, LEAST_DEGREES**-0.5])
    return tuple(made.convert(kind=Polynomial).coef.tolist())
