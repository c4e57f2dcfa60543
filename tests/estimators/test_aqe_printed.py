"""aqe-sukf-printed: its closed sums against the 27 points and weights of the unscented transform."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from insenv import attitude
from insenv.estimators import aqe_printed, get


def transformed(q, P, velocity, distance, spread):
    """Mean (6), covariance (6x6) and mean attitude matrix (3x3) of dC f by points in 13 states, dQ first, NumPy."""
    n, root = 13, np.sqrt(spread)
    whole = np.zeros((n, n))
    whole[:4, :4], whole[4:, 4:] = P, np.diag(np.arange(1.0, 10.0))
    L = np.linalg.cholesky(whole + 1e-18 * np.eye(n))
    points = [np.zeros(n), *[sign * root * L[:, i] for i in range(n) for sign in (1, -1)]]
    weights = np.array([(spread - n) / spread, *[1 / (2 * spread)] * (2 * n)])

    def quadratic(a, b):
        """Y^T(a) U(b): for a = b = q a rotation matrix, for any a and b bilinear."""
        Ya = np.array([[-a[1], -a[2], -a[3]], [a[0], a[3], -a[2]], [-a[3], a[0], a[1]], [a[2], -a[1], a[0]]])
        Ub = np.array([[-b[1], -b[2], -b[3]], [b[0], -b[3], b[2]], [b[3], b[0], -b[1]], [-b[2], b[1], b[0]]])
        return Ya.T @ Ub

    changes = [2 * quadratic(x[:4], q) - quadratic(x[:4], x[:4]) for x in points]
    values = np.array([[*(change @ velocity), *(change @ distance)] for change in changes])
    mean = weights @ values
    covariance = (weights[:, None] * (values - mean)).T @ (values - mean)
    return mean, covariance, quadratic(q, q) - np.tensordot(weights, changes, axes=1)


@pytest.mark.parametrize("spread", [13.0, 3.0, 20.0])
def test_the_sums_are_those_of_27_points(spread):
    rng = np.random.default_rng(8)
    q = attitude.numeric.from_euler(0.3, -0.4, 1.2)
    half = rng.normal(size=(4, 4)) * 0.1
    P, velocity, distance = half @ half.T, rng.normal(size=3) * 9, rng.normal(size=3) * 4
    found = aqe_printed.transform(SimpleNamespace(point_spread=spread))(ca.SX(q), ca.SX(P), ca.SX(velocity), ca.SX(distance))
    G, mean, extra, C = (np.array(ca.DM(each)) for each in (found.G, found.mean, found.extra, found.C))
    expected_mean, expected, expected_C = transformed(q, P, velocity, distance, spread)
    assert np.allclose(mean[:, 0], expected_mean, atol=1e-12)
    assert np.allclose(G @ P @ G.T + extra, expected, atol=1e-10)
    assert np.allclose(C, expected_C, atol=1e-12)


def test_it_says_that_it_is_for_comparison():
    assert "for comparison" in " ".join(get("aqe-sukf-printed").objections({}, 600.0))
