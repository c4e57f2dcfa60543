"""Plants of scenarios: shared models, the numbers of papers, what is known at the start, noise and mounting."""

import copy
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.scenario import build, load, parse

DEG = math.pi / 180.0


def data_of(name):
    return copy.deepcopy(load(name).model_dump(mode="json", exclude_unset=True))


def shown(plant, samples=None):
    return plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(samples or plant.samples))


def test_equal_structures_share_a_model():
    swaying, changed = build(load("ship-swaying")), data_of("ship-swaying")
    changed["vehicle"]["sway"]["roll"][0]["period_s"] = 7.0
    changed["imu"]["grade"] = "consumer"
    assert build(parse(changed)).model is swaying.model
    assert build(load("turntable-quaternion")).model is not swaying.model
    assert build(load("car-parked")).model is not build(load("static-ecef")).model  # other numbers of engine waves


def test_static_ecef_has_the_numbers_of_the_paper():
    plant = build(load("static-ecef"), duration_s=1.0)
    np.testing.assert_allclose(plant.parameters["gyro_bias"], 0.002 * DEG / 3600)
    np.testing.assert_allclose(plant.parameters["accel_bias"], 2e-4)
    assert not np.any(plant.parameters["angle_random_walk"])
    np.testing.assert_allclose(shown(plant, 1)["q_nb"][0], [1, 0, 0, 0], atol=1e-15)
    known = plant.knowledge
    np.testing.assert_allclose(np.degrees([known.roll, known.pitch, known.heading]), [0.1, 0.1, 1.0])
    assert known.latitude == pytest.approx(45 * DEG, abs=1e-15) and not np.any(known.velocity_n)


def test_turntable_is_that_of_the_paper_in_other_axes():
    """The attitude of the paper in its own axes (right, forward, up; counter-clockwise heading), made with scipy."""
    plant = build(load("turntable-quaternion"), duration_s=3.0)
    t = 3.0
    pitch, roll, heading = (a * math.sin(2 * math.pi * f * t) + c for a, f, c in ((8, 0.15, 0), (6, 0.2, 0), (5, 0.125, 45)))
    enu = Rotation.from_euler("ZXY", [heading, pitch, roll], degrees=True).as_matrix()
    swap = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # east-north-up to north-east-down, right-forward-up to FRD
    np.testing.assert_allclose(attitude.numeric.to_dcm(shown(plant)["q_nb"][-1]), swap @ enu @ swap, atol=1e-12)
    np.testing.assert_allclose(swap @ [0.01, 0.01, 0.01], plant.parameters["gyro_bias"] / DEG * 3600)


def start_errors(plant):
    """Errors of roll, pitch, heading (rad), position (m), velocity (m/s)."""
    true, known = make_runner(plant.model, plant.parameters).state, plant.knowledge
    angles = np.array([known.roll, known.pitch, known.heading]) - np.array(attitude.numeric.to_euler(true["q_nb"]))
    place = known.latitude, known.longitude, known.height, true["latitude"], true["longitude"], true["height"]
    return np.concatenate([angles, geodesy.numeric.ned_offset(*place), known.velocity_n - true["velocity_n"]])


def test_start_errors_given():
    data = data_of("ship-swaying")
    data["knowledge"] = {
        "roll_error_deg": 1.0, "pitch_error_deg": -2.0, "heading_error_deg": 60.0, "position_error_m": [10.0, -20.0, 5.0],
        "velocity_error_mps": [0.1, 0.2, -0.3], "heading_sigma_deg": 70.0, "position_sigma_m": 30.0,
    }  # fmt: skip
    plant = build(parse(data), seed=5)
    expected = [1 * DEG, -2 * DEG, 60 * DEG, 10, -20, 5, 0.1, 0.2, -0.3]
    np.testing.assert_allclose(start_errors(plant), expected, rtol=1e-9, atol=1e-8)
    assert np.linalg.norm(plant.knowledge.velocity_n - expected[6:]) > 0.5  # the ship sways at time 0
    assert plant.knowledge.heading_sigma == pytest.approx(70 * DEG)
    np.testing.assert_array_equal(plant.knowledge.position_sigma, [30.0] * 3)


def test_start_errors_drawn():
    data = data_of("ship-irregular-sea")
    sigma = {"tilt_sigma_deg": 2.0, "heading_sigma_deg": 5.0, "position_sigma_m": [1.0, 2.0, 4.0], "velocity_sigma_mps": 0.5}
    data["knowledge"] = sigma
    scenario = parse(data)
    errors = np.array([start_errors(build(scenario, seed=seed)) for seed in range(150)])
    unit = errors / np.array([2 * DEG, 2 * DEG, 5 * DEG, 1, 2, 4, 0.5, 0.5, 0.5])
    assert np.abs(unit.mean(0)).max() < 0.3 and np.abs(unit.std(0) - 1).max() < 0.2
    assert np.abs(np.corrcoef(unit.T) - np.eye(9)).max() < 0.3
    # one of them given changes no other; the same seed gives the same
    data["knowledge"] = {**sigma, "pitch_error_deg": 1.0}
    other = start_errors(build(parse(data), seed=7))
    np.testing.assert_allclose(np.delete(other, 1), np.delete(errors[7], 1), atol=1e-12)
    assert other[1] == pytest.approx(1 * DEG)
    data["knowledge"] = {"draw_errors": False}
    np.testing.assert_allclose(start_errors(build(parse(data), seed=7)), 0.0, atol=1e-8)


def test_a_known_mounting_turns_what_belongs_to_the_sensor_alone():
    """A unit that lies on its side reads the body's motion in body axes; its bias is that of its own axis."""
    data = data_of("static-ecef")
    data["imu"] = {"grade": "perfect", "accel_bias_ug": [0.0, 100.0, 0.0], "mounting_angles_deg": [90.0, 0.0, 0.0]}
    plant = build(parse(data), duration_s=1.0)
    out = shown(plant, 10)
    extra = (out["delta_velocity"] - out["true_delta_velocity"]) / plant.sample_interval
    np.testing.assert_allclose(extra, np.tile([0.0, 0.0, 9.80665e-4], (10, 1)), atol=1e-12)  # the sensor's y axis points down


def test_noise_density_and_noise_per_sample():
    data = data_of("ship-swaying")
    data["rate_hz"] = 100.0
    data["imu"] = {"grade": "paper-quaternion", "gyro_arw_deg_sqrt_h": 0.01, "accel_white_ug": 30.0}
    rows = build(parse(data)).parameters
    np.testing.assert_allclose(rows["angle_random_walk"], 0.01 * DEG / 60)  # and not the grade's white noise
    np.testing.assert_allclose(rows["velocity_random_walk"], 30e-6 * 9.80665 * 0.1)  # per sample of this scenario
    data["imu"] = {"grade": "paper-quaternion", "gyro_bias_deg_h": [1.0, 2.0, 3.0]}
    rows = build(parse(data)).parameters
    np.testing.assert_allclose(rows["velocity_random_walk"], 50e-6 * 9.80665 / math.sqrt(200))  # per sample of the paper
    np.testing.assert_allclose(rows["gyro_bias"], np.array([1, 2, 3]) * DEG / 3600)
