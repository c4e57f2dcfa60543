"""NEES over 56 seeds: filters whose errors are those of their model are consistent; one that is not told is found out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from consistency import WANDER_TOLD, WANDER_UNTOLD, WHITE_FIXES, Case, CaseResult, bounds, measure


def test_bounds_are_those_of_the_normal_distribution_for_many():
    low, high = bounds(3, 4000)
    expected = norm.ppf(0.975) * np.sqrt(2 / 12000)
    assert low == pytest.approx(1 - expected, abs=1e-3) and high == pytest.approx(1 + expected, abs=1e-3)
    assert bounds(1, 1)[1] == pytest.approx(chi2.ppf(0.975, 1))


def test_the_share_inside_is_95_percent_of_a_chi_square_sample_and_little_for_sigmas_a_quarter_too_small():
    rng = np.random.default_rng(3)
    sample = rng.chisquare(9, (50, 2000))
    case = Case("sample", "none", lambda: None, 0.0)
    assert CaseResult(case, np.arange(2000), sample, 9).inside == pytest.approx(0.95, abs=0.02)
    assert CaseResult(case, np.arange(2000), sample * 1.25**2, 9).inside < 0.01


def test_loosely_coupled_is_consistent():
    """Position, velocity and attitude, with outages, after the start's transient."""
    found = measure(replace(WHITE_FIXES, duration_s=460.0, from_s=60.0))
    assert found.degrees == 9 and found.nees.shape[0] == 56
    assert found.inside >= 0.9
    assert 0.9 < found.mean.mean() < 1.1


def test_loosely_coupled_told_of_wandering_fixes_is_consistent():
    """In 280 s the wander (60 s) makes five errors independent of each other: too few for a share of time, but for the mean
    over 56 seeds and nine errors they leave 3 %.
    """
    found = measure(replace(WANDER_TOLD, duration_s=460.0, from_s=180.0))
    assert found.nees.shape[0] == 56
    assert abs(found.mean.mean() - 1.0) < 0.1


def test_a_filter_that_takes_wandering_fixes_for_white_is_found_out():
    found = measure(replace(WANDER_UNTOLD, duration_s=200.0))
    assert found.inside < 0.1
    assert found.mean.mean() > 3


def test_ecef_kf_is_consistent_at_rest():
    found = measure(replace(consistency.CASES[0], duration_s=300.0))
    assert found.case.estimator == "ecef-kf" and found.degrees == 3
    assert found.inside >= 0.9


def test_stated_sigmas_are_judged_where_there_is_no_covariance():
    """q-method on a swaying ship: the sum of the three squares over stated sigmas."""
    found = measure(replace(consistency.CASES[1], duration_s=200.0, from_s=150.0))
    assert found.case.estimator == "q-method" and found.degrees == 3
    assert 0.7 < found.mean.mean() < 1.4
