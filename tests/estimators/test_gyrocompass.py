"""gyrocompass: the noise of its heading loop, any heading at the start."""

import numpy as np
import pytest
from driven import outputs_of
from resting import at_rest, attitude_error
from scipy.linalg import expm, solve_continuous_lyapunov

from insenv import attitude
from insenv.estimators import gyrocompass
from insenv.geodesy import OMEGA_IE

G, LATITUDE = 9.8, 0.6
QUIET = dict.fromkeys(("accel_bias_sigma", "gyro_bias_sigma", "angle_random_walk", "velocity_random_walk"), 0.0)


def test_noise_of_the_heading_loop_is_that_of_its_equations():
    """v', phi_E', phi_D' of the module with white noise of gyros and accelerometers: the steady covariance."""
    tau, R = 40.0, OMEGA_IE * np.cos(LATITUDE)
    K1, K2, K3 = 3 / tau, 3 / tau**2, 1 / tau**3
    F = np.array([[-K1, -G, 0.0], [K2 / G, 0.0, R], [K3 / (G * R), 0.0, 0.0]])
    for name, noise in (("angle_random_walk", np.diag([0, 1e-5**2, 0])), ("velocity_random_walk", np.diag([1e-3**2, 0, 0]))):
        expected = np.sqrt(solve_continuous_lyapunov(F, -noise)[2, 2])
        given = {**QUIET, name: {"angle_random_walk": 1e-5, "velocity_random_walk": 1e-3}[name], "heading_constant": tau}
        x = gyrocompass.MODEL.state.pack({"time": 1e6, "gravity": G, "axis_n": [np.cos(LATITUDE), 0, -np.sin(LATITUDE)]})
        shown = outputs_of(gyrocompass.MODEL, x, {**given, "start_heading_sigma": 0.0})
        assert shown["attitude_sigma"][2] == pytest.approx(expected, rel=1e-3), name


@pytest.mark.parametrize("after", [0.0, 0.5, 1.0, 3.0])
def test_a_start_heading_error_is_stated_to_decay_as_the_loop_lets_it(after):
    """A small one, without noise, `after` time constants after levelling: v', phi_E', phi_D' of the module; level at first."""
    tau, start = 40.0, 1e-3
    K1, K2, K3, R = 3 / tau, 3 / tau**2, 1 / tau**3, OMEGA_IE * np.cos(LATITUDE)
    F = np.array([[-K1, -G, 0.0], [K2 / G, 0.0, R], [K3 / (G * R), 0.0, 0.0]])
    given = {**QUIET, "heading_constant": tau, "start_heading_sigma": start, "levelling_time": 60.0}
    state = {"time": 60.0 + after * tau, "gravity": G, "axis_n": [np.cos(LATITUDE), 0, -np.sin(LATITUDE)]}
    shown = outputs_of(gyrocompass.MODEL, gyrocompass.MODEL.state.pack(state), given)["attitude_sigma"][2]
    left = (expm(F * after * tau) @ [0.0, 0.0, start])[2]
    assert left * (1 - 1e-9) <= shown < 1.08 * left  # its exponential is (1 + s / 64)^-64, a little above


@pytest.mark.parametrize("heading_error_deg", [0.0, 5.0, -60.0, -150.0])
def test_it_converges_from_any_heading(heading_error_deg):
    q_nb = attitude.numeric.from_euler(0.05, -0.1, 1.0)
    given = {"start_heading": 1.0 + np.radians(heading_error_deg), "block_samples": 2}
    assert np.abs(attitude_error(at_rest("gyrocompass", q_nb, -0.5, 1500.0, parameters=given), q_nb)).max() < 2e-6
