"""The odometer: the speed of its point along its axis, scale factor, slip and quantum."""

import numpy as np
from scipy.spatial.transform import Rotation
from sensor_plant import DT, assert_variance, attitudes, simulate, starts


def test_it_shows_the_speed_of_its_point_along_its_axis() -> None:
    n, rng = 40, np.random.default_rng(1)
    turned, q_nb = attitudes(n)
    velocity, rate, arm = rng.normal(size=(n, 3)) * 10, rng.normal(size=(n, 3)), np.array([1.0, -2.0, 0.5])
    mounting, error = np.array([0.1, -0.2, 0.3]), np.array([0.01, 0.02, -0.03])
    rows = {"odometer_lever_arm_b": arm, "odometer_mounting": mounting, "odometer_mounting_error": error}
    y = simulate(n, rows, {"q_nb": q_nb, "velocity_n": velocity, "rate_eb_b": rate}, of="odometer")
    axes = Rotation.from_rotvec(mounting) * Rotation.from_rotvec(error)  # takes v to b
    exact = axes.inv().apply(turned.inv().apply(velocity) + np.cross(rate, arm))[:, 0]
    np.testing.assert_allclose(y["odometer_speed"], exact, atol=1e-13)
    np.testing.assert_array_equal(y["odometer_speed_true"], y["odometer_speed"])


def test_scale_slip_and_quantum() -> None:
    truth = {"velocity_n": (20.0, 0.0, 0.0), "true_delta_velocity": (3.0 * DT, 0.0, -9.8 * DT)}

    def speed(n: int, **rows: float) -> np.ndarray:
        return simulate(n, {f"odometer_{name}": value for name, value in rows.items()}, truth, of="odometer")["odometer_speed"]

    np.testing.assert_allclose(speed(1, scale_factor=0.01, slip=0.003), 20.0 * (1 + 0.01 + 0.003 * 3.0), rtol=1e-14)
    shown = speed(1, scale_factor=0.01, slip=0.003, quantum=1 / 3.6)
    np.testing.assert_allclose(shown * 3.6, round(20.38 * 3.6), atol=1e-12)
    assert_variance(speed(10_000, noise=0.05) - 20.0, 0.05**2)
    drawn = {"scale_factor_sigma": 0.01, "slip_sigma": 0.002, "mounting_error_sigma": (0.1, 0.2, 0.3)}
    x = starts({f"odometer_{name}": value for name, value in drawn.items()}, 2000, of="odometer")
    assert_variance(x["odometer_scale_factor_true"], 1e-4)
    assert_variance(x["odometer_slip_true"], 4e-6)
    assert_variance(x["odometer_mounting_error_true"], (0.01, 0.04, 0.09))
