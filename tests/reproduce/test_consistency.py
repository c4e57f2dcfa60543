"""NEES over 56 seeds: filters that model their errors are consistent, one that ignores a correlated error is not."""

from dataclasses import replace

import numpy as np
import pytest
from consistency import WANDER_IGNORED, WHITE_FIXES, bounds, measure
from scipy.stats import chi2, norm


def test_bounds_are_those_of_the_normal_distribution_for_many():
    low, high = bounds(3, 4000)
    expected = norm.ppf(0.975) * np.sqrt(2 / 12000)
    assert low == pytest.approx(1 - expected, abs=1e-3) and high == pytest.approx(1 + expected, abs=1e-3)
    assert bounds(1, 1)[1] == pytest.approx(chi2.ppf(0.975, 1))


@pytest.mark.slow
def test_loosely_coupled_is_consistent():
    """Position, velocity and attitude, with outages, after the start's transient."""
    found = measure(replace(WHITE_FIXES, duration_s=460.0, from_s=60.0))
    assert found.degrees == 9 and found.nees.shape[0] == 56
    assert found.inside >= 0.9
    assert 0.9 < found.mean.mean() < 1.1


@pytest.mark.slow
def test_a_filter_that_assumes_white_fixes_is_detected_when_they_wander():
    found = measure(replace(WANDER_IGNORED, duration_s=200.0, runs=6))
    assert found.nees.shape[0] == 6
    assert found.inside < 0.1 and found.mean.mean() > 3
