"""The estimators as agents: in the loop they give the results of `insenv run` and reach their limits."""

import gymnasium
import numpy as np
import pytest
from changed_scenario import changed

from insenv import attitude, estimators, geodesy, run
from insenv.base.errors import InputError
from insenv.envs import agents
from insenv.scenario import load

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
ALIGNMENTS = [id for id, e in estimators.registered().items() if e.kind == "alignment" and not e.aided]


def episode(env, agent, **reset):
    """Return, last action and last info of an episode."""
    observation, info = env.reset(**reset)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(agent.act(observation, info))
        total, over = total + reward, terminated or truncated
    return total, agent.act(observation, info), info


@pytest.mark.parametrize("id", ALIGNMENTS)
def test_an_agent_is_bit_identical_to_the_estimator_of_a_run(id):
    env = gymnasium.make(SHIP, samples_per_step=100, duration_s=3.0)
    total, action, _ = episode(env, agents.make(id, env), seed=1, options={"run_seed": 6})
    q_nb = run(load("ship-swaying"), [id], seed=6, duration_s=3.0).results[0].outputs["q_nb"][-1]
    # BLAS rounds a norm as its processor likes
    np.testing.assert_allclose(action[:4], q_nb / np.linalg.norm(q_nb), rtol=1e-15)
    assert np.isfinite(total) and len(ALIGNMENTS) >= 7


def test_a_navigating_agent_is_the_filter_of_a_run():
    env = gymnasium.make(DRIVE, samples_per_step=130, duration_s=6.5)
    _, action, info = episode(env, agents.make("loosely-coupled", env), seed=1, options={"run_seed": 3})
    result = run(load("car-city-drive"), ["loosely-coupled"], seed=3, duration_s=6.5).results[0]
    # fixes pass through metres from the reference, which rounds latitude to about a nanometre
    assert action[:4] == pytest.approx(result.outputs["q_nb"][-1], abs=1e-9)
    known = env.unwrapped.named(env.reset(options={"run_seed": 3})[0])
    reference = (known[f"known_{name}"] for name in ("latitude", "longitude", "height"))
    found = geodesy.numeric.ned_offset(*(result.outputs[name][-1] for name in ("latitude", "longitude", "height")), *reference)
    assert action[7:10] * 1e6 == pytest.approx(found, abs=1e-6)
    assert action[4:7] * 1e3 == pytest.approx(result.outputs["velocity_n"][-1], abs=1e-8)
    assert np.abs(found - info["position"]).max() < 4 * info["limit"][6:9].max()


def test_an_agent_declares_in_time():
    env = gymnasium.make(SHIP, samples_per_step=20, duration_s=3.0)
    _, _, info = episode(env, agents.make("q-method", env, declare_after_s=1.0), seed=1)
    assert info["declared"] == 1.0 and env.unwrapped.snapshot().over


def test_a_row_of_a_vector_agent_is_the_single_agent():
    kwargs = {"samples_per_step": 40, "duration_s": 1.0, "imu": "random", "heading_deg": (0.0, 360.0)}
    venv = gymnasium.make_vec(SHIP, 3, **kwargs)
    agent, singles = agents.make("q-method", venv), []
    for i in range(3):
        env = gymnasium.make(SHIP, **kwargs)
        singles.append((env, agents.make("q-method", env), [env.reset(seed=9 + i)[0]]))
    observation, _ = venv.reset(seed=9)
    for _ in range(15):  # two episodes of 5 steps and the beginning of a third
        actions = agent.act(observation)
        for i, (env, single, seen) in enumerate(singles):
            assert np.array_equal(seen[-1], observation[i])
            action = single.act(seen[-1])
            assert np.array_equal(action, actions[i])
            seen.append(env.reset()[0] if env.unwrapped.snapshot().over else env.step(action)[0])
        observation, *_ = venv.step(actions)


@pytest.mark.parametrize(("env_id", "id", "more", "message"), [
    (DRIVE, "q-method", {}, "gives no velocity and position"),
    (SHIP, "aqe-sukf", {}, r"needs GNSS: scenario 'ship-swaying' has no \[gnss\]"),
    (DRIVE, "smoother", {}, "smooths a whole run"),
    (SHIP, "q-method", {"observation": "compact"}, "whose observation holds the samples"),
    ("CartPole-v1", "q-method", {"samples_per_step": None}, "whose action is an estimate"),
])  # fmt: skip
def test_an_estimator_that_cannot_act(env_id, id, more, message):
    env = gymnasium.make(env_id, **({**SHORT, **more} if env_id.startswith("insenv") else {}))
    with pytest.raises(InputError, match=message):
        agents.make(id, env)


def test_lost_samples_are_bridged():
    lossy = changed("ship-swaying", imu={"drop_probability": 0.02}, rate_hz=25.0)
    env = gymnasium.make(SHIP, scenario=lossy, samples_per_step=50, duration_s=120.0)
    _, action, info = episode(env, agents.make("q-method", env), seed=2)
    heading = [np.degrees(attitude.numeric.to_euler(q)[2]) for q in (action[:4], info["q_nb"])]
    assert abs(heading[0] - heading[1]) < 2.0


def test_an_estimator_in_an_environment_is_fed_and_told_of_instruments_as_in_a_run():
    """Measurements on their own samples, to the bit, and what is told of the instrument."""
    scenario = changed("car-city-drive", rate_hz=100.0, odometer={}, gnss={"grade": "rtk"}, duration_s=3.5)
    env = gymnasium.make(DRIVE, scenario=scenario, samples_per_step=7, duration_s=3.5)
    agent = agents.make("fusion", env)
    episode(env, agent, seed=0, options={"run_seed": 0})
    seen = run(load(scenario), "fusion", seed=0).results[0].outputs
    assert seen["odometer_count"][-1] == 35, "10 Hz over 3.5 s"
    shown = agent.estimator.model.outputs.unpack(agent._runner.output())
    for name in ("q_nb", "velocity_n", "odometer_scale_estimate_sigma", "odometer_count"):
        np.testing.assert_array_equal(shown[name], seen[name][-1])
