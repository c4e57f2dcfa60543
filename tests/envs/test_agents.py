"""The estimators as agents: in the loop they give the results of `insenv run` and reach their limits."""

import casadi as ca
import gymnasium
import numpy as np
import pytest

import insenv
from insenv import Row, Step, Table, estimators, geodesy, run
from insenv.core.model import Model
from insenv.envs import agents
from insenv.errors import InputError
from insenv.estimators import Estimator
from insenv.estimators.parts.rows import SAMPLE_INPUTS
from insenv.instruments import ODOMETER
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


@pytest.mark.parametrize(
    ("env_id", "id", "more", "message"),
    [
        (DRIVE, "q-method", {}, "gives no velocity and position"),
        (SHIP, "aqe-sukf", {}, r"needs GNSS: scenario 'ship-swaying' has no \[gnss\]"),
        (DRIVE, "smoother", {}, "smooths a whole run"),
        (SHIP, "q-method", {"observation": "compact"}, "whose observation holds the samples"),
        ("CartPole-v1", "q-method", {"samples_per_step": None}, "whose action is an estimate"),
    ],
)
def test_an_estimator_that_cannot_act(env_id, id, more, message):
    env = gymnasium.make(env_id, **({**SHORT, **more} if env_id.startswith("insenv") else {}))
    with pytest.raises(InputError, match=message):
        agents.make(id, env)


def speedometer():
    """An estimator that gives back what it is fed and told."""
    told, rows = Table((ODOMETER.told["odometer_scale_factor_sigma"],)), ("latitude", "longitude", "height")
    state = Table((Row("speed", "Speed", "m/s"), Row("count", "Speeds so far")))
    attitude_and_velocity = Row("q_nb", "q", "1", (4,), start=(1, 0, 0, 0)), Row("velocity_n", "v", "m/s", (3,))
    outputs = Table((*attitude_and_velocity, *(Row(name, name) for name in rows)))

    def output(p, x):
        shown = {"q_nb": ca.DM([1, 0, 0, 0]), **dict.fromkeys(rows, 0.0)}
        return shown | {"velocity_n": ca.vertcat(x.speed, x.count, p.odometer_scale_factor_sigma)}

    take = Step(lambda p, x, u: {"speed": u.odometer_speed, "count": x.count + 1}, when="odometer_new")
    inputs = SAMPLE_INPUTS + ODOMETER.measurement
    model = Model("speedometer", "Speedometer", told, state, inputs, outputs, {"take": take}, output)
    return Estimator(model, kind="navigation", sensors=("odometer",))


def test_an_estimator_in_an_environment_is_fed_and_told_of_instruments_as_in_a_run():
    """Measurements on their own samples, to the bit, and what is told of the instrument."""
    values = load("car-city-drive").model_dump(exclude_unset=True)
    scenario = {**values, "rate_hz": 100.0, "odometer": {}}
    scenario["gnss"] = {"grade": "rtk"}
    estimator, env = speedometer(), gymnasium.make(DRIVE, scenario=scenario, samples_per_step=7)
    agent = agents.make(estimator, env)
    observation, info = env.reset(seed=0, options={"run_seed": 0})
    for _ in range(50):
        observation, _, _, _, info = env.step(agent.act(observation, info))
    agent.act(observation, info)
    shown = estimator.model.outputs.unpack(agent._runner.output())["velocity_n"]
    seen = insenv.run(load(scenario), estimator, seed=0, duration_s=3.5).results[0].outputs["velocity_n"]
    assert seen[-1, 1] == 35, "10 Hz over 3.5 s"
    assert seen[-1, 2] == 0.01, "the grade's scale factor"
    np.testing.assert_array_equal(shown, seen[-1])
