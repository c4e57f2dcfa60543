"""Quantiles of the chi-square distribution: against SciPy's inverse of the incomplete gamma function."""

import numpy as np
import pytest
from scipy.special import gammaincinv

from insenv.evaluation.chi_square import bound_polynomial, quantile

PROBABILITIES = np.array([1e-6, 1e-3, 0.025, 0.3, 0.5, 0.84, 0.975, 0.999, 1 - 1e-6])


@pytest.mark.parametrize("degrees", [0.5, 1.0, 2.0, 3.7, 19.9, 20.1, 216.0, 5432.1, 1e6])
def test_quantiles_and_their_polynomial(degrees):
    expected = 2.0 * gammaincinv(degrees / 2.0, PROBABILITIES)
    assert quantile(PROBABILITIES, degrees) == pytest.approx(expected, rel=1e-11)
    for probability in (0.025, 0.975):
        root = np.polynomial.polynomial.polyval(degrees**-0.5, bound_polynomial(probability))
        close = 1e-8 if degrees >= 2.0 else 3e-7
        assert degrees * root**3 == pytest.approx(quantile(probability, degrees), rel=close)
