"""Quantiles of the chi-square distribution, without the import of the whole of scipy.stats, which takes half a second."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike


def quantile(probability: ArrayLike, degrees: float) -> Any:
    """The value below which a chi-square of so many degrees of freedom lies with the given probabilities.

    Abramowitz and Stegun 1964, eq. 26.4.19: P(chi^2 | n) is the regularised incomplete gamma function P(n/2, chi^2/2).
    """
    from scipy.special import gammaincinv

    return 2.0 * gammaincinv(degrees / 2.0, probability)
