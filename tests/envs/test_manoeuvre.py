"""`insenv/Manoeuvre-v0`: the vehicle follows its commands, and the reward is the gain in knowledge of the heading."""

import gymnasium
import numpy as np
import pytest

from insenv import attitude
from insenv.base.resources import scenario_folder
from insenv.base.toml import read_toml
from insenv.core.runner import make_runner
from insenv.envs import ManoeuvreEnv, testing
from insenv.scenario import build, parse

ID = "insenv/Manoeuvre-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
SCENARIO = {"imu": None, "start_speed_mps": (12.0, 12.0), "samples_per_step": 200}
"""The unit and the start speed of the scenario, which the default draws, and steps of one second."""


PARKED = read_toml(scenario_folder() / "car-parked.toml") | {
    "rate_hz": 50.0,
    "gnss": {"grade": "rtk"},
    "knowledge": {"heading_sigma_deg": 20.0},
    "vehicle": {"kind": "car", "wind_roll_sigma_deg": 0.02},
    "estimator": {"aqe-ekf": {"rotation_error": 0.0}},  # half turns there and back make no white noise
}


@pytest.fixture(scope="module")
def car():
    """An environment with steps of one second and a goal out of reach."""
    return ManoeuvreEnv(goal_deg=1e-3, duration_s=40.0, reward="uncertainty", **SCENARIO)


def driven(env, pattern, seconds, seed):
    """Return the infos of the first seconds of an episode by name, (seconds, ...)."""
    env.reset(seed=seed)
    infos = [env.step(np.array(pattern(k), dtype=float))[4] for k in range(seconds)]
    return {name: np.array([info[name] for info in infos]) for name in infos[0]}


@pytest.mark.slow
def test_a_turntable_and_another_reward_conform():
    testing.check_id(ID, **SHORT, scenario=PARKED, reward="dense", estimator="loosely-coupled")


@pytest.mark.slow
def test_manoeuvres_beat_driving_straight(car):
    patterns = {"straight": lambda k: (0, 0), "S-turns": lambda k: (0, 1 if k % 16 < 8 else -1)}
    found = {name: [driven(car, pattern, 30, seed) for seed in range(3)] for name, pattern in patterns.items()}
    sigma = {name: np.degrees([run["heading_sigma"][-1] for run in runs]) for name, runs in found.items()}
    error = {name: np.degrees(np.abs([run["heading_error"][-1] for run in runs])) for name, runs in found.items()}
    assert np.all(sigma["straight"] > 10.0) and np.all(sigma["S-turns"] < 0.3)
    assert np.all(error["S-turns"] < 5 * sigma["S-turns"]) and np.max(error["straight"]) > 10.0


def test_the_reward_is_the_fall_of_the_stated_sigma(car):
    car.reset(seed=2)
    known = car.setup.task.model.parameters.unpack(car.snapshot().parameters)["known_heading_sigma"]
    total = 0.0
    for k in range(6):
        _, reward, terminated, _, info = car.step(np.array([1.0, 0.5 * (k % 2)]))
        total += reward
        assert not terminated
        if k == 0:
            begun = float(car.setup.task.model.state.unpack(car.snapshot().state)["level_before"])
    assert total == pytest.approx(begun - np.log(info["heading_sigma"]) - 6.0 / 40.0, rel=1e-9)
    # for a normal heading error the filter keeps the second moment of its sine, at most 1/2
    assert begun == pytest.approx(np.log(2 * np.sqrt(0.5 * (1 - np.exp(-0.5 * known**2)))), rel=1e-3)


def test_the_reward_by_error_is_the_fall_of_the_true_error():
    env = ManoeuvreEnv(reward="dense", goal_deg=2.0, time_weight=0.5, duration_s=20.0, **SCENARIO)
    _, before = env.reset(seed=4)
    for _ in range(4):
        _, reward, terminated, _, info = env.step(np.array([1.0, 0.0]))
        fall = 0.5 * np.log(
            (before["heading_error"] ** 2 + info["goal"] ** 2) / (info["heading_error"] ** 2 + info["goal"] ** 2)
        )
        assert reward == pytest.approx(fall - 0.5 / 20.0, rel=1e-9)
        assert info["heading_error"] == pytest.approx(info["error"][2], abs=0.05)  # to second order in the tilts
        before = info
        if terminated:
            break


def test_a_divergence_costs_the_same_whether_the_fall_is_paid_at_each_step_or_at_the_end():
    totals = []
    for reward in ("dense", "final"):
        env = ManoeuvreEnv(reward=reward, goal_deg=2.0, time_weight=0.5, duration_s=20.0, **SCENARIO)
        env.reset(seed=4)
        results = [env.step(np.array([1.0, across])) for across in (0.0, 1.0, np.nan)]
        assert [result[2] for result in results] == [False, False, True] and results[-1][4]["diverged"]
        totals.append(sum(result[1] for result in results))
    assert totals[0] == pytest.approx(totals[1], rel=1e-9) and totals[0] < -9.0


def test_the_goal_ends_the_episode():
    env = ManoeuvreEnv(goal_deg=2.0, duration_s=40.0, **SCENARIO)
    env.reset(seed=1)
    for k in range(40):
        _, _, terminated, truncated, info = env.step(np.array([0.0, 1.0 if k % 16 < 8 else -1.0]))
        assert terminated == (info["heading_sigma"] < np.radians(2.0)) == bool(info["reached"])
        assert not truncated
        if terminated:
            break
    assert 3 < k < 15 and info["goal"] == np.radians(2.0)


def test_the_car_follows_its_commands(car):
    speed = np.linalg.norm(driven(car, lambda k: (0.0, 0.0), 4, 1)["velocity_n"], axis=1)
    assert speed == pytest.approx(12.0, abs=0.05)
    faster = np.linalg.norm(driven(car, lambda k: (0.5, 0.0), 4, 1)["velocity_n"], axis=1)
    assert np.diff(faster)[1:] == pytest.approx(1.5, abs=0.1)
    stopped = np.linalg.norm(driven(car, lambda k: (-1.0, 0.0), 9, 1)["velocity_n"], axis=1)
    assert stopped[-1] < 0.05
    turned = driven(car, lambda k: (0.0, 1.0), 6, 1)
    heading = np.unwrap([attitude.numeric.to_euler(q)[2] for q in turned["q_nb"]])
    assert np.diff(heading)[2:] == pytest.approx(3.0 / 12.0, rel=0.02)  # across over along, per second
    left = driven(car, lambda k: (0.0, -30.0), 6, 1)  # clipped to -1
    assert np.diff(np.unwrap([attitude.numeric.to_euler(q)[2] for q in left["q_nb"]]))[2:] == pytest.approx(-0.25, rel=0.02)


def test_an_aircraft_banks_climbs_and_keeps_its_speeds():
    env = ManoeuvreEnv("aircraft-inflight-alignment", goal_deg=1e-3, duration_s=40.0, samples_per_step=100, imu=None,
                       start_speed_mps=(80.0, 80.0))  # fmt: skip
    found = driven(env, lambda k: (1.0, 1.0, 0.5), 28, 1)
    angles = np.array([attitude.numeric.to_euler(q) for q in found["q_nb"]])
    assert np.linalg.norm(found["velocity_n"][-1, :2]) > 100.0
    assert -found["velocity_n"][-1, 2] == pytest.approx(5.0, abs=1.0)
    assert angles[-1, 0] == pytest.approx(0.7, abs=0.05)
    rate = np.diff(np.unwrap(angles[:, 2]))[-1]
    assert rate == pytest.approx(9.80665 * np.tan(0.7) / np.linalg.norm(found["velocity_n"][-1, :2]), rel=0.1)
    slow = driven(env, lambda k: (-1.0, 0.0, 0.0), 14, 1)
    assert np.linalg.norm(slow["velocity_n"][-1, :2]) == pytest.approx(60.0, abs=1.0)


def test_a_turntable_changes_the_heading_only():
    env = ManoeuvreEnv(PARKED, samples_per_step=50, duration_s=60.0, goal_deg=1e-3)
    env.reset(seed=1, options={"run_seed": 5})
    plant = build(parse(PARKED, "parked", "parked"), seed=5)
    still = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(100))
    for k in range(2):
        *_, info = env.step(np.zeros(1))
        assert info["q_nb"] == pytest.approx(still["q_nb"][50 * k + 49], abs=1e-14)
    state = env.setup.task.model.state.unpack(env.snapshot().state)
    for name in ("delta_angle", "delta_velocity"):
        assert state[name] == pytest.approx(still[name][-1], abs=1e-14)
    before = attitude.numeric.to_euler(info["q_nb"])
    for _ in range(15):
        *_, info = env.step(np.array([0.5]))
    after = attitude.numeric.to_euler(info["q_nb"])
    turned = np.degrees(after[2] - before[2])
    assert turned == pytest.approx(90.0, abs=0.01)
    assert np.linalg.norm(info["velocity_n"]) < 1e-6
    assert np.degrees(np.abs(np.subtract(after[:2], before[:2]))).max() < 0.2  # caused by the wind


def test_unit_heading_and_start_speed_are_drawn():
    env = gymnasium.make_vec(ID, 64, **SHORT)
    _, info = env.reset(seed=3)
    speed = np.linalg.norm(info["velocity_n"], axis=1)
    heading = attitude.numeric.to_euler(info["q_nb"])[2]
    known = env.unwrapped.setup.task.model.parameters.unpack(env.unwrapped.snapshot().parameters)
    assert speed.min() > 1.99 and speed.max() < 12.01 and np.ptp(speed) > 8.0
    assert np.ptp(heading) > 5.0 and len(np.unique(known["known_angle_random_walk"])) > 32
    _, info = env.reset(seed=3, options={"run_seed": 5})
    assert np.linalg.norm(info["velocity_n"], axis=1) == pytest.approx(12.0, abs=1e-3)  # that of the scenario
