"""The Doppler log: velocity of its point, of the water too, noise and current."""

import numpy as np
from scipy.spatial.transform import Rotation
from sensor_plant import assert_gauss_markov, assert_variance, attitudes, simulate, starts

from insenv.sensors.dvl import DVL


def test_it_shows_the_velocity_of_its_point_over_the_ground_or_through_the_water() -> None:
    n, rng = 40, np.random.default_rng(2)
    turned, q_nb = attitudes(n)
    velocity, rate, arm = rng.normal(size=(n, 3)) * 5, rng.normal(size=(n, 3)) * 0.1, np.array([-10.0, 2.0, 4.0])
    error, current = np.array([0.01, -0.02, 0.05]), np.array([0.5, -0.3, 0.0])
    rows = {"dvl_lever_arm_b": arm, "dvl_misalignment": error, "dvl_scale_factor": 0.005, "dvl_current_n": current}
    for water in (0.0, 1.0):
        truth = {"q_nb": q_nb, "velocity_n": velocity, "rate_eb_b": rate}
        y = simulate(n, {**rows, "dvl_water_track": water}, truth, of="dvl")
        exact = turned.inv().apply(velocity - water * current) + np.cross(rate, arm)
        np.testing.assert_allclose(y["dvl_velocity_b"], 1.005 * Rotation.from_rotvec(error).inv().apply(exact), atol=1e-13)
        np.testing.assert_allclose(y["dvl_velocity_true"], turned.inv().apply(velocity) + np.cross(rate, arm), atol=1e-13)


def test_noise_and_current() -> None:
    rows = {"dvl_noise": 0.02, "dvl_current_sigma": 0.3, "dvl_current_time": 1.5, "dvl_water_track": 1.0}
    y = simulate(30_000, rows, of="dvl")
    assert_gauss_markov(y["dvl_current_true"][:, :2], 0.3, 1.5)
    assert not y["dvl_current_true"][:, 2].any()
    assert_variance(y["dvl_velocity_b"] + y["dvl_current_true"], 0.02**2)
    x = starts({"dvl_scale_factor_sigma": 0.005, "dvl_misalignment_sigma": (0.01, 0.02, 0.03)}, 2000, of="dvl")
    assert_variance(x["dvl_scale_factor_true"], 0.005**2)
    assert_variance(x["dvl_misalignment_true"], (1e-4, 4e-4, 9e-4))
    table = DVL.all_parameters
    stated = DVL.stated_values({**table.unpack(table.pack(rows)), "dvl_water_track": 0.0})
    assert stated["dvl_current_sigma"] == 0.0, "a log that tracks the ground has no current"
