"""The magnetometer: the field in body axes, soft and hard iron, noise and drift."""

import numpy as np
from sensor_plant import assert_gauss_markov, assert_variance, attitudes, simulate, starts

FIELD = (2.1e-5, 1e-6, 4.4e-5)


def test_it_shows_the_field_in_body_axes() -> None:
    turned, q_nb = attitudes(50)
    soft = np.array([[0.02, 0.01, -0.03], [0.0, -0.04, 0.02], [0.03, 0.0, 0.01]])
    hard, anomaly = np.array([1e-6, -2e-6, 3e-6]), np.array([1e-7, 2e-7, -3e-7])
    rows = {"magnetic_field_n": FIELD, "magnetic_anomaly_n": anomaly}
    rows |= {"magnetometer_soft_iron": soft, "magnetometer_hard_iron": hard}
    y = simulate(50, rows, {"q_nb": q_nb}, of="magnetometer")
    field_b = turned.inv().apply(np.array(FIELD) + anomaly)
    np.testing.assert_allclose(y["magnetometer_field_true"], field_b, rtol=0, atol=1e-19)
    np.testing.assert_allclose(y["magnetometer_field_b"], field_b + field_b @ soft.T + hard, rtol=0, atol=1e-19)


def test_noise_drift_and_constants() -> None:
    rows = {"magnetometer_noise": 3e-7, "magnetometer_drift_sigma": 2e-7, "magnetometer_drift_time": 1.0}
    y = simulate(20_000, rows, of="magnetometer")
    assert_gauss_markov(y["magnetometer_hard_iron_true"] * 1e7, 2.0, 1.0)
    assert_variance((y["magnetometer_field_b"] - y["magnetometer_hard_iron_true"]) * 1e7, 9.0)
    sigmas = {"magnetometer_hard_iron_sigma": (1.0, 2.0, 3.0), "magnetometer_soft_iron_sigma": 0.02}
    sigmas |= {"magnetometer_coupling_sigma": 0.01, "magnetic_anomaly_sigma": (4.0, 5.0, 6.0)}
    x = starts(sigmas, 2000, of="magnetometer")
    assert_variance(x["magnetometer_hard_iron_true"], (1.0, 4.0, 9.0))
    assert_variance(x["magnetic_anomaly_true"], (16.0, 25.0, 36.0))
    soft = x["magnetometer_soft_iron_true"]
    assert_variance(np.einsum("nii->ni", soft), 0.02**2)
    assert_variance(soft[:, ~np.eye(3, dtype=bool)], 0.01**2)
    coarse = simulate(1, {"magnetic_field_n": FIELD, "magnetometer_quantum": 1e-6}, of="magnetometer")
    np.testing.assert_allclose(coarse["magnetometer_field_b"][0], [21e-6, 1e-6, 44e-6], atol=1e-12)
