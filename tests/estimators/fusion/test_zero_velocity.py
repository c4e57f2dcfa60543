"""Detection of rest from the inertial unit and the filter's velocity: never in motion, nearly always at rest."""

import numpy as np
import pytest
from constants import constants, number
from driven import columns_of, fed
from resting import samples

from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.estimators.fusion import zero_velocity
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows

MODEL = get("loosely-coupled").model
FLAG = MODEL.state.slice("standing_now").start
WINDOW = 60  # samples: one second


def drive(seed, duration_s=260.0, **tuning):
    """(largest speed, whether rest was detected) by windows of a second."""
    plant = build(load("car-city-drive").model_copy(update={"rate_hz": float(WINDOW)}), seed=seed, duration_s=duration_s)
    columns = columns_of(plant)
    tuned = {**plant.tunings["loosely-coupled"], **tuning}
    runner = make_runner(MODEL, {**get("loosely-coupled").parameters(plant.knowledge), **tuned})
    rows = input_rows(MODEL, columns, plant.samples)
    found = np.zeros(plant.samples, bool)
    for k in range(0, plant.samples, WINDOW):  # a window ends with its last sample, which tells
        runner.run(WINDOW, rows[k : k + WINDOW], 0)
        found[k + WINDOW - 1] = runner.x[FLAG] != 0
    speed = np.linalg.norm(columns["velocity_n"], axis=1).reshape(-1, WINDOW).max(axis=1)
    return speed, found.reshape(-1, WINDOW).any(axis=1)


def test_stops_are_detected_and_motion_never_is():
    speed, found = drive(7)
    at_rest = speed < 0.02
    assert at_rest.sum() > 40 and (~at_rest).sum() > 150
    assert found[at_rest].mean() > 0.9
    assert not found[speed > 0.05].any()


def still(count, dt, velocity_n=(0.0, 0.0, 0.0), vibration=0.0, **parameters):
    """The flag after `count` samples of a level unit at a constant velocity, with vibration (m/s^2)."""
    latitude = 0.6
    columns = samples([1.0, 0, 0, 0], latitude, count * dt, dt, accel_noise=vibration)
    known = {"start_latitude": latitude, "start_velocity_n": velocity_n, "tilt_sigma": 1e-3, "velocity_sigma": 0.1}
    return fed(MODEL, columns, {**known, **parameters}, "interpreter").x[FLAG] != 0


def test_conditions_of_rest():
    """100 Hz, last sample of the window: rest; a smooth ride at 5 m/s, which looks like it; too large a vibration."""
    assert still(100, 0.01)
    assert not still(100, 0.01, velocity_n=(5.0, 0.0, 0.0))
    assert still(100, 0.01, vibration=0.04)
    assert not still(100, 0.01, vibration=0.2)
    assert not still(100, 0.01, standing_window=0.0)
    assert not still(99, 0.01)


@pytest.mark.parametrize("dt", [0.002, 0.05])
def test_likelihood_is_that_of_its_formula_at_any_rate(dt):
    """L of random rates and forces; about 2 where they are those that the filter allows for, at every rate."""
    rng, n = np.random.default_rng(0), 400
    walk, swing = (2e-3, 0.03), (1e-4, 4e-3)
    force = rng.normal(size=(n, 3)) * np.hypot(walk[0] / np.sqrt(dt), walk[1]) + [0.3, -0.2, -9.8]
    rate = rng.normal(size=(n, 3)) * np.hypot(swing[0] / np.sqrt(dt), swing[1])
    p = {"velocity_random_walk": walk[0], "standing_force": walk[1], "angle_random_walk": swing[0], "standing_rate": swing[1]}
    x = {
        "still_samples": n, "still_time": n * dt, "still_angle_square": np.sum((rate * dt) ** 2),
        "still_velocity": np.sum(force * dt, axis=0), "still_velocity_square": np.sum((force * dt) ** 2),
    }  # fmt: skip
    found = number(zero_velocity.likelihood(constants(MODEL.parameters, **p), constants(MODEL.state, **x)))
    scatter = np.mean(np.sum((force - force.mean(axis=0)) ** 2, axis=1))
    expected = scatter / (3 * (walk[0] ** 2 / dt + walk[1] ** 2)) + np.mean(np.sum(rate**2, axis=1)) / (
        3 * (swing[0] ** 2 / dt + swing[1] ** 2)
    )
    assert found == pytest.approx(expected, rel=1e-6) and found == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize(("sigma", "explained"), [
    ({}, 0.0), ({"tilt": (2e-3, 0.0, 0.0)}, 2e-3 * 9.80665), ({"tilt": (0.0, 2e-3, 0.0)}, 2e-3 * 9.80665),
    ({"accel": (0.0, 0.0, 0.03)}, 0.03), ({"accel": (0.03, 0.0, 0.0)}, 0.03),
    ({"tilt": (0.0, 0.0, 3.0)}, 0.0),  # a heading error turns no gravity
])  # fmt: skip
def test_a_change_of_velocity_is_explained_by_errors_of_level_and_accelerometers_alone(sigma, explained):
    """A quiet window of 2 s at rest, whose velocity changes by up to three standard deviations of what the filter states."""
    states = np.zeros(15)
    states[3:6], states[6:9], states[12:15] = 0.02, sigma.get("tilt", 0.0), sigma.get("accel", 0.0)
    allowed = 3 * np.hypot(0.01, 2.0 * explained)
    for share, rest in ((0.98, True), (1.02, False)):
        x = {
            "still_samples": 100, "still_time": 2.0,
            "still_velocity": [0.0, 0.0, -19.6], "still_velocity_square": 19.6**2 / 100,
            "still_change_w": [0.0, share * allowed, 0.0], "covariance": symmetric.triangle_of_diagonal(states**2),
        }  # fmt: skip
        p = constants(MODEL.parameters, standing_sigma=0.01)
        found = zero_velocity.detected(p, constants(MODEL.state, **x), None)["standing_now"]
        assert bool(number(found)) == rest, share


@pytest.mark.parametrize(("sigma", "speed", "rest"), [
    (0.69, 0.0, True), (0.71, 0.0, False),  # UNCERTAIN: 0.7 m/s
    (0.5, 1.48, True), (0.5, 1.52, False),  # GATE: three standard deviations
])  # fmt: skip
@pytest.mark.parametrize("axis", range(3))
def test_rest_needs_a_velocity_that_is_known_and_near_zero(axis, sigma, speed, rest):
    """A quiet window of a filter whose velocity along one axis is known to `sigma`, m/s, and estimated as `speed`."""
    states, velocity = np.zeros(15), np.zeros(3)
    states[3:6], states[3 + axis], velocity[axis] = 0.02, sigma, speed
    x = {
        "still_samples": 100, "still_time": 1.0, "still_velocity": [0.0, 0.0, -9.8], "still_velocity_square": 9.8**2 / 100,
        "velocity_w": velocity, "covariance": symmetric.triangle_of_diagonal(states**2),
    }  # fmt: skip
    found = zero_velocity.detected(constants(MODEL.parameters, standing_sigma=1e-3), constants(MODEL.state, **x), None)
    assert bool(number(found["standing_now"])) == rest


@pytest.mark.slow
def test_a_filter_that_does_not_know_its_speed_takes_no_ride_for_rest():
    """A poor unit in an outage of 60 s, where zero is within three sigma of any speed: it once ended 1.8 km wrong."""
    poor = {"gyro_bias_sigma": 0.017, "accel_bias_sigma": 0.5, "angle_random_walk": 3e-4, "velocity_random_walk": 4e-3}
    motion = {"rotation_error": 0.03, "thrust_error": 0.05, "gyro_correlation_time": 4e6, "accel_correlation_time": 1e4}
    speed, found = drive(101, 600.0, **poor, **motion)
    assert not found[speed > 2.1].any()
    assert found[:30].any()
