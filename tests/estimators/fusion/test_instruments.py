"""Errors that a fusion filter estimates: each one large, alone, is found with the sign of the true one."""

import math

import numpy as np
import pytest

from insenv.core.runner import make_runner
from insenv.estimators.fusion import fusion
from insenv.scenario import build, load
from insenv.scenario.chunks import input_rows

CAR = {
    "title": "Car", "duration_s": 30.0, "rate_hz": 20.0, "imu": {"grade": "perfect"},
    "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
    "vehicle": {"kind": "car", "engine": [], "start_speed_mps": 8.0, "legs": [
        {"turn_deg": 170.0, "radius_m": 30.0}, {"accelerate_to_mps": 15.0},
        {"turn_deg": -170.0, "radius_m": 60.0, "grade_percent": 8.0}, {"drive_s": 600.0, "grade_percent": 8.0}]},
    "knowledge": {"draw_errors": False, "tilt_sigma_deg": 0.01, "heading_sigma_deg": 0.01, "velocity_sigma_mps": 0.01,
                  "position_sigma_m": 0.01},
    "gnss": {"grade": "perfect", "position_noise_m": 0.01, "velocity_noise_mps": 0.01, "interval_s": 0.2,
             "lever_arm_m": [1.0, 0.5, -1.0]},
    "barometer": {"grade": "perfect", "noise_m": 0.05}, "magnetometer": {"grade": "perfect", "noise_nt": 10.0},
    "odometer": {"grade": "perfect", "noise_mps": 0.01, "lever_arm_m": [-1.0, 0.7, 0.5]},
    "dvl": {"grade": "perfect", "noise_mps": 0.01, "water_track": True, "lever_arm_m": [1.0, 0.0, 0.5]},
    "heading": {"grade": "perfect", "noise_m": 0.002, "baseline_m": [0.8, -0.5, 0.2]},
}  # fmt: skip
THREE = np.array([1.0, -2.0, 1.5])
COUPLED = 0.03 * np.array([[0.0, 1.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -1.0, 0.0]])
TURNED = math.atan2(-0.44, 0.85) - math.atan2(-0.5, 0.8)
ERRORS = {  # by state: the row of the plant and its value, what is to be found, the stated sigma
    "gnss_lever_arm": ("antenna_lever_arm_error", 0.2 * THREE, [1.2, 0.1, -0.7], ("antenna_lever_arm_sigma", 0.4)),
    "gnss_delay": ("gnss_delay_error", 0.05, [0.05], ("gnss_delay_sigma", 0.05)),
    "barometer_bias": ("barometer_bias", -5.0, [-5.0], ("barometer_bias_sigma", 5.0)),
    "barometer_scale": ("barometer_scale_factor", -0.05, [-0.05], ("barometer_scale_factor_sigma", 0.05)),
    "hard_iron": ("magnetometer_hard_iron", 2e-6 * THREE, 2e-6 * THREE, ("magnetometer_hard_iron_sigma", 4e-6)),
    "soft_iron": ("magnetometer_soft_iron", np.diag(0.03 * THREE), 0.03 * THREE, ("magnetometer_soft_iron_sigma", 0.05)),
    "soft_iron_coupling": ("magnetometer_soft_iron", COUPLED, COUPLED[COUPLED != 0], ("magnetometer_coupling_sigma", 0.03)),
    "magnetic_field_error": ("magnetic_anomaly_n", 1e-6 * THREE, 1e-6 * THREE, ("magnetic_field_sigma", 2e-6)),
    "odometer_scale": ("odometer_scale_factor", -0.03, [-0.03], ("odometer_scale_factor_sigma", 0.03)),
    "odometer_slip": ("odometer_slip", -0.01, [-0.01], ("odometer_slip_sigma", 0.01)),
    "odometer_mounting_error": ("odometer_mounting_error", [0, 6e-3, -8e-3], [6e-3, -8e-3], ("odometer_mounting_sigma", 0.01)),
    "dvl_scale": ("dvl_scale_factor", -0.02, [-0.02], ("dvl_scale_factor_sigma", 0.02)),
    "dvl_misalignment": ("dvl_misalignment", 0.02 * THREE, 0.02 * THREE, ("dvl_misalignment_sigma", 0.04)),
    "current": ("dvl_current_n", [0.5, -0.4, 0.0], [0.5, -0.4], ("dvl_current_sigma", 0.5)),
    "heading_offset": ("heading_baseline_error", [0.05, 0.06, 0.0], [TURNED], ("heading_baseline_sigma", 0.06)),
}


@pytest.mark.parametrize("states", np.split(np.array([*ERRORS]), [4, 8]), ids=lambda states: states[0])
def test_each_error_alone_is_found_with_its_sign(states):
    """Of each state of a filter the elements that the drive shows: to half of their size."""
    plant = build(load(CAR), seed=1)
    filter = plant.adapted(fusion(states.tolist(), ["gnss", "barometer", "magnetometer", "odometer", "dvl", "heading"]))
    sigmas = {row: np.full(filter.model.parameters[row].shape, size) for *_, (row, size) in map(ERRORS.get, states)}
    for state in states:
        row, value, true, (_, sigma) = ERRORS[state]
        runner = make_runner(plant.model, {**plant.parameters, row: value})
        columns = plant.model.outputs.unpack(runner.run(plant.samples)) | {"dt": np.full(plant.samples, plant.sample_interval)}
        inputs = input_rows(filter.model, columns, plant.samples)
        runner = make_runner(filter.model, plant.parameters_of(filter) | sigmas)
        shown = filter.model.outputs.unpack(runner.run(plant.samples, inputs, plant.samples))
        learnt = shown[f"{state}_estimate_sigma"][-1] < 0.3 * sigma
        share = (shown[state][-1] / true)[learnt]
        assert share.size and np.all((share > 0.4) & (share < 1.6)), (state, share)
