"""Alignment and navigation as tasks: observations, rewards and actions by their documentation; who knows more scores more."""

import itertools
import sys
from sys import float_info

import gymnasium
import numpy as np
import pytest
from places import ROOT

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core.runner import make_runner
from insenv.envs import IDS, AlignmentEnv, agents, estimate_action, knowledge_of
from insenv.scenario import build, load

sys.path.insert(0, str(ROOT / "examples"))
import rank_navigators
import rank_policies

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
COMPACT = {"observation": "compact", "action": "correction"}


def test_observations_are_the_sensor_outputs_of_a_run():
    """Steps of 0.3 s, fixes of 1 Hz: a fix is new once, then the same fix grows older."""
    env = gymnasium.make(DRIVE, samples_per_step=60, duration_s=9.0).unwrapped
    observation, _ = env.reset(seed=1, options={"run_seed": 12})
    plant = build(load("car-city-drive"), seed=12)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(1800))
    known = knowledge_of(env.named(observation))
    assert known.latitude == pytest.approx(plant.knowledge.latitude, abs=1e-15)
    assert known.heading == pytest.approx(plant.knowledge.heading, abs=1e-15)
    assert known.sensors == plant.knowledge.sensors
    new, held, before = 0, 0, None
    for step in range(29):
        observation, _, _, _, info = env.step(np.eye(10)[0])
        seen, now = env.named(observation), slice(60 * step, 60 * (step + 1))
        assert np.array_equal(seen["imu"][:, 0:3], shown["delta_angle"][now])
        assert np.array_equal(seen["imu"][:, 3:6], shown["delta_velocity"][now])
        assert np.array_equal(info["q_nb"], shown["q_nb"][now][-1])
        delivered = np.flatnonzero(shown["gnss_valid"][now])
        assert seen["fix_new"] == float(len(delivered) > 0)
        if len(delivered):
            new, at = new + 1, 60 * step + delivered[-1]
            since = (60 * (step + 1) - 1 - at) * plant.sample_interval
            assert seen["fix_age"] == pytest.approx(since + shown["gnss_age"][at], abs=1e-9)
            assert seen["fix_delay"] == shown["gnss_age"][at]
            assert np.array_equal(seen["fix_velocity_n"], shown["gnss_velocity_n"][at])
            # a fix of the last 0.3 s lies near the vehicle
            assert np.linalg.norm(seen["fix_position"] - info["position"]) < 20.0
        elif new:
            held += 1
            assert seen["fix_age"] == pytest.approx(before["fix_age"] + 0.3, abs=1e-9)
            assert np.array_equal(seen["fix_position"], before["fix_position"])
        before = seen
    assert new >= 7 and held >= 15


@pytest.mark.parametrize("tilt", [0.0, 0.01])
def test_the_compact_observation_vanishes_for_the_true_attitude_and_measures_a_tilt(tilt):
    """With a perfect unit at rest; the held attitude is replaced by the truth, and by one that is tilted about east."""
    still = load("static-ecef").model_copy(update={"rate_hz": 10.0})
    env = AlignmentEnv(still, vehicle="", imu="perfect", samples_per_step=10, duration_s=300.0, sway_phases=False, **COMPACT)
    stay, place = np.array([0.0, 0.0, 0.0, -1.0]), env.setup.task.model.state.slice("held_q")
    _, info = env.reset(seed=1)
    true = info["q_nb"]
    env.step(stay)
    snapshot = env.snapshot()
    snapshot.state[place] = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(np.array([0.0, tilt, 0.0])), true)
    env.restore(snapshot)
    for _ in range(250):
        observation, *_, info = env.step(stay)
    seen = env.named(observation)
    assert seen["vertical"] == pytest.approx([-tilt, 0.0], abs=1e-5)  # up turned about east points to the south
    assert np.abs(seen["slope"]).max() < 0.1 + tilt
    # the error is fixed in the inertial frame, in which n turns with the Earth
    earth = geodesy.numeric.earth_rate_n(env.snapshot().parameters[env.setup.task.model.parameters.slice("known_latitude")][0])
    turned = attitude.numeric.rotate(attitude.numeric.from_rotation_vector(-250.0 * earth), np.array([0.0, tilt, 0.0]))
    assert info["error"] == pytest.approx(turned, abs=1e-8)


def measure_of(error, limit):
    return np.log(1.0 + np.sqrt(np.mean((error / limit) ** 2)))


def test_the_reward_of_an_alignment_follows_its_documentation():
    env = gymnasium.make(SHIP, samples_per_step=50, duration_s=5.0, time_weight=2.0, reward="dense").unwrapped
    observation, info = env.reset(seed=4)
    reported = attitude.numeric.from_euler(*env.named(observation)["known_attitude"])
    error = attitude.numeric.error_rotation_vector(reported, info["q_nb"])
    told = before = measure_of(error, info["limit"])
    assert info["measure"] == pytest.approx(told, rel=1e-9)
    total, decisions = 0.0, 20
    for step in range(decisions):
        q_nb = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(np.array([0.0, 0.0, 0.01])), info["q_nb"])
        _, reward, terminated, truncated, info = env.step(estimate_action(env.setup.task, q_nb))
        assert info["error"] == pytest.approx([0.0, 0.0, 0.01], abs=1e-12)
        measure = measure_of(info["error"], info["limit"])
        assert info["measure"] == pytest.approx(measure, rel=1e-9)
        assert reward == pytest.approx(before - measure - 2.0 / decisions, rel=1e-8)
        before = measure
        assert not terminated and truncated == (step == decisions - 1)
        total += reward
    assert total == pytest.approx(told - measure - 2.0, rel=1e-8)


def test_declaring_ends_an_alignment_and_stops_the_cost_of_time():
    """A perfect estimate costs only the time of one step, and stating what was reported returns nothing."""
    env = gymnasium.make(SHIP, samples_per_step=50, duration_s=10.0, reward="dense").unwrapped
    for perfect in (True, False):
        observation, info = env.reset(seed=4)
        told = info["measure"] if perfect else 0.0
        stated = info["q_nb"] if perfect else attitude.numeric.from_euler(*env.named(observation)["known_attitude"])
        _, reward, terminated, truncated, info = env.step(estimate_action(env.setup.task, stated, declare=1.0))
        assert terminated and not truncated and info["declared"] == 1.0
        assert reward == pytest.approx(told - 1.0 / 40.0, abs=1e-6)


def test_the_reward_of_a_navigation_counts_nine_components():
    """-ln(1 + sqrt(mean((e / s)^2))) / T with e of attitude, velocity and position, each off on its own."""
    env = gymnasium.make(DRIVE, samples_per_step=20, duration_s=2.0, reward="dense").unwrapped
    _, info = env.reset(seed=4)
    for k in (0, 1, 2, 4, 5, 6, 8):
        e = 0.5 * info["limit"]
        e[k] *= 20.0
        q_nb = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(e[:3]), info["q_nb"])
        velocity, position = info["velocity_n"] + e[3:6], info["position"] + e[6:9]
        action = estimate_action(env.setup.task, q_nb, velocity_n=velocity, position=position)
        _, reward, terminated, _, info = env.step(action)
        assert not terminated and info["error"] == pytest.approx(e, rel=1e-3, abs=1e-9)
        assert reward == pytest.approx(-measure_of(e, info["limit"]) / 20.0, rel=1e-3)


@pytest.mark.parametrize("id", [IDS[0], *(pytest.param(id, marks=pytest.mark.slow) for id in IDS[1:3]), IDS[3], *IDS[-3:]])
def test_the_end_pays_what_dense_rewards_pay_on_the_way(id):
    """Until then a step costs its time; the score of an alignment lacks the measure of the report."""
    envs = [gymnasium.make(id, **SHORT, reward=reward) for reward in ("final", "dense")]
    action, paid, told, steps = np.full(envs[0].action_space.shape, -0.01), {}, 0.0, envs[0].unwrapped.setup.decisions
    for env in envs:
        _, info = env.reset(seed=2)
        told = info["measure"] if "Alignment" in id else 0.0
        paid[env] = [env.step(action)[1] for _ in range(steps)]
    final, dense = paid.values()
    assert len(np.unique(final[:-1])) == 1 and len(np.unique(dense)) == steps > 3
    assert final[0] == (-1.0 / steps if "Alignment" in id or "Manoeuvre" in id else 0.0)
    assert sum(final) == pytest.approx(sum(dense) - told, rel=1e-9)


def test_a_reward_of_ones_own_is_a_function_of_the_info():
    """Of one row at a time; a row that has just restarted gets none."""
    own = {**SHORT, "reward": lambda info: -abs(info["error"][2])}
    venv, env = gymnasium.make_vec(SHIP, 2, **own), gymnasium.make(SHIP, **own)
    for each in (venv, env):
        each.reset(seed=3)
    actions = np.array([[1.0, 0.0, 0.0, 0.2, -1.0], [1.0, 0.0, 0.0, 0.2, 1.0]])
    _, rewards, terminated, _, infos = venv.step(actions)
    assert np.array_equal(rewards, -np.abs(infos["error"][:, 2])) and terminated.tolist() == [False, True]
    assert env.step(actions[0])[1] == rewards[0] and venv.step(actions)[1][1] == 0.0
    env = gymnasium.make(SHIP, **{**own, "reward": lambda info: info["error"]})
    env.reset(seed=3)
    with pytest.raises(InputError, match=r"reward\(info\) = array\(.*: allowed is a finite number"):
        env.step(actions[0])


@pytest.mark.parametrize("id", [SHIP, DRIVE])
def test_an_invalid_estimate_ends_the_episode_with_a_finite_reward(id):
    for env in (gymnasium.make(id, **SHORT), gymnasium.make_vec(id, 3, **SHORT)):
        for fault in (0.0, np.nan, np.inf, -np.inf):
            env.reset(seed=1)
            action, lowest = np.zeros(env.action_space.shape), -21.0 if id == SHIP else -20.0
            action[..., -1] = fault
            action[..., 0] = 0.0 if fault == 0.0 else 1.0
            _, reward, terminated, truncated, info = env.step(action)
            assert reward == pytest.approx(lowest)
            assert np.all(terminated) and not np.any(truncated)
            assert np.all(info["diverged"] == 1.0) and np.isfinite(info["error"]).all()


@pytest.mark.parametrize("id", [SHIP, DRIVE])
def test_an_action_outside_the_space_is_clipped_and_a_quaternion_normalized(id):
    env, found = gymnasium.make(id, **SHORT), []
    for scale, beyond in ((1.0, 1.0), (7.0, 3.0), (1e200, 1e200), (2.0**1023, float_info.max)):
        env.reset(seed=1)
        action = np.full(env.action_space.shape, -beyond)
        action[:4] = scale * np.array([0.5, -0.25, 0.75, 0.125])
        *_, info = env.step(action)
        assert info["diverged"] == 0.0
        found.append(info["error"])
    assert found[1] == pytest.approx(found[0], rel=1e-12) and found[2] == pytest.approx(found[0], rel=1e-12)


def test_a_correction_turns_the_held_attitude_on_a_logarithmic_scale():
    env = gymnasium.make(SHIP, samples_per_step=20, duration_s=10.0, **COMPACT).unwrapped
    env.reset(seed=1)
    place = env.setup.task.model.state.slice("held_q")
    env.step(np.array([0.0, 0.0, 0.0, -1.0]))
    half = 5.8e-4 * (np.sqrt(1.0 + np.pi / 5.8e-4) - 1.0)
    for action, expected in (([1.0, 0, 0], [0.8, 0, 0]), ([0, -1.0, 0], [0, -0.8, 0]), ([0, 0, 0.5], [0, 0, half])):
        before = env.snapshot().state[place]
        env.step(np.array([*action, -1.0]))
        turned = attitude.numeric.error_rotation_vector(env.snapshot().state[place], before)
        assert turned == pytest.approx(expected, rel=1e-9, abs=1e-12)
    for declare, over in ((0.8, False), (0.95, True)):
        *_, terminated, _, info = env.step(np.array([0.0, 0.0, 0.0, declare]))
        assert terminated == over and info["declared"] == float(over)


ORDER = ("random", "quit", "analytic", "frozen frame", "q-method")
BETTER = (
    ("random", "reported start"), ("random", "wander-sins"), ("reported start", "fixes"), ("wander-sins", "fixes"),
    ("fixes", "loosely-coupled"),
)  # fmt: skip
"""Worse and better.  A tilt of 0.5 deg ruins free-inertial navigation within minutes: it may lose against standing still."""


@pytest.mark.slow
@pytest.mark.parametrize("id", [id for id in IDS if "Alignment" in id])
def test_the_ranking_of_policies_that_align(id, monkeypatch):
    """Whoever knows more scores more, seed by seed, and nothing beats the sensors."""
    monkeypatch.delenv("INSENV_BACKEND")
    found = rank_policies.ranking(id, 64, seed=1)
    assert tuple(found)[:5] == ORDER
    for worse, better in itertools.pairwise(ORDER):
        gain = found[better] - found[worse]
        error = np.std(gain) / np.sqrt(64)
        # on a parked vehicle the frozen frame ties with the q-method
        least = -3.0 * error if better == "q-method" else 3.0 * error
        assert gain.mean() > least, f"{id}: {better} gains {gain.mean():.3f} +- {error:.3f} over {worse}"
    (_, frozen), (early, q_method), (_, bound) = list(found.items())[5:]
    assert early.startswith("q-method, ") and q_method.mean() > found["q-method"].mean() + 0.2
    for score in (frozen, q_method, found["q-method"]):
        assert score.mean() < bound[0] + 3.0 * np.std(score) / np.sqrt(64)


def test_the_bound_is_that_of_errors_of_the_limit():
    """At the end the mean of ln(1 + rms of three normals), by a numerical integral over the Maxwell distribution."""
    venv = gymnasium.make_vec(SHIP, 1, samples_per_step=20, duration_s=20.0)
    found, rms = rank_policies.bound(venv), np.linspace(0.0, 6.0, 60_001)
    density = np.sqrt(2.0 / np.pi) * 3.0**1.5 * rms**2 * np.exp(-1.5 * rms**2)
    expected = np.sum(np.log1p(rms) * density) * (rms[1] - rms[0])
    assert found[-1] == pytest.approx(-expected - 1.0, abs=0.01)  # 4 sigma, and the limit of 19.9 s is that of 20 s + 0.3 %


@pytest.mark.slow
@pytest.mark.parametrize("id", [id for id in IDS if "Navigation" in id])
def test_the_ranking_of_policies_that_navigate(id, monkeypatch):
    """Whoever uses more of what is measured scores more, seed by seed, and the best one is near the limit."""
    monkeypatch.delenv("INSENV_BACKEND")
    found = rank_navigators.ranking(id, 64, seed=1, duration_s=300.0)
    for worse, better in BETTER:
        gain = found[better] - found[worse]
        error = np.std(gain) / np.sqrt(64)
        assert gain.mean() > 3.0 * error, f"{id}: {better} gains {gain.mean():.3f} +- {error:.3f} over {worse}"
    # the limit is a root mean square over the run: errors that change in time may score a little more than steady ones
    assert abs(found["loosely-coupled"].mean() - rank_navigators.at_the_limit()) < 0.25


def test_reported_headings_are_wrapped():
    """At a sigma of 360 deg a reported heading may be beyond a full turn, which no estimator takes."""
    venv = gymnasium.make_vec(SHIP, 64, **SHORT, initial_error=(30.0, 360.0))
    observation, info = venv.reset(seed=1)
    known = venv.unwrapped.named(observation)["known_attitude"]
    assert np.abs(known).max() <= 2.0 * np.pi and np.abs(known[:, 2]).max() > np.pi
    venv.step(agents.make("gyrocompass", venv).act(observation, info))
