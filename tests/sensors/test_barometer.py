"""The barometer: noise, drift, lag and constants against their stated parameters."""

import math
from types import SimpleNamespace

import numpy as np
from sensor_plant import DT, assert_gauss_markov, assert_variance, simulate, starts

from insenv.sensors.barometer import LAG


def test_white_noise_and_drift() -> None:
    rows = {"barometer_noise": 0.3, "barometer_drift_sigma": 0.5, "barometer_drift_time": 2.0}
    y = simulate(30_000, rows, of="barometer")
    assert_gauss_markov(y["barometer_bias_true"], 0.5, 2.0)
    white = y["barometer_height"] - 50.0 - y["barometer_bias_true"]
    assert_variance(white, 0.3**2)
    assert_variance(np.diff(white), 2 * 0.3**2, 30_000 * 2 / 3)  # as white noise has


def test_lag_of_a_ramp_is_the_closed_form() -> None:
    lag, rate, n = 0.4, 3.0, 500
    time = np.arange(1, n + 1) * DT
    y = simulate(n, {"barometer_lag": lag}, {"height": 50.0 + rate * time}, of="barometer")
    behind = -rate * lag * (1 - np.exp(-time / lag))
    np.testing.assert_allclose(y["barometer_height"] - (50.0 + rate * time), behind, atol=1e-12)
    # what a filter counts of it
    assert LAG.estimate(SimpleNamespace(velocity_down=-rate), SimpleNamespace(barometer_lag=lag)) == -rate * lag


def test_constants() -> None:
    x = starts({"barometer_bias_sigma": 2.0, "barometer_scale_factor_sigma": 0.03, "barometer_bias": 1.0}, 2000, of="barometer")
    assert_variance(x["barometer_bias_true"] - 1.0, 4.0)
    assert_variance(x["barometer_scale_factor_true"], 0.03**2)
    assert abs(np.corrcoef(x["barometer_bias_true"], x["barometer_scale_factor_true"])[0, 1]) < 4.5 / math.sqrt(2000)
    rows = {"barometer_scale_factor": 0.0202, "barometer_speed_error": 0.5, "barometer_quantum": 0.25}
    y = simulate(1, rows, {"height": 1050.0, "velocity_n": (30.0, 40.0, 0.0)}, of="barometer")
    exact = 1050.0 + 0.0202 * 1000.0 - 0.5 * 2500.0 / (2 * 9.80665)
    assert 1006.25 + 0.2 < exact < 1006.5 and y["barometer_height"][0] == 1006.5
