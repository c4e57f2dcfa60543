"""The estimators as agents: in the loop they give the results of `insenv run` and reach their limits."""

import gymnasium
import numpy as np
import pytest

from insenv import attitude, estimators, geodesy, run
from insenv.envs import agents
from insenv.errors import InputError
from insenv.scenario import load

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"


def episode(env, agent, **reset):
    """Return, last action and last info of an episode."""
    observation, info = env.reset(**reset)
    total, over = 0.0, False
    while not over:
        action = agent.act(observation, info)
        observation, reward, terminated, truncated, info = env.step(action)
        total, over = total + reward, terminated or truncated
    return total, agent.act(observation, info), info


@pytest.mark.parametrize("id", ["analytic", "q-method", "qakf-improved", "ecef-kf", "gyrocompass"])
def test_an_agent_is_bit_identical_to_the_estimator_of_a_run(id):
    env = gymnasium.make(SHIP, samples_per_step=250, duration_s=30.0)
    _, action, _ = episode(env, agents.make(id, env), seed=1, options={"run_seed": 6})
    q_nb = run(load("ship-swaying"), [id], seed=6, duration_s=30.0).results[0].outputs["q_nb"][-1]
    # BLAS rounds a norm as its processor likes
    np.testing.assert_allclose(action[:4], q_nb / np.linalg.norm(q_nb), rtol=1e-15)


def test_a_navigating_agent_is_the_filter_of_a_run():
    env = gymnasium.make(DRIVE, samples_per_step=130, duration_s=65.0)
    _, action, info = episode(env, agents.make("loosely-coupled", env), seed=1, options={"run_seed": 3})
    result = run(load("car-city-drive"), ["loosely-coupled"], seed=3, duration_s=65.0).results[0]
    # fixes pass through metres from the reference, which rounds latitude to about a nanometre
    assert action[:4] == pytest.approx(result.outputs["q_nb"][-1], abs=1e-9)
    known = env.unwrapped.named(env.reset(options={"run_seed": 3})[0])
    reference = (known[f"known_{name}"] for name in ("latitude", "longitude", "height"))
    found = geodesy.numeric.ned_offset(*(result.outputs[name][-1] for name in ("latitude", "longitude", "height")), *reference)
    assert action[7:10] * 1e6 == pytest.approx(found, abs=1e-6)
    assert action[4:7] * 1e3 == pytest.approx(result.outputs["velocity_n"][-1], abs=1e-8)
    assert np.abs(found - info["position"]).max() < 4 * info["limit"][6:9].max()


@pytest.mark.parametrize(
    ("env_id", "id", "declared"),
    [
        (SHIP, "qakf-improved", None),
        pytest.param("insenv/VehicleAlignment-v0", "q-method", None, marks=pytest.mark.slow),
        pytest.param("insenv/AircraftAlignment-v0", "q-method", None, marks=pytest.mark.slow),
        (SHIP, "q-method", 200.0),
    ],
)
def test_a_baseline_reaches_its_limit_inside_the_loop(env_id, id, declared):
    rows = 24
    # in a tilted unit scale factors act as well, which the limit does not contain
    venv = gymnasium.make_vec(env_id, rows, samples_per_step=200, mounting_deg=None, threads=2)
    agent = agents.make(id, venv, declare_after_s=declared, threads=2)
    observation, info = venv.reset(seed=500)
    done, errors = np.zeros(rows, dtype=bool), np.zeros((rows, 3))
    while not done.all():
        observation, _, terminated, truncated, info = venv.step(agent.act(observation, info))
        over = (terminated | truncated) & ~done
        errors[over] = info["error"][over]
        assert np.array_equal(terminated[over], np.full(over.sum(), declared is not None))
        done |= over
    ratio = np.sqrt(np.mean((errors / info["limit"]) ** 2, axis=0))
    # an RMS over 24 seeds has a standard deviation of 14 %; white noise contributes more after an early declaration
    assert np.all(ratio < (1.5 if declared is None else 1.9)), ratio
    assert ratio[2] > 0.4


def test_a_row_of_a_vector_agent_is_the_single_agent():
    kwargs = {"samples_per_step": 40, "duration_s": 2.0, "imu": "random", "heading_deg": (0.0, 360.0)}
    venv = gymnasium.make_vec(SHIP, 3, **kwargs)
    agent, singles = agents.make("q-method", venv), []
    for i in range(3):
        env = gymnasium.make(SHIP, **kwargs)
        singles.append((env, agents.make("q-method", env), [env.reset(seed=9 + i)[0]]))
    observation, _ = venv.reset(seed=9)
    for _ in range(25):  # two episodes of 10 steps and the beginning of a third
        actions = agent.act(observation)
        for i, (env, single, seen) in enumerate(singles):
            assert np.array_equal(seen[-1], observation[i])
            action = single.act(seen[-1])
            assert np.array_equal(action, actions[i])
            seen.append(env.reset()[0] if env.unwrapped.snapshot().over else env.step(action)[0])
        observation, *_ = venv.step(actions)


def test_lost_samples_are_bridged():
    scenario = load("ship-swaying")
    lossy = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"drop_probability": 0.02})})
    env = gymnasium.make(SHIP, scenario=lossy, samples_per_step=200, duration_s=120.0)
    _, action, info = episode(env, agents.make("q-method", env), seed=2)
    heading = [np.degrees(attitude.numeric.to_euler(q)[2]) for q in (action[:4], info["q_nb"])]
    assert abs(heading[0] - heading[1]) < 2.0


@pytest.mark.parametrize(
    ("env_id", "id", "message"),
    [
        (DRIVE, "q-method", "gives no velocity and position"),
        (SHIP, "aqe-sukf", r"needs GNSS: scenario 'ship-swaying' has no \[gnss\]"),
        (SHIP, "smoother", "needs GNSS"),
        (DRIVE, "smoother", "smooths a whole run"),
        (SHIP, "clairvoyance", "no estimator 'clairvoyance'"),
    ],
)
def test_an_estimator_that_cannot_act(env_id, id, message):
    env = gymnasium.make(env_id, samples_per_step=10, duration_s=1.0)
    with pytest.raises(InputError, match=message):
        agents.make(id, env)


def test_an_environment_that_takes_no_estimates():
    env = gymnasium.make("CartPole-v1")
    with pytest.raises(InputError, match="whose action is an estimate"):
        agents.make("q-method", env)


def test_every_alignment_estimator_acts():
    env = gymnasium.make(SHIP, samples_per_step=100, duration_s=5.0)
    acted = [id for id, e in estimators.registered().items() if e.kind == "alignment" and not e.aided]
    assert len(acted) >= 7
    for id in acted:
        total, action, _ = episode(env, agents.make(id, env), seed=1)
        assert np.isfinite(total) and np.linalg.norm(action[:4]) == pytest.approx(1.0)
