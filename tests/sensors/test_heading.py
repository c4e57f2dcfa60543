"""The heading of two antennas: azimuth of the baseline, its stated scatter, the check of its length."""

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.stats import binom
from sensor_plant import CHANCE, assert_gauss_markov, assert_variance, attitudes, simulate

from insenv.estimators.fusion.instruments import states_of
from insenv.sensors import registry


def test_it_shows_the_baseline_and_its_azimuth() -> None:
    turned, q_nb = attitudes(60)
    baseline, error = np.array([0.6, -0.8, 0.1]), np.array([0.01, 0.0, -0.02])
    rows = {"heading_baseline_b": baseline, "heading_baseline_error": error}
    y = simulate(60, rows, {"q_nb": q_nb}, of="heading")
    exact = turned.apply(baseline + error)
    np.testing.assert_allclose(y["heading_baseline_n"], exact, atol=1e-14)
    np.testing.assert_allclose(y["heading_azimuth"], np.arctan2(exact[:, 1], exact[:, 0]), atol=1e-14)
    np.testing.assert_array_equal(y["heading_azimuth"], y["heading_azimuth_true"])


def test_it_states_its_scatter() -> None:
    """The azimuth scatters as reported; the noise of north and east differs, and so does its effect."""
    rows = {"heading_baseline_noise": (0.004, 0.012, 0.02)}
    rows |= {"heading_wander_sigma": (0.003, 0.001, 0.0), "heading_wander_time": 0.05}
    n = 15_000
    for angle in (0.0, 0.7, math.pi / 2):
        y = simulate(n, rows, {"q_nb": (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))}, of="heading")
        variance = ((0.012**2 + 1e-6) * math.cos(angle) ** 2) + ((0.004**2 + 9e-6) * math.sin(angle) ** 2)
        assert_variance(y["heading_azimuth"] - angle, variance, n / 12)  # correlated over 10 samples
        np.testing.assert_allclose(np.mean(y["heading_azimuth_sigma"]), math.sqrt(variance), rtol=0.01)
    assert_gauss_markov(y["heading_wander"][:, 0], 0.003, 0.05)
    vertical = {"heading_baseline_b": (0.0, 0.0, -1.0), "heading_baseline_noise": (0.01,) * 3}
    y = simulate(10, vertical, of="heading")
    assert np.isfinite(y["heading_azimuth"]).all() and (y["heading_azimuth_sigma"] > 0.3).all()


def test_length_check_drops_wrong_ambiguities() -> None:
    """Of displacements of length s, uniform in direction, from a baseline L it keeps those with (L -+ t)^2 about |d|^2."""
    n, length, size, tolerance = 10_000, 1.0, 0.19, 0.05
    rows = {"heading_outlier_probability": 1.0, "heading_outlier_size": size, "heading_length_tolerance": tolerance}
    kept = int(simulate(n, rows, of="heading")["heading_new"].sum())
    low, high = (((length + side * tolerance) ** 2 - length**2 - size**2) / (2 * length * size) for side in (-1, 1))
    share = (min(high, 1.0) - max(low, -1.0)) / 2
    assert binom.ppf(CHANCE / 2, n, share) <= kept <= binom.ppf(1 - CHANCE / 2, n, share)
    assert simulate(100, {**rows, "heading_length_tolerance": 0.0}, of="heading")["heading_new"].all()


@pytest.mark.parametrize("length", [0.5, 1.0, 3.0])
def test_a_filter_starts_with_the_azimuth_error_that_the_error_of_the_baseline_makes(length: float) -> None:
    """Draws of the error of a level baseline, which is told as one standard deviation of each axis."""
    sigma, baseline = 0.01 * length, length * np.array([0.6, -0.8, 0.0])
    off = baseline + np.random.default_rng(1).normal(size=(20_000, 3)) * sigma
    scatter = np.std(np.arctan2(off[:, 1], off[:, 0]))
    (state,) = states_of(registry.instruments()["heading"])
    told = SimpleNamespace(heading_baseline_sigma=sigma, heading_baseline_b=ca.DM(baseline))
    assert float(state.start_sigma(told)) == pytest.approx(scatter, rel=0.02)
