"""Corrections for the temperature take off what the simulated unit adds."""

import numpy as np
from sensor_plant import simulate

from insenv.sensors.thermal import without_thermal_errors


def test_a_calibration_takes_off_what_the_temperature_adds() -> None:
    rows = {"sample_interval": 0.01, "imu_temperature_initial": 280.0, "imu_temperature_final": 330.0}
    rows |= {"imu_temperature_time": 5.0, "imu_temperature_ramp": 0.1, "imu_temperature_reference": 300.0}
    rows |= {"gyro_scale_factor_slope": (1e-5, -2e-5, 3e-5), "gyro_temperature_slope": (1e-6, 2e-6, -3e-6)}
    angle = np.array([1e-3, 2e-3, -3e-3])
    out = simulate(1200, rows, {"true_delta_angle": angle})
    slopes = np.array(rows["gyro_temperature_slope"]), np.array(rows["gyro_scale_factor_slope"])
    clean = without_thermal_errors(out["delta_angle"], np.full(1200, 0.01), out["imu_temperature"] - 300.0, *slopes)
    assert np.abs(out["delta_angle"] - angle).max() > 5e-7
    assert np.allclose(clean, angle, rtol=0, atol=1e-17)
