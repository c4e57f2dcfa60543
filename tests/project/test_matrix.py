"""The table of every estimator on every scenario: shares beyond three sigmas, and the part of the page that it writes."""

from dataclasses import replace

import matrix
import numpy as np
import pytest


def judged(error, sigma=None, estimator="qakf", scenario="car-parked"):
    error = np.array(error)
    sigma = np.ones_like(error) if sigma is None else sigma
    return matrix.Judged(scenario, estimator, np.arange(error.shape[1]) * 1.0, error, sigma, {"roll_deg": 2.0}, ())


def test_the_share_is_that_of_the_worst_component_with_the_scatter_between_runs():
    error = np.zeros((4, 10, 3))
    error[0, :, 1] = 3.1  # one run of four, throughout
    error[1, :2, 0] = -4.0
    share, scatter = judged(error).beyond(0)
    assert share == pytest.approx(0.25) and scatter == pytest.approx(np.std([1, 0, 0, 0], ddof=1) / 2)
    assert judged(error).beyond(3) is None
    assert judged(error, np.full((4, 10, 3), 2.0)).beyond(0) == (0.0, 0.0)
    assert replace(judged(error), unjudged=("roll_deg", "pitch_deg")).beyond(0) == (0.0, 0.0)
