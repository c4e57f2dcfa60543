"""`insenv/FaultTuning-v0`: without faults it is the filter of a run; each fault does what it says, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.envs import FaultTuningEnv, FaultTuningVectorEnv, TuningEnv
from insenv.envs.faults import BIASES, DRAG, FAULTS, JAMMING, LENGTH_S, PARTS, SOONEST_S, STREET, STUCK, VIBRATION

SHORT = {"samples_per_step": 50, "duration_s": 4.0}
NEVER = {"fault_begin": np.zeros((5, PARTS)), "fault_end": np.zeros((5, PARTS)), "fault_factor": np.ones((5, PARTS))}


@pytest.fixture(scope="module")
def env():
    return FaultTuningEnv(**SHORT)


def _steps(env, count: int, action=(0.0,) * 9, **parameters):
    """The observations by name, infos and states of the run of seed 3 with some parameters replaced."""
    env.reset(seed=1, options={"run_seed": 3})
    table, before = env.setup.task.model.parameters, env.snapshot()
    env.restore(replace(before, parameters=table.pack(parameters, before.parameters)))
    found = []
    for _ in range(count):
        observation, *_, info = env.step(np.array(action))
        found.append((env.named(observation), info, env.setup.task.model.state.unpack(env.snapshot().state)))
    return found


def _window(kind: int, begin: float, end: float, factor: float = 1.0) -> dict:
    rows = {name: value.copy() for name, value in NEVER.items()}
    rows["fault_begin"][kind, 1], rows["fault_end"][kind, 1], rows["fault_factor"][kind, 1] = begin, end, factor
    return rows


def test_without_faults_it_is_the_filter_of_a_run(env):
    """And that of Tuning-v0, to the bit; a component that trusts changes nothing."""
    plain = TuningEnv(**SHORT, mistuning_decades=0.0)
    plain.reset(seed=1, options={"run_seed": 3})
    for _, info, _ in _steps(env, 16, [0.0] * 7 + [1.0, 1.0]):
        expected = plain.step(np.zeros(6))[-1]
        assert all(np.array_equal(info[name], expected[name]) for name in ("q_nb", "position", "error", "nees", "measure"))


def test_what_an_episode_draws_can_be_set_for_all_that_follow():
    env = FaultTuningEnv(**SHORT)
    env.set_ranges(spread_decades=0.0, faults=False)
    env.reset(seed=1)
    drawn = env.setup.task.model.parameters.unpack(env.snapshot().parameters)
    assert np.all(drawn["noise_factor"] == 1.0) and np.all(drawn["fault_begin"] == drawn["fault_end"])
    with pytest.raises(InputError, match="spread_decades = 3: allowed is a number from 0 to 2"):
        env.set_ranges(spread_decades=3)
    assert env.spread_decades == 0.0
    tuned = TuningEnv(**SHORT)
    tuned.set_ranges(mistuning_decades=0.0)
    tuned.reset(seed=1)
    assert not tuned.setup.task.model.parameters.unpack(tuned.snapshot().parameters)["mistuning"].any()


@pytest.mark.parametrize("kind", [FaultTuningEnv, TuningEnv])
def test_a_unit_without_errors_is_refused(kind):
    """Its filter would count as diverged before the first fix."""
    with pytest.raises(InputError, match="the inertial unit is too good for a filter that is scored by the limit: roll could "):
        kind(**SHORT, imu="perfect").reset(seed=1)


def test_noises_grow_inside_their_windows_and_nothing_is_reported(env):
    quiet = _steps(env, 16)
    for kind, rows in ((STREET, slice(2, 4)), (JAMMING, slice(2, 4)), (VIBRATION, slice(0, 2))):
        found = _steps(env, 16, noise_factor=[1.0, 2.0, 3.0, 4.0], **_window(kind, 1.0, 2.0, 7.0))
        scale = np.array([info["true_scale"] for _, info, _ in found])
        expected = np.tile([1.0, 2.0, 3.0, 4.0], (16, 1))
        expected[3:7, rows] *= 7.0  # the window begins at the end of the fourth step
        assert np.array_equal(scale, expected) and np.array_equal(
            [info["fault_now"][kind] for _, info, _ in found], [float(3 <= k < 7) for k in range(16)]
        )
        for (_, _, state), (_, _, other) in zip(found, quiet, strict=True):
            assert np.array_equal(state["gnss_position_sigma"], other["gnss_position_sigma"])
    shaken = _steps(env, 8, **_window(VIBRATION, 0.0, 9.0, 100.0))[-1]
    assert np.all(shaken[0]["gyro_level"] > 1.7) and np.all(np.abs(shaken[0]["accel_level"] - 2.0) < 0.3)


def test_positions_are_drawn_away_steadily_and_velocities_stay_true(env):
    away = {"fault_drag": [40.0, -20.0, 0.0], **_window(DRAG, 1.0, 3.0)}
    quiet, found = _steps(env, 15), _steps(env, 15, **away)
    for k, ((_, _, state), (_, _, other)) in enumerate(zip(found, quiet, strict=True)):
        share = {4: 0.05 / 2.0, 8: 1.05 / 2.0}.get(4 * (k // 4), 0.0)  # fixes arrive at 1.05, 2.05 and 3.05 s
        place, plain = ([float(s[f"gnss_{name}"]) for name in ("latitude", "longitude", "height")] for s in (state, other))
        moved = np.ravel(geodesy.numeric.ned_offset(*place, *plain))
        assert moved == pytest.approx(share * np.array([40.0, -20.0, 0.0]), abs=1e-6)
        assert np.array_equal(state["gnss_velocity_n"], other["gnss_velocity_n"])


@pytest.mark.parametrize("axis", [1, 5])
def test_a_stuck_axis_repeats_its_increment(env, axis):
    quiet = _steps(env, 8)
    found = _steps(env, 8, fault_axis=np.eye(6)[axis], **_window(STUCK, 0.5, 1.5))
    given, measured = (np.array([np.r_[s["delta_angle"], s["delta_velocity"]] for *_, s in each]) for each in (found, quiet))
    others = np.arange(6) != axis
    assert np.array_equal(given[:, others], measured[:, others]) and len(set(given[1:5, axis])) == 1
    assert given[1, axis] != 0.0  # the increment with which it got stuck
    assert np.array_equal(given[[0, 6, 7], axis], measured[[0, 6, 7], axis])
    levels = np.array([np.r_[seen["gyro_level"], seen["accel_level"]] for seen, *_ in found])
    assert np.all(levels[2:5, axis] == -3.0) and np.all(levels[:, others] > -2.0)


def test_what_is_not_trusted_is_not_used(env):
    (*_, state), (*_, plain) = _steps(env, 16, [0.0] * 7 + [-1.0, 0.0])[-1], _steps(env, 16)[-1]
    assert state["estimator_noise_scale"].tolist() == [1.0] * 4 + [1e4, 1.0, 1.0]
    assert np.abs(state["estimator_innovation"][:3]).max() > 0.0
    assert not np.array_equal(state["estimator_covariance"], plain["estimator_covariance"])


def test_factors_and_windows_are_drawn_for_each_episode():
    starts = FaultTuningVectorEnv(1).setup.starts
    drawn = starts.draw([np.random.default_rng(seed) for seed in range(256)])
    p, plain = starts.task.model.parameters.unpack(drawn), starts._plant.parameters.unpack(starts._pool[0])
    begin, length = p["fault_begin"], p["fault_end"] - p["fault_begin"]
    some = length > 0.0
    # 256 x 15 windows with a probability of 0.5, 4 standard errors
    assert abs(some.mean() - 0.5) < 4.0 * 0.5 / np.sqrt(256 * 15) and np.all(begin >= SOONEST_S)
    part = (240.0 - SOONEST_S) / PARTS
    assert np.array_equal((begin[some] - SOONEST_S) // part, np.broadcast_to(np.arange(PARTS), some.shape)[some])
    assert np.all(p["fault_end"] <= SOONEST_S + part * np.arange(1, PARTS + 1) + 1e-9)
    place = ((begin - SOONEST_S - part * np.arange(PARTS)) / (part - length))[some]  # a window is anywhere in its part
    assert place.min() < 0.01 and place.max() > 0.99 and abs(place.mean() - 0.5) < 4.0 / np.sqrt(12 * place.size)
    for kind, (shortest, longest) in enumerate(LENGTH_S):
        lengths = length[:, kind][some[:, kind]]
        assert shortest <= lengths.min() < shortest + 1.0 and longest - 1.0 < lengths.max() <= longest, FAULTS[kind]
    factors = np.log10(np.hstack([p["noise_factor"], *(p[name][:, :1] / plain[name][0] for name in BIASES)]))
    assert np.abs(factors).max() <= 0.5 and np.all(factors.std(axis=0) > 0.25)
    assert np.abs(np.corrcoef(factors.T) - np.eye(6)).max() < 0.25
