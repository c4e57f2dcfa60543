"""Scatter of slow vectors about a straight line."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from insenv.estimators.parts import scatter


def scattered(vectors):
    """Covariance of vectors (k, 2) about their line, and the line (2, 2)."""
    values = {
        "end_line": ca.DM.zeros(2, 2),
        "end_line_covariance": ca.DM([scatter.FREE, 0, scatter.FREE]),
        "end_square": ca.DM.zeros(2, 2),
        "end_weight": ca.DM(0),
    }
    for vector in vectors:
        values |= scatter.taken(SimpleNamespace(**values), "end", ca.DM(vector))
    return np.array(scatter.covariance(SimpleNamespace(**values), "end")), np.array(values["end_line"])


def test_weighted_least_squares():
    """Beside the closed form over all vectors, before and after the memory is full."""
    noise = np.random.default_rng(3).normal(size=(160, 2)) @ [[1.0, 0.4], [0.0, 0.2]]
    for count in (12, 160):
        k = np.arange(count)
        vectors = np.outer(k, [0.3, -0.1]) + [9.8, 0.0] + noise[:count]
        weights = (1 - 1 / scatter.MEMORY) ** (count - 1 - k)
        fit = np.vander(k - count + 1.0, 2)
        line = np.linalg.solve(fit.T @ (weights[:, None] * fit), fit.T @ (weights[:, None] * vectors))
        left = vectors - fit @ line
        expected = left.T @ (weights[:, None] * left) / (weights.sum() - 2)
        found, through = scattered(vectors)
        assert found == pytest.approx(expected, rel=1e-3)
        assert through[::-1] == pytest.approx(line, rel=1e-3)
    assert not scattered(vectors[:6])[0].any()
