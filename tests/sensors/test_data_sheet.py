"""The data sheet of a unit, to which estimators are tuned."""

import numpy as np
import pytest

from insenv.scenario import build, load, parse
from insenv.sensors.data_sheet import CONSTANT, imu_data_sheet

DEG = np.pi / 180.0


def knowledge(name, **imu):
    data = load(name).model_dump(mode="json", exclude_unset=True)
    return build(parse({**data, "imu": {**data["imu"], **imu}})).knowledge


def test_fixed_parts_and_the_effects_of_gravity():
    notes = knowledge("ship-swaying").sensors
    assert notes.angle_random_walk == pytest.approx(0.002 * DEG / 60)
    assert notes.gyro_bias_sigma == pytest.approx(0.001 * DEG / 3600) and notes.gyro_correlation_time == pytest.approx(CONSTANT)
    assert notes.accel_bias_sigma == pytest.approx(10e-6 * 9.80665)
    notes = knowledge("ship-swaying", grade="leador").sensors  # moored: the scale factor acts on the vertical only
    assert notes.gyro_bias_sigma == pytest.approx(0.027 * DEG / 3600) and notes.gyro_correlation_time == pytest.approx(4 * 3600)
    assert notes.accel_bias_sigma == pytest.approx(15e-5)
    assert (notes.gyro_scale_time, notes.accel_scale_time) == (4 * 3600, 4 * 3600)
    notes = knowledge("ship-swaying", grade="perfect").sensors
    proportional = ("_scale_sigma", "_misalignment_sigma", "_sensitivity_sigma", "_scale_time")  # a perfect unit has none
    own = {name: value for name, value in vars(notes).items() if not name.startswith("standing_")}
    assert all(value > 0.0 for name, value in own.items() if not name.endswith(proportional))


def test_the_data_sheet_has_the_thermal_errors_of_the_run():
    slopes = {"gyro_temperature_slope_deg_h_k": -10.0, "accel_scale_factor_slope_ppm_k": 50.0}
    plain, known = knowledge("car-city-drive"), knowledge("car-city-drive", **slopes)
    assert known.sensors == plain.sensors
    assert (known.rotation_error, known.thrust_error) == (plain.rotation_error, plain.thrust_error)
    warm = knowledge("car-city-drive", **slopes, temperature_end_degc=50.0)
    bias, scale = 300.0 * DEG / 3600, 50e-6 * 30.0
    assert warm.sensors.gyro_bias_sigma == pytest.approx(np.hypot(plain.sensors.gyro_bias_sigma, bias))
    assert warm.sensors.accel_scale_sigma == pytest.approx(np.hypot(plain.sensors.accel_scale_sigma, scale))
    assert warm.thrust_error == pytest.approx(np.hypot(plain.thrust_error, scale))
    assert warm.sensors.gyro_correlation_time < 650.0
    ramped = knowledge("car-city-drive", **slopes, temperature_end_degc=20.0, temperature_ramp_k_h=30.0)
    assert ramped.sensors.gyro_bias_sigma == pytest.approx(np.hypot(plain.sensors.gyro_bias_sigma, bias))


def test_the_bare_biases_are_those_of_a_unit_whose_errors_do_not_depend_on_motion():
    bias = {"gyro_bias_sigma": 1e-6, "gyro_instability_sigma": 3e-7, "gyro_instability_time": 500.0}
    bias |= {"accel_rate_random_walk": 1e-6}
    motion = {"gyro_g_sensitivity": [[1e-7] * 3] * 3, "accel_misalignment_sigma": 2e-4, "accel_scale_factor_sigma": 1e-4}
    whole, plain = (vars(imu_data_sheet(rows, in_place=False)) for rows in (bias | motion, bias))
    for name in ("gyro_bias_sigma", "gyro_correlation_time", "accel_bias_sigma", "accel_correlation_time"):
        assert whole[f"bare_{name}"] == pytest.approx(plain[name]) and whole[name] != pytest.approx(plain[name], rel=0.01), name
