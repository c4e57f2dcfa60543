"""`insenv/Tuning-v0`: the inner filter is the registered one with scaled noises; observations and rewards are right."""

import numpy as np
import pytest

from insenv import estimators
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.envs import ManoeuvreEnv, TuningEnv, testing
from insenv.envs.tuning import TUNED
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows
from insenv.scenario.loop import loop_model

SHORT = {"samples_per_step": 7, "duration_s": 0.3}


@pytest.fixture(scope="module")
def second():
    return TuningEnv(samples_per_step=200, duration_s=8.0)


def runner_of(seed):
    """A runner of the drive with the filter of a run, the rows of the filter and the plant."""
    plant, estimator = build(load("car-city-drive"), seed=seed), estimators.get("loosely-coupled")
    rows, model = plant.parameters_of(estimator), loop_model(plant.model, estimator.model)
    return make_runner(model, {**plant.parameters, **{f"estimator_{k}": v for k, v in rows.items()}}), rows, plant


@pytest.mark.parametrize("action", [[0.0] * 6, [0.3, -0.4, 0.0, 0.0, 0.5, -0.25]])
def test_factors_act_like_scaled_parameters(second, action):
    """Except for the driving noise of the biases, whose parameter is also their start sigma; zeros change nothing."""
    action = np.array(action)
    second.reset(seed=1, options={"run_seed": 12})
    for _ in range(3):
        *_, info = second.step(action)
    assert info["scale"] == pytest.approx(10.0 ** (2.0 * action), rel=1e-14)
    (_, rows, plant), estimator = runner_of(12), estimators.get("loosely-coupled")
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(600))
    columns = {name: np.array(column) for name, column in columns.items()}
    for name, scale in zip(TUNED, info["scale"], strict=True):
        if name in rows and scale != 1.0:
            rows[name] = rows[name] * scale
        elif name in columns:
            columns[name] *= scale
    columns["dt"] = np.full(600, plant.sample_interval)
    runner = make_runner(estimator.model, rows)
    runner.run(600, input_rows(estimator.model, columns, 600))
    found = second.setup.task.model.state.unpack(second.snapshot().state)
    for name, value in runner.state.items():
        assert np.array_equal(found[f"estimator_{name}"], value), name


def test_a_larger_driving_noise_of_the_biases_acts_after_the_start():
    """During the first quarter of a second, in which the biases are not observable."""
    env = TuningEnv(samples_per_step=50, duration_s=1.0, mistuning_decades=0.0)
    observation, _ = env.reset(seed=1)
    before = env.named(observation)["sigma_level"][9:15]
    driven = env.named(env.step(np.array([0, 0, 1.0, 1.0, 0, 0]))[0])["sigma_level"][9:15]
    rows = env.setup.task.model.parameters.unpack(env.snapshot().parameters)
    for triad, part in (("gyro", slice(0, 3)), ("accel", slice(3, 6))):
        sigma, time = (float(rows[f"estimator_{triad}_{name}"]) for name in ("bias_sigma", "correlation_time"))
        assert before[part] == pytest.approx(np.log10(sigma), abs=1e-12)
        assert driven[part] == pytest.approx(0.5 * np.log10(sigma**2 + 100.0**2 * 2 * sigma**2 / time * 0.25), abs=1e-4)


def test_observations_are_the_statistics_of_sensors_and_filter(second):
    second.reset(seed=5, options={"run_seed": 3})
    (runner, _, plant), fixes = runner_of(3), 0
    for _ in range(3):
        observation, *_ = second.step(np.zeros(6))
        seen, shown = second.named(observation), runner.model.outputs.unpack(runner.run(200))
        for name, column in (("rate", "delta_angle"), ("force", "delta_velocity")):
            samples = shown[column] / plant.sample_interval
            assert seen[f"{name}_mean"] == pytest.approx(samples.mean(axis=0), rel=1e-9)
            assert seen[f"{name}_deviation"] == pytest.approx(samples.std(axis=0), rel=1e-4)
        came = shown["gnss_valid"] != 0
        assert seen["fixes"] == came.sum()
        assert seen["sigma_level"] == pytest.approx(
            0.5 * np.log10(runner.state["estimator_covariance"][symmetric.diagonal_places(15)]), abs=1e-12
        )
        if came.any():
            fixes += 1
            ratio, innovation = (shown[f"estimator_{name}"][came] for name in ("test_ratio", "innovation"))
            assert seen["test_ratio_mean"] == pytest.approx(ratio.mean(axis=0))
            assert seen["test_ratio_level"] == pytest.approx(0.5 * np.log10(np.mean(ratio**2, axis=0)))
            assert seen["innovation_rms"] == pytest.approx(np.sqrt(np.mean(innovation**2, axis=0)))
            sigma = np.concatenate([shown["gnss_position_sigma"][-1], shown["gnss_velocity_sigma"][-1]])
            assert seen["gnss_level"] == pytest.approx(np.log10(sigma))
            age = (199 - np.flatnonzero(came)[-1]) * plant.sample_interval + shown["gnss_age"][came][-1]
            assert seen["fix_age"] == pytest.approx(age, abs=1e-9)
    assert fixes >= 2


def test_the_reward_counts_nine_components_and_consistency():
    """ln(1 + sqrt(mean((e / s)^2))): errors every second, over one evaluation and over two of the same drive."""
    found = {}
    for samples in (200, 400):
        env, found[samples] = TuningEnv(samples_per_step=samples, duration_s=4.0, consistency_weight=0.7, reward="dense"), []
        env.reset(seed=3)
        for _ in range(400 // samples):
            _, reward, terminated, _, info = env.step(np.full(6, 0.1))
            measure = np.log(1.0 + np.sqrt(np.mean((info["error_rms"] / info["limit"]) ** 2)))
            consistency = abs(np.log(info["nees"] / 9.0))
            assert (info["measure"], info["consistency"]) == pytest.approx((measure, consistency), rel=1e-9)
            assert reward == pytest.approx(-(measure + 0.7 * consistency) * samples / 800.0) and not terminated
            assert info["limit"].shape == (9,) and (info["error_rms"] > 0).all()
            found[samples].append(info)
    each, nees = ([info[name] for info in found[200]] for name in ("error", "nees"))
    for info, error in zip(found[200], each, strict=True):  # a decision counts its own evaluations alone
        assert info["error_rms"] == pytest.approx(np.abs(error), rel=1e-9)
    assert found[400][0]["error_rms"] == pytest.approx(np.sqrt(np.mean(np.square(each), axis=0)), rel=1e-6)
    assert found[400][0]["nees"] == pytest.approx(np.mean(nees), rel=1e-6)


def test_the_start_is_consistent_with_its_reported_sigmas():
    """The mean NEES of the start over seeds is that of a chi-square distribution with 9 degrees of freedom."""
    env, seeds = TuningEnv(samples_per_step=1, duration_s=0.1), 80
    found = []
    for seed in range(seeds):
        env.reset(seed=seed)
        found.append(env.step(np.zeros(6))[4]["nees"])
    assert abs(np.mean(found) - 9.0) < 3.3 * np.sqrt(2 * 9.0 / seeds)


@pytest.mark.parametrize(
    ("kind", "size", "lowest"),
    [(TuningEnv, 6, -(np.log(1.0 + 1e4) + 0.5 * 10.0) * 7.0 / 8.0), (ManoeuvreEnv, 2, -(10.0 + 7.0 / 8.0))],
)
def test_a_filter_that_diverges_or_an_action_that_is_not_finite_ends_the_episode(kind, size, lowest):
    """With the lowest reward for all of the time that is left, and finite numbers."""
    env = kind(**SHORT, reward="dense")
    for wrong, action in ((np.nan, 0.0), (np.inf, 0.0), (1e9, 0.0), (None, np.nan), (None, np.inf)):
        env.reset(seed=1)
        env.step(np.zeros(size))
        snapshot = env.snapshot()
        if wrong is not None:
            snapshot.state[env.setup.task.model.state.slice("estimator_height")] = wrong
        env.restore(snapshot)
        observation, reward, terminated, truncated, info = env.step(np.full(size, action))
        assert terminated and not truncated and info["diverged"] == 1.0 and reward == pytest.approx(lowest, rel=1e-6)
        assert env.observation_space.contains(observation) and all(np.all(np.isfinite(value)) for value in info.values())


def test_an_action_outside_the_space_is_clipped():
    env, ends = TuningEnv(**SHORT), []
    for action in ([3.0, -1e6, 0.0, 1.0, 0.5, -2.0], [1.0, -1.0, 0.0, 1.0, 0.5, -1.0]):
        env.reset(seed=1)
        ends.append(env.step(np.array(action)))
    testing.assert_same(list(ends[0]), list(ends[1]), "clipped")


def test_each_reset_draws_the_mistuning_that_an_action_of_zero_gives():
    """Other factors in each episode, up to the decades given; none with the seed of a run, which is tuned."""
    env, scales = TuningEnv(**SHORT, mistuning_decades=1.5), []
    for seed in (1, 1, *range(2, 20)):
        env.reset(seed=seed)
        scales.append(np.log10(env.step(np.zeros(6))[4]["scale"]))
    assert np.array_equal(scales[0], scales[1]) and len(np.unique(scales[1:])) == 19 * 6
    assert 1.0 < np.abs(scales).max() <= 1.5
    env.reset(seed=1)
    assert np.log10(env.step(np.full(6, 0.5))[4]["scale"]) == pytest.approx(scales[0] + 1.0, abs=1e-12)
    env = TuningEnv(**SHORT)
    place = env.setup.task.model.parameters.slice("mistuning")
    env.reset(seed=1)
    assert env.snapshot().parameters[place].all()
    env.reset(options={"run_seed": 3})
    assert not env.snapshot().parameters[place].any()
