"""Biases that fade: every filter that models them as Gauss-Markov processes lets variance and estimate decay with them."""

import numpy as np
import pytest

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.runs.ensemble import ensemble

LATITUDE = 0.5
BIASES = {  # places of the gyro and accelerometer biases in the error state, and its size
    "loosely-coupled": (slice(9, 12), slice(12, 15), 15),
    "smoother": (slice(9, 12), slice(12, 15), 15),
    "aqe-ekf": (slice(4, 7), slice(7, 10), 16),
    "aqe-sukf": (slice(4, 7), slice(7, 10), 16),
}
SIGMAS = {"gyro_bias_sigma": 1e-7, "accel_bias_sigma": 1e-4}
TIMES = {"gyro_correlation_time": 600.0, "accel_correlation_time": 200.0}


@pytest.mark.parametrize("id", BIASES)
def test_without_measurements_a_bias_keeps_its_variance_and_its_estimate_fades(id):
    """Two hours at rest without a fix: variance sigma^2 as at the start, estimate exp(-t / time) of that at the start."""
    gyro, accel, size = BIASES[id]
    model, dt, n = get(id).model, 1.0, 7200
    still = {} if "aqe" in id else {"standing_window": 0.0}  # no detection of rest
    start = {**still, "start_gyro_bias": (3e-7, 0, 0), "start_accel_bias": (0, 2e-4, 0), "start_latitude": LATITUDE}
    runner = make_runner(model, {**SIGMAS, **TIMES, **start}, "interpreter")
    rate, g = geodesy.numeric.earth_rate_n(LATITUDE), float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))
    inputs = model.inputs.pack({"delta_angle": rate * dt, "delta_velocity": (0, 0, -g * dt), "dt": dt})
    for done in (600, n):
        runner.run(600 if done == 600 else n - 600, inputs, 0)
        P = symmetric.full_array(runner.state["covariance"], size)
        assert np.allclose(np.diag(P[gyro, gyro]), SIGMAS["gyro_bias_sigma"] ** 2, rtol=1e-9)
        assert np.allclose(np.diag(P[accel, accel]), SIGMAS["accel_bias_sigma"] ** 2, rtol=1e-9)
        assert np.allclose(runner.state["gyro_bias"][0], 3e-7 * np.exp(-done / 600.0), rtol=1e-9)
        assert np.allclose(runner.state["accel_bias"][1], 2e-4 * np.exp(-done / 200.0), rtol=1e-9)


def test_ecef_kf_never_knows_its_biases_worse_than_at_the_start():
    model, dt, n = get("ecef-kf").model, 0.5, 14400
    rate, g = geodesy.numeric.earth_rate_n(LATITUDE), float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))
    parameters = {**SIGMAS, **TIMES, "latitude": LATITUDE, "velocity_sigma": 1e3}  # so that nothing is learnt
    runner = make_runner(model, {**parameters, "update_interval": 1.0}, "interpreter")
    x = runner.x.copy()
    x[model.state.slice("gyro_bias")] = 3e-7
    runner.x[:] = x
    runner.run(n, model.inputs.pack({"delta_angle": rate * dt, "delta_velocity": (0, 0, -g * dt), "dt": dt}), 0)
    P = np.sqrt(np.diag(symmetric.full_array(runner.state["covariance"], 12)))
    assert np.allclose(P[6:9], SIGMAS["accel_bias_sigma"], rtol=1e-3)
    assert np.allclose(P[9:12], SIGMAS["gyro_bias_sigma"], rtol=1e-3)
    assert np.abs(runner.state["gyro_bias"]).max() < 1e-3 * 3e-7  # faded: 12 correlation times


def boat(duration_s=3600.0):
    """A moored boat with a receiver, and biases of the unit that change with a time of ten minutes."""
    imu = {"gyro_arw_deg_sqrt_h": 0.002, "accel_vrw_ug_sqrt_hz": 10.0, "gyro_instability_deg_h": 0.01,
           "accel_instability_ug": 50.0, "gyro_instability_time_s": 600.0, "accel_instability_time_s": 600.0}  # fmt: skip
    wave = {name: [{"amplitude_deg": size, "period_s": period}] for name, size, period in
            (("roll", 4.0, 4.0), ("pitch", 2.0, 5.0), ("yaw", 2.0, 9.0))}  # fmt: skip
    wave |= {"north": [{"amplitude_m": 0.06, "period_s": 7.0}], "east": [{"amplitude_m": 0.08, "period_s": 6.0}]}
    return {
        "title": "boat", "duration_s": duration_s, "rate_hz": 50.0, "imu": imu, "gnss": {"wander_sigma_m": 0.0},
        "start": {"latitude_deg": 28.2, "longitude_deg": 113.0, "heading_deg": 60.0},
        "vehicle": {"kind": "ship", "random_phases": True, "sway": wave}, "knowledge": {"heading_sigma_deg": 1.0},
    }  # fmt: skip


@pytest.mark.slow
def test_a_moored_boat_with_fading_biases_is_navigated_as_stated():
    """Heading in the second half of an hour, 24 seeds: the filters agree, and err as they state."""
    ids = ["loosely-coupled", "aqe-ekf", "aqe-sukf"]
    found = ensemble(boat(), ids, range(24), records=60)
    late = found.time > 1800.0
    heading = {id: found.attitude_errors_deg(id)[:, late, 2] for id in ids}
    for id in ids:
        sigma = np.degrees(found.outputs[id]["attitude_sigma"][:, late, 2])
        # about three independent errors in half an hour and run: 72 in all, 99.9 %
        assert 0.5 < np.mean((heading[id] / sigma) ** 2) < 1.65, id
        assert np.abs(heading[id] - heading["loosely-coupled"]).max() < 0.1 * sigma.mean(), id
