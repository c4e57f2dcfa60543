"""`insenv/Tuning-v0`: the inner filter is the registered one with scaled noises; observations and rewards are right."""

import shutil
import warnings

import gymnasium
import numpy as np
import pytest

from insenv import estimators
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.envs import TuningEnv, testing
from insenv.envs.tuning import TUNED
from insenv.errors import InputError
from insenv.plant import loop_model
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load

ID = "insenv/Tuning-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3, "backend": "interpreter"}
SECOND = {"samples_per_step": 200, "duration_s": 8.0, "backend": "interpreter"}
has_compiler = shutil.which("cc") is not None


@pytest.fixture(scope="module")
def second():
    """An environment with steps of one second."""
    return TuningEnv(**SECOND)


def test_it_conforms():
    testing.check_id(ID, **SHORT)


@pytest.mark.slow
@pytest.mark.skipif(not has_compiler, reason="no C compiler on the path")
def test_it_conforms_natively_and_is_bit_identical_to_the_interpreter():
    testing.check_id(ID, **{**SHORT, "backend": "native"})
    envs = [TuningEnv(**{**SHORT, "backend": backend}) for backend in ("native", "interpreter")]
    testing.assert_same(*(testing.episodes(env, 3) for env in envs), "native and interpreter")


def test_an_action_of_zero_leaves_the_filter_of_a_run(second):
    second.reset(seed=1, options={"run_seed": 12})
    for _ in range(3):
        second.step(np.zeros(6))
    plant = build(load("car-city-drive"), seed=12)
    estimator = estimators.get("loosely-coupled")
    rows = plant.parameters_of(estimator)
    model = loop_model(plant.model, estimator.model)
    runner = make_runner(model, {**plant.parameters, **{f"estimator_{k}": v for k, v in rows.items()}}, "interpreter")
    runner.run(600)
    found = second.setup.task.model.state.unpack(second.snapshot().state)
    assert found["gnss_epochs"] == 3
    for name, value in runner.state.items():
        assert np.array_equal(found[name], value), name


def test_factors_act_like_scaled_parameters(second):
    """Except for the driving noise of the biases, whose parameter is also their start sigma."""
    action = np.array([0.3, -0.4, 0.0, 0.0, 0.5, -0.25])
    second.reset(seed=1, options={"run_seed": 12})
    for _ in range(3):
        *_, info = second.step(action)
    assert info["scale"] == pytest.approx(10.0 ** (2.0 * action), rel=1e-14)
    plant = build(load("car-city-drive"), seed=12)
    estimator = estimators.get("loosely-coupled")
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters, "interpreter").run(600))
    columns = {name: np.array(column) for name, column in columns.items()}
    rows = plant.parameters_of(estimator)
    for name, scale in zip(TUNED, info["scale"], strict=True):
        if name in rows and scale != 1.0:
            rows[name] = rows[name] * scale
        elif name in columns:
            columns[name] *= scale
    columns["dt"] = np.full(600, plant.sample_interval)
    runner = make_runner(estimator.model, rows, "interpreter")
    runner.run(600, input_rows(estimator.model, columns, 600))
    found = second.setup.task.model.state.unpack(second.snapshot().state)
    for name, value in runner.state.items():
        assert np.array_equal(found[f"estimator_{name}"], value), name


def test_a_larger_driving_noise_of_the_biases_acts_after_the_start():
    """During the first quarter of a second, in which the biases are not observable."""
    env = TuningEnv(samples_per_step=50, duration_s=1.0, mistuning_decades=0.0, backend="interpreter")
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
    plant = build(load("car-city-drive"), seed=3)
    estimator = estimators.get("loosely-coupled")
    rows = plant.parameters_of(estimator)
    model = loop_model(plant.model, estimator.model)
    runner = make_runner(model, {**plant.parameters, **{f"estimator_{k}": v for k, v in rows.items()}}, "interpreter")
    fixes = 0
    for _ in range(3):
        observation, *_ = second.step(np.zeros(6))
        seen, shown = second.named(observation), model.outputs.unpack(runner.run(200))
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


def test_the_reward_follows_its_documentation():
    env = TuningEnv(samples_per_step=50, duration_s=1.0, consistency_weight=0.7, backend="interpreter")
    env.reset(seed=2)
    for step in range(4):
        _, reward, terminated, truncated, info = env.step(np.full(6, 0.1))
        assert info["error_rms"] == pytest.approx(np.abs(info["error"]))  # one evaluation per step
        measure = np.log(1.0 + np.sqrt(np.mean((info["error_rms"] / info["limit"]) ** 2)))
        consistency = abs(np.log(info["nees"] / 9.0))
        assert (info["measure"], info["consistency"]) == pytest.approx((measure, consistency))
        assert reward == pytest.approx(-(measure + 0.7 * consistency) / 4.0)
        assert not terminated and truncated == (step == 3)


def test_the_start_is_consistent_with_its_reported_sigmas():
    """The mean NEES of the start over seeds is that of a chi-square distribution with 9 degrees of freedom."""
    env, seeds = TuningEnv(samples_per_step=1, duration_s=0.1, backend="interpreter"), 80
    found = []
    for seed in range(seeds):
        env.reset(seed=seed)
        found.append(env.step(np.zeros(6))[4]["nees"])
    assert abs(np.mean(found) - 9.0) < 3.3 * np.sqrt(2 * 9.0 / seeds)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e9])
def test_a_filter_that_diverges_ends_the_episode_with_a_finite_reward(wrong):
    env = TuningEnv(**SHORT)
    env.reset(seed=1)
    env.step(np.zeros(6))
    snapshot = env.snapshot()
    snapshot.state[env.setup.task.model.state.slice("estimator_height")] = wrong
    env.restore(snapshot)
    observation, reward, terminated, truncated, info = env.step(np.zeros(6))
    assert terminated and not truncated and info["diverged"] == 1.0
    assert env.observation_space.contains(observation)
    worst = np.log(1.0 + 1e4) + 0.5 * 10.0
    assert reward == pytest.approx(-worst * 7.0 / 8.0)
    assert all(np.all(np.isfinite(value)) for value in info.values())


def test_each_reset_draws_the_mistuning_that_an_action_of_zero_gives():
    env = TuningEnv(**SHORT, mistuning_decades=1.5)
    scales = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        scales.append(np.log10(env.step(np.zeros(6))[4]["scale"]))
    assert np.array_equal(scales[0], scales[2]) and not np.any(scales[0] == scales[1])
    assert np.all(np.abs(scales) <= 1.5) and np.max(np.abs(scales)) > 0.5
    env.reset(seed=1)
    assert np.log10(env.step(np.full(6, 0.5))[4]["scale"]) == pytest.approx(scales[0] + 1.0, abs=1e-12)


def test_an_action_outside_the_space_is_clipped():
    env, ends = TuningEnv(**SHORT), []
    for action in ([3.0, -1e6, 0.0, 1.0, 0.5, -2.0], [1.0, -1.0, 0.0, 1.0, 0.5, -1.0]):
        env.reset(seed=1)
        ends.append(env.step(np.array(action)))
    testing.assert_same(list(ends[0]), list(ends[1]), "clipped")


@pytest.mark.parametrize(
    "given, named",
    [
        ({"estimator": "q-method"}, "loosely-coupled, aqe-ekf, aqe-sukf"),
        ({"estimator": "nothing"}, "no estimator 'nothing'"),
        ({"scenario": "ship-swaying"}, "has no .gnss."),
        ({"decades": -1.0}, "decades = -1"),
        ({"mistuning_decades": np.nan}, "mistuning_decades = nan"),
        ({"consistency_weight": 1e9}, "consistency_weight"),
        ({"samples_per_step": "many"}, "samples_per_step = 'many'"),
    ],
)
def test_bad_arguments_are_named(given, named):
    with pytest.raises(InputError, match=named):
        gymnasium.make(ID, **given)


@pytest.mark.parametrize("action", [np.zeros(5), "up"])
def test_a_bad_action_is_an_error(action):
    env = TuningEnv(**SHORT)
    env.reset(seed=1)
    with pytest.raises(InputError, match="action"):
        env.step(action)


@pytest.mark.parametrize("action", [np.full(6, np.nan), [0, 0, 0, 0, 0, np.inf]])
def test_an_action_that_is_not_finite_ends_the_episode(action):
    env = TuningEnv(**SHORT)
    env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(action)
    assert terminated and not truncated and info["diverged"] == 1.0
    assert reward == pytest.approx(-(np.log(1e4 + 1.0) + 5.0), rel=1e-6)  # the lowest for all of the time
    assert env.observation_space.contains(observation) and np.isfinite(info["error"]).all()


def test_the_default_has_something_to_learn():
    """The filter's noises are wrong by other factors in each episode, up to 1.5 decades, and an option of a run is not."""
    env = TuningEnv(**SHORT)
    place, drawn = env.setup.task.model.parameters.slice("mistuning"), []
    for _ in range(20):
        env.reset(seed=None if drawn else 1)
        drawn.append(env.snapshot().parameters[place])
    assert 1.0 < np.abs(drawn).max() <= 1.5 and len(np.unique(drawn)) == 120
    env.reset(options={"run_seed": 3})
    assert not env.snapshot().parameters[place].any()


def test_stable_baselines_accepts_it():
    """Warnings of its checker are errors, except the advice to use float32, which cannot resolve an estimate."""
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable_baselines3 is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Your action space has dtype float64")
        checker.check_env(TuningEnv(**SHORT), warn=True, skip_render_check=True)
