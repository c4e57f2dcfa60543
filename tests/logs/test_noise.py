"""The unit of a log without a grade: noise from the log itself, biases by class."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from changed_scenario import changed
from simulated_log import simulated_log

from insenv.logs.noise import densities_in_motion, in_motion, noise_at_rest, noise_in_motion
from insenv.logs.recorded import Source
from insenv.runs.log_remarks import noise_in_motion as noise_remark
from insenv.sensors import imu_grade

DENSITY = 2e-4


def white(rate_hz, seconds=60.0):
    """Increments (n, 3) of white noise of DENSITY."""
    n = round(rate_hz * seconds)
    return np.random.default_rng(1).normal(0.0, DENSITY * rate_hz**-0.5, (n, 3))


@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 1000.0])
@pytest.mark.parametrize("estimate", [noise_at_rest, noise_in_motion])
def test_white_noise_is_found_at_any_rate(estimate, rate_hz):
    assert 0.8 * DENSITY < estimate(white(rate_hz), 1 / rate_hz) < 1.25 * DENSITY


def test_an_engine_rocking_and_a_knock_are_no_noise_at_rest():
    n, dt = 6000, 0.005
    time = np.arange(n) * dt
    rate = white(200.0, 30.0) / dt
    rate[:, 0] += 5e-3 * np.sin(2 * np.pi * 30.0 * time) + 5e-3 * np.sin(2 * np.pi * 0.5 * time)  # 25 and 25 times the noise
    rate[2000:2020] += 0.5
    assert noise_at_rest(rate * dt, dt) < 2.0 * DENSITY


def test_the_motion_of_a_ship_is_no_noise():
    """Rates of 10 deg/s and a gyro of 0.002 deg/sqrt(h)."""
    time = np.arange(0.0, 120.0, 0.005)
    sway = np.radians(10.0) * np.stack([np.sin(time), np.sin(0.8 * time), np.cos(0.6 * time)], axis=1)
    quiet = np.radians(0.002) / 60
    increments = sway * 0.005 + white(200.0, 120.0) * (quiet / DENSITY)
    assert 0.9 * quiet < noise_in_motion(increments, 0.005) < 1.5 * quiet


def test_the_rolling_of_an_aircraft_is_no_noise_of_its_gyros():
    """2 Hz, 20 deg/s, which fourth differences over 0.08 s show; of accelerometers they count."""
    log, rolling = flying(0.0), np.radians(20.0) * 0.005 * np.sin(4.0 * np.pi * np.arange(24000) * 0.005)
    everywhere, increments = np.ones(24000, bool), white(200.0, 120.0) + np.outer(rolling, [1.0, 0.0, 0.0])
    rolls = replace(log, delta_angle=increments, delta_velocity=increments)
    found = {flies: densities_in_motion(rolls, everywhere, flies) for flies in (True, False)}
    assert found[True]["angle_random_walk"] < 0.25 * found[False]["angle_random_walk"]
    assert found[True]["velocity_random_walk"] == found[False]["velocity_random_walk"] == found[False]["angle_random_walk"]
    raised = {kind: replace(rolls, description=rolls.description.model_copy(update={"vehicle_kind": kind})).raised_noise
              for kind in ("aircraft", "multirotor", "car", "")}  # fmt: skip
    raised["flight"] = replace(rolls, sources=(Source("flight", "a.bin", 1, 1, ""),)).raised_noise
    largest = {kind: np.max(rows["angle_random_walk"]) for kind, rows in raised.items()}
    assert largest["aircraft"] == largest["multirotor"] == largest["flight"] < 0.25 * largest["car"] == 0.25 * largest[""]


def still_car(grade):
    calm = {"engine": (), "wind_roll_sigma_deg": 0.0, "wind_pitch_sigma_deg": 0.0}
    return changed("car-city-drive", imu={"grade": grade}, vehicle=calm)


@pytest.mark.parametrize(("grade", "assumed"), [("marine", "tactical"), ("consumer", "consumer"), ("perfect", "consumer")])
def test_the_class_is_one_coarser_than_the_noise_suggests(grade, assumed):
    log = simulated_log(still_car(grade), duration_s=25.0, initial={"static_until_s": 25.0})
    assert log.assumed is not None and f"class {assumed!r}" in log.assumed.remark
    own, taken = imu_grade(grade).parameters(), log.sensors(in_place=True)
    for name in ("gyro_bias_sigma", "accel_bias_sigma"):
        assert getattr(taken, name) >= np.max(own[name]), name
    for triad, error in (("gyro", "rotation_error"), ("accel", "thrust_error")):
        assert log.motion_errors()[error] >= max(own[f"{triad}_scale_factor_sigma"], own[f"{triad}_misalignment_sigma"])
    if grade != "perfect":
        assert taken.angle_random_walk == pytest.approx(float(np.max(own["angle_random_walk"])), rel=0.3)
        assert taken.velocity_random_walk == pytest.approx(float(np.max(own["velocity_random_walk"])), rel=0.3)


@cache
def flying(shake, seconds=120.0, dt=0.01):
    """A log whose second half moves at 20 m/s, with white noise of `shake` (m/s^1.5) on the accelerometers there."""
    log = simulated_log(still_car("tactical"), duration_s=seconds, grade="tactical", initial={"static_until_s": 25.0})
    half = log.imu_time > seconds / 2
    noise = np.random.default_rng(4).normal(size=log.delta_velocity.shape) * shake * np.sqrt(dt)
    velocity = np.where((log.gnss.time > seconds / 2)[:, None], [20.0, 0.0, 0.0], 0.0)
    gnss = replace(log.gnss, velocity_n=velocity, velocity_sigma=np.full(velocity.shape, 0.1))
    return replace(log, gnss=gnss, delta_velocity=log.delta_velocity + half[:, None] * noise)


def test_noise_in_motion_is_that_of_the_moving_part():
    shaken = flying(0.05)
    raised = shaken.raised_noise["velocity_random_walk"]
    assert float(np.max(raised)) == pytest.approx(0.06, rel=0.2)  # the car itself shakes
    assert shaken.sensors(in_place=False).velocity_random_walk == pytest.approx(float(np.max(raised)), rel=1e-3)
    at_rest = shaken.sensors(in_place=True).velocity_random_walk
    assert at_rest < 0.01 and at_rest == shaken.sensors(in_place=False).standing_velocity_random_walk
    (said,) = noise_remark(shaken)
    assert said.code == "noise-in-motion" and f"accelerometers {60 * float(np.max(raised)):.2g} m/s/sqrt(h)" in said
    imu = shaken.description.imu.model_copy(update={"noise_in_motion": False})
    calm = replace(shaken, description=shaken.description.model_copy(update={"imu": imu}))
    assert calm.raised_noise == {} and noise_remark(calm) == ()


def test_what_hovers_moves_although_it_has_no_speed():
    log, none = flying(1.0), np.zeros(0)
    half = log.imu_time > 60.0
    by_speed = in_motion(log, log.gnss.time, np.hypot(*log.gnss.velocity_n[:, :2].T))
    for moving in (by_speed, in_motion(log, none, none), in_motion(log, log.gnss.time, 0.0 * log.gnss.time)):
        assert np.mean(moving[half]) > 0.95 and np.mean(moving[~half]) < 0.05
    assert not in_motion(flying(0.0), none, none).any()
