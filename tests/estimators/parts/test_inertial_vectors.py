"""Stated accuracy of alignments by inertial vectors against variances computed from their definition."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from insenv.estimators.parts import inertial_vectors
from insenv.geodesy import OMEGA_IE

G, LATITUDE = 9.8, 0.6
QUIET = dict.fromkeys(("accel_bias_sigma", "gyro_bias_sigma", "angle_random_walk", "velocity_random_walk"), 0.0)


def stated(time, age=0.0, mean_age=0.0, lost=0.0, **noises):
    """`inertial_vectors.stated_sigma` in numbers."""
    p = SimpleNamespace(**{**QUIET, **noises})
    x = SimpleNamespace(rest_force_n=ca.SX([0, 0, -G]), axis_n=ca.SX([np.cos(LATITUDE), 0, -np.sin(LATITUDE)]))
    return np.array(ca.DM(ca.evalf(inertial_vectors.stated_sigma(p, x, ca.SX(time), lost, age, mean_age)))).ravel()


def line(density, duration, count=20_000):
    """Standard deviations of the end and of the slope of a line fitted to white noise of a density, over `duration`."""
    t = (np.arange(count) + 0.5) * duration / count - duration  # 0 at the end
    A = np.stack([np.ones(count), t], axis=1)
    return density * np.sqrt(count / duration) * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))


def test_white_noise_of_the_accelerometers_is_that_of_a_fitted_line():
    """The apparent vertical follows a line: its end is the tilt, its slope over the horizontal Earth rate the heading."""
    V, time = 2e-3, 300.0
    end, slope = line(V / G, time)
    found = stated(time + 20.0, lost=20.0, velocity_random_walk=V)
    assert found == pytest.approx([end, end, slope / (OMEGA_IE * np.cos(LATITUDE))], rel=1e-4)


def test_biases_of_the_stated_accuracy():
    """Tilt by the accelerometers and by what the gyros drift since the vertical; heading by the east gyro and the tilt."""
    found = stated(1e4, age=50.0, accel_bias_sigma=1e-3)
    assert found == pytest.approx([1e-3 / G, 1e-3 / G, 1e-3 / G * np.tan(LATITUDE)])
    found = stated(1e4, age=50.0, gyro_bias_sigma=1e-7)
    assert found == pytest.approx([5e-6, 5e-6, 1e-7 / (OMEGA_IE * np.cos(LATITUDE))])


def test_gyro_noise_since_the_vertical_is_the_mean_of_a_brownian_path():
    """Of a path over 2 x 40 s: variance of its end minus its mean, by the covariance min(s, t) of its points."""
    N, mean_age, count = 3e-5, 40.0, 800
    t = (np.arange(count) + 0.5) * 2 * mean_age / count
    covariance = N**2 * np.minimum(t[:, None], t)
    weights = -np.full(count, 1 / count)
    weights[-1] += 1
    expected = np.sqrt(weights @ covariance @ weights)
    assert stated(1e6, mean_age=mean_age, angle_random_walk=N)[:2] == pytest.approx([expected] * 2, rel=2e-3)


def test_heading_by_gyro_noise_is_the_slope_of_a_brownian_path():
    """The mean rate over the time: the best estimate of the drift of a Brownian path."""
    N, time = 3e-5, 300.0
    assert stated(time, angle_random_walk=N)[2] == pytest.approx(N / np.sqrt(time) / (OMEGA_IE * np.cos(LATITUDE)))
