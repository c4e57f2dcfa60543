"""A drift that is not known turns the level: standing still shows no heading and no level to coarse gyros."""

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed

import insenv
from insenv.core import symmetric
from insenv.estimators.parts.error_model import by_unknown_drift


def test_the_rate_is_the_variance_of_the_level_times_the_drift_about_down():
    """A drift of 0.02 rad/s about down turns levels of 0.03 and 0.05 rad."""
    down = np.array([0.6, 0.0, 0.8])
    P = np.zeros((9, 9))
    P[2, 2], P[3, 3] = 0.03**2, 0.05**2
    P[6:, 6:] = 0.02**2 * np.outer(down, down) + 0.7**2 * np.outer([0.8, 0.0, -0.6], [0.8, 0.0, -0.6])
    rate = by_unknown_drift(ca.DM(symmetric.triangle(ca.DM(P))), ca.DM(down), slice(2, 5), slice(6, 9))
    assert np.asarray(rate).ravel() == pytest.approx(np.array([1, 1, 0]) * 0.02 * (0.03**2 + 0.05**2) / 2)


@pytest.mark.slow
def test_a_car_that_stands_learns_no_heading_from_gyros_that_turn_it():
    """NEES of 9 states, 24 runs: 16 where the turn of the level by the drift does not count, with 6 deg of heading at 2.9."""
    scenario = changed("car-city-drive", imu={"grade": "industrial"})
    summary = insenv.campaign(scenario, "fusion", 24, seed=451000, duration_s=30.0)
    late, heading = summary.time > 15.0, summary.courses["heading_deg"]
    assert 7.0 < np.mean(summary.nees.mean[late]) < 11.5
    assert 0.8 < np.sqrt(np.mean(heading.rms[late] ** 2) / np.mean(heading.stated[late] ** 2)) < 1.5
