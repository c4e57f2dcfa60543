"""The passes of a smoother begin again at the start that the run itself tells."""

import numpy as np
import pytest
from changed_scenario import changed

import insenv
from insenv.runs import smoothed
from insenv.runs.second_pass import astray, second_order, told_start


def test_a_start_is_told_its_smoothed_attitude_and_what_comes_with_it():
    """A measurement of the attitude to ten of its smoothed deviations and what a first order leaves out."""
    rng = np.random.default_rng(5)
    scale = np.array([1e-3, 1.0, 1e3, 1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-1, 1e-6])
    A, H = rng.normal(size=(10, 10)), rng.normal(size=(4, 10)) / scale
    P = A @ A.T * np.outer(scale, scale)
    prior = np.linalg.inv(P)
    R = np.linalg.inv(prior + 1e4 * H.T @ H)
    d = R @ H.T @ np.array([300.0, -200.0, 100.0, 50.0])
    error, covariance = told_start(P, prior @ d, prior @ (P - R) @ prior)
    told = np.zeros((10, 10))
    told[6:9, 6:9] = np.linalg.inv(100.0 * R[6:9, 6:9] + (d[6:9] @ d[6:9] / 2.0) ** 2 * np.eye(3))
    expected = np.linalg.inv(prior + told)
    sigma = np.sqrt(np.diag(expected))
    assert np.abs((covariance - expected) / np.outer(sigma, sigma)).max() < 1e-8
    assert np.abs((error - expected @ told @ d) / sigma).max() < 1e-6


def test_a_run_is_astray_where_a_first_order_leaves_out_a_third_of_a_stated_deviation():
    sigma, velocity_sigma = np.full((3, 3), 1e-3), np.array([[1.0, 1.0, 1.0], [0.1, 0.02, 0.1], [1e-4, 1e-4, 1e-4]])
    psi, speed = np.array([0.0, 0.015, 0.02]), np.array([100.0, 20.0, 0.0])
    assert second_order(psi) == pytest.approx(0.0003125)
    assert not astray(psi, speed, sigma, velocity_sigma)
    assert astray(psi, speed, 0.9 * sigma, velocity_sigma)
    assert not astray(psi, 1.06 * speed, sigma, velocity_sigma)
    assert astray(psi, 1.08 * speed, sigma, velocity_sigma)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("id", "scenario"),
    [
        (
            "fusion-smoother",
            changed(
                "car-city-drive", duration_s=50.0, knowledge={"heading_sigma_deg": 2.84, "heading_error_deg": 5.4},
                gnss={"grade": "rtk", "interval_s": 1.0, "outages_s": [[20.0, 45.0]]},
            ),
        ),
        ("smoother", changed("aircraft-survey", duration_s=600.0)),
        ("smoother", "aircraft-inflight-alignment"),
    ],
)  # fmt: skip
def test_from_a_start_degrees_off_the_stated_deviations_hold_from_its_first_second_on(id, scenario, monkeypatch):
    """By one pass the car's velocity is tens of its stated deviations off as it departs, and the aircraft's level at first; the
    last one is 20 deg of level and 60 deg of heading off.
    """

    def largest():
        run = insenv.run(scenario, id, seed=3).results[0]
        assert ("start-not-reached" in run.health.contradicted) == (smoothed.PASSES == 1)
        return max(np.abs(run.errors[name] / run.sigma[name]).max() for name in run.sigma)

    assert largest() < 5.0
    monkeypatch.setattr(smoothed, "PASSES", 1)
    assert largest() > 12.0
