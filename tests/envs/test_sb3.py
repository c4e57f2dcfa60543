"""Stable-Baselines3 on the environments; what the examples train, on held-out seeds, which takes minutes."""

import os
import re
import subprocess
import sys

import gymnasium
import numpy as np
import peers
import pytest
from places import ROOT

import insenv
from insenv.base.errors import InputError

SHIP, TUNING, FAULTS = "insenv/ShipAlignment-v0", "insenv/Tuning-v0", "insenv/FaultTuning-v0"
HOW = "pip install -e '.[rl]'"


@pytest.mark.slow
def test_an_end_by_time_is_terminal_where_the_score_is_complete():
    peers.package("stable_baselines3", HOW)
    from insenv.envs.sb3 import BatchVecEnv

    for id, reward, truncated in ((SHIP, "dense", False), (TUNING, "final", False), (TUNING, "dense", True)):
        more = {"samples_per_step": 7, "duration_s": 0.3, "reward": reward}
        venv, plain = BatchVecEnv(id, 3, seed=4, **more), gymnasium.make_vec(id, 3, autoreset_mode="SameStep", **more)
        assert np.array_equal(venv.reset(), plain.reset(seed=4)[0])
        action = np.full(plain.action_space.shape, -0.5)
        for step in range(10):
            observation, reward, over, infos = venv.step(action)
            expected = plain.step(action)
            assert np.array_equal(observation, expected[0]) and np.allclose(reward, expected[1], rtol=1e-6)
            assert over.tolist() == [step == 7] * 3
            if over.all():
                assert [info["TimeLimit.truncated"] for info in infos] == [truncated] * 3
                assert np.array_equal(infos[2]["terminal_observation"], expected[4]["final_obs"][2])
        assert venv.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
        with pytest.raises(InputError, match=r"set_attr\('sea_state'\) of rows \[1\]: the rows share one batch"):
            venv.set_attr("sea_state", (1.0, 2.0), indices=1)
        venv.set_attr("initial_error", (2.0, 5.0))  # a curriculum
        venv.reset()
        told, place = venv.env_method("snapshot")[2].parameters, venv.get_attr("setup")[0].task.model.parameters
        assert told[:, place.slice("known_heading_sigma")] == pytest.approx(np.radians(5.0))


@pytest.mark.slow
def test_a_supervisor_is_the_network_of_torch_saved_and_loaded(tmp_path, monkeypatch):
    torch = peers.package("torch", HOW)
    monkeypatch.syspath_prepend(ROOT / "examples")
    import train_supervisor as example

    torch.manual_seed(3)
    gru, output = torch.nn.GRU(62, 5), torch.nn.Linear(5, 2)
    draw = np.random.default_rng(1)
    weights = {"mean": draw.normal(size=62), "scale": draw.uniform(0.5, 2.0, 62), **example.weights_of(gru, output)}
    example.Supervisor(weights).save(tmp_path / "policy.npz")
    policy = example.Supervisor.load(tmp_path / "policy.npz")
    venv = gymnasium.make_vec(FAULTS, 3, duration_s=12.0)
    observation, _ = venv.reset(seed=4)
    policy.start(venv)
    inputs, actions = [], []
    for _ in range(10):
        actions.append(policy.act(venv.unwrapped.named(observation)))
        inputs.append(policy.x)
        observation, *_ = venv.step(actions[-1])
    with torch.no_grad():
        expected = output(gru(torch.tensor(np.array(inputs), dtype=torch.float32))[0]).numpy()
    assert np.abs(np.array(inputs)[-1, :, 50:]).max() > 0.0  # innovations have come
    np.testing.assert_allclose(np.array(actions)[..., 4:6], np.clip(expected, -1.0, 1.0), atol=1e-5)


def test_a_supervised_filter_is_the_filter_that_a_policy_tunes_in_the_environment(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "examples")
    import trained_filter as example
    from train_supervisor import Supervisor

    draw, hidden = np.random.default_rng(1), 3
    shapes = {"input": (9, 62), "input_offset": 9, "recurrent": (9, 3), "recurrent_offset": 9, "output": (2, 3)}
    weights = {name: draw.normal(0.0, 0.2, shape) for name, shape in shapes.items()}
    weights |= {"mean": draw.normal(size=62), "scale": draw.uniform(0.5, 2.0, 62), "output_offset": np.zeros(2)}
    venv, policy = gymnasium.make_vec(FAULTS, 1, duration_s=6.0), Supervisor(weights)
    observation, _ = venv.reset(options={"run_seed": 3})
    policy.start(venv)
    for _ in range(6):
        action = policy.act(venv.unwrapped.named(observation))
        observation, *_, info = venv.step(action)
    assert policy.hidden.shape == (1, hidden) and np.abs(action[0, 4:6]).min() > 0.01
    estimator = example.supervised(weights)
    scenario = example.tuned_as_the_filter(insenv.load("car-city-drive"), estimator.id)
    (result,) = insenv.run(scenario, [estimator], seed=3, duration_s=6.0).results
    expected = info["velocity_n"][0] + info["error"][0, 3:6]
    np.testing.assert_allclose(result.outputs["velocity_n"][-1], expected, atol=1e-10)


def trained(example, figure, folder, *arguments):
    """Run a training example, check its figure, and return what it printed."""
    peers.package("stable_baselines3", HOW)
    environment = {name: value for name, value in os.environ.items() if name != "INSENV_BACKEND"}
    environment["PYTHONPATH"] = str(ROOT)
    command = [sys.executable, ROOT / "examples" / f"{example}.py", *arguments, "--out", "figure"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=3000)
    assert done.returncode == 0, done.stderr
    assert (folder / "figure" / figure).stat().st_size > 10_000
    return done.stdout


def number_after(text, printed):
    """Return the number and its standard error after some text."""
    found = re.search(re.escape(text) + r" +([+-]?[\d.]+) \+- ([\d.]+)", printed)
    assert found is not None, printed
    return float(found[1]), float(found[2])


@pytest.mark.slow
def test_a_trained_tuner_is_better_than_the_untuned_filter_on_held_out_seeds(tmp_path):
    printed = trained("train_tuner", "tuner.png", tmp_path, "--steps", "12000", "--evaluations", "24")
    gain, error = number_after("PPO minus untuned, seed by seed:", printed)
    untuned, correct = (
        float(re.search(rf"^{name} +(-?[\d.]+)", printed, re.MULTILINE)[1]) for name in ("untuned", "correct data sheets")
    )
    assert gain > 4 * error and correct > untuned + 0.5, printed  # it is not mistuned


@pytest.mark.slow
def test_a_trained_aligner_is_better_than_analytic_on_held_out_seeds(tmp_path):
    printed = trained("train_aligner", "aligner.png", tmp_path, "--steps", "360000")
    learnt, classical = number_after("PPO", printed), number_after("analytic", printed)
    assert learnt[0] - classical[0] > 4.0 * np.hypot(learnt[1], classical[1]), printed


@pytest.mark.slow
def test_a_trained_driver_is_as_good_as_the_best_fixed_pattern_on_held_out_seeds(tmp_path):
    printed = trained("train_manoeuvre", "manoeuvre-curve.png", tmp_path, "--steps", "400000", "--seeds", "128")
    gain, error = number_after("PPO minus the pattern chosen, seed by seed:", printed)
    assert gain > -2.0 * error, printed
    learnt = number_after("PPO", printed)[0]
    assert number_after("random commands", printed)[0] + 0.3 < learnt < number_after("bound of the fixes", printed)[0], printed


@pytest.mark.slow
def test_a_trained_supervisor_is_better_than_the_innovation_based_policy_on_held_out_seeds(tmp_path, monkeypatch):
    printed = trained(
        "train_supervisor", "supervisor.png", tmp_path, "--training-seeds", "1", "--rounds", "7", "--seeds", "128"
    )
    gain, error = number_after("networks minus innovation-based, seed by seed:", printed)
    assert gain > 2.0 * error, printed
    monkeypatch.syspath_prepend(ROOT / "examples")
    import train_supervisor as example

    policy = example.Supervisor.load(tmp_path / "figure" / "supervisor-1.npz")
    scores, _ = example.episodes(policy, example.HELD_OUT + np.arange(128))
    assert round(scores.mean(), 3) == number_after("network 1", printed)[0]
    again = [sys.executable, ROOT / "examples" / "train_supervisor.py", "--seeds", "8", "--load", "figure/supervisor-1.npz"]
    loaded = peers.ran(*again, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert number_after("network 1", loaded)[0] == round(scores[:8].mean(), 3)


@pytest.mark.slow
def test_a_corrector_trains_and_the_ceiling_lies_above_the_filter(tmp_path):
    peers.package("torch", HOW)
    short = ["--training-seeds", "1", "--rounds", "2", "--rows", "8", "--seeds", "8"]
    printed = peers.ran(sys.executable, ROOT / "examples" / "train_corrector.py", *short, cwd=tmp_path)
    plain, ceiling, network = (number_after(name, printed) for name in ("the filter as it is", "told the error", "network 1"))
    assert ceiling[0] - plain[0] > 2.0 * np.hypot(ceiling[1], plain[1]) and np.isfinite(network[0])
