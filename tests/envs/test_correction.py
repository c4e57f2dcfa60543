"""`insenv/Correction-v0`: 0 is the filter of a run; what is taken out is gone, from the next innovation too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv.base.errors import InputError
from insenv.envs import CorrectionEnv, TuningEnv

RUN = {"run_seed": 3}
REACH = 3.0


def after(action, steps, samples, backend="interpreter"):
    """Observation by name, info and the filter's state after an action in the run of seed 3, and zeros before it."""
    env = CorrectionEnv(samples_per_step=samples, duration_s=4.0, backend=backend)
    env.reset(seed=1, options=RUN)
    for _ in range(steps):
        env.step(np.zeros(9))
    observation, *_, info = env.step(np.asarray(action, dtype=float))
    return env.named(observation), info, env.setup.task.model.state.unpack(env.snapshot().state)


def test_zeros_are_the_filter_of_a_run():
    """That of Tuning-v0, to the bit, which test_tuning.py compares with a run."""
    env, plain = (kind(samples_per_step=50, duration_s=4.0, **more) for kind, more in (
        (CorrectionEnv, {}), (TuningEnv, {"mistuning_decades": 0.0, "consistency_weight": 0.0})
    ))  # fmt: skip
    for each in (env, plain):
        each.reset(seed=1, options=RUN)
    for _ in range(16):
        (_, reward, _, _, info), (_, expected, _, _, other) = env.step(np.zeros(9)), plain.step(np.zeros(6))
        assert reward == expected and all(np.array_equal(info[name], other[name]) for name in ("error", "nees", "measure"))


@pytest.mark.parametrize("component", range(9))
def test_an_action_takes_out_so_many_standard_deviations_of_one_component(component):
    """Within one sample little else happens: others stay within a hundredth of a standard deviation."""
    action = np.zeros(9)
    action[component] = -0.4
    (_, info, _), (_, plain, _) = after(action, 60, 1), after(np.zeros(9), 60, 1)
    sigma = plain["sigma"]
    out, before = REACH * action * sigma, plain["error"]
    turned = Rotation.from_rotvec(-out[:3]) * Rotation.from_rotvec(before[:3])
    expected = np.concatenate([turned.as_rotvec(), before[3:] - out[3:]])
    assert np.abs(info["error"] - expected).max() > 0.0 and info["error"] / sigma == pytest.approx(expected / sigma, abs=0.01)
    assert abs(info["error"][component] - before[component]) > 1.1 * sigma[component]
    assert info["sigma"] == pytest.approx(sigma, rel=1e-3)


def test_the_error_of_the_info_as_an_action_leaves_no_error():
    _, plain, _ = after(np.zeros(9), 59, 1)
    action = plain["error"] / (REACH * plain["sigma"])
    assert np.abs(action).max() < 1.0
    _, info, _ = after(action, 60, 1)
    assert np.all(np.abs(info["error"]) < 0.03 * plain["sigma"])


def test_the_next_innovation_is_that_of_the_corrected_estimate():
    """The epoch of a fix lies before its delivery: what the filter has kept of its motion is corrected too."""
    action = np.zeros(9)
    action[6:9] = 0.3, -0.2, 0.1
    _, info, without = after(np.zeros(9), 2, 62)
    (*_, before), (*_, state) = after(np.zeros(9), 3, 62), after(action, 3, 62)  # 0.93 s to 1.24 s; the fix of 1 s in it
    assert not np.array_equal(before["estimator_innovation"], without["estimator_innovation"])
    moved = state["estimator_innovation"][:3] - before["estimator_innovation"][:3]
    assert np.abs(moved) == pytest.approx(np.abs(REACH * action[6:9] * info["sigma"][6:9]), rel=0.02)


def test_observations_are_what_the_filter_holds():
    seen, info, state = after(np.zeros(9), 3, 62)
    reported = np.concatenate([state["gnss_position_sigma"], state["gnss_velocity_sigma"]])
    sigma = np.concatenate([info["sigma"][6:9], info["sigma"][3:6]])
    assert seen["sigma_level"] == pytest.approx(np.log10(sigma / reported), abs=1e-9)
    assert seen["attitude_level"] == pytest.approx(np.log10(info["sigma"][:3] * 1e3), abs=1e-9)
    assert seen["velocity"] == pytest.approx((info["velocity_n"] + info["error"][3:6]) / 30.0, abs=1e-9)
    ratio = state["estimator_test_ratio"]
    assert seen["fixes"] == 1.0 and seen["ratio"] == pytest.approx(ratio / (1.0 + np.abs(ratio)), abs=1e-9)
    assert sum(np.size(value) for value in seen.values()) == 38


def test_a_short_episode_has_the_limit_of_a_minute():
    """While the car stands, that of its velocity is 1e-5 m/s."""
    limits = []
    for duration_s in (1.0, 60.0, 80.0):
        env = CorrectionEnv(samples_per_step=200, duration_s=duration_s, backend="interpreter")
        limits.append(env.reset(seed=1)[1]["limit"])
    assert np.array_equal(limits[0], limits[1]) and not np.array_equal(limits[1], limits[2]) and limits[0].min() > 1e-4


def test_a_snapshot_of_other_arguments_and_an_option_of_another_environment_are_refused():
    env, other = (CorrectionEnv(duration_s=4.0, backend="interpreter", reach=reach) for reach in (3.0, 1.0))
    for each in (env, other):
        each.reset(seed=1)
    with pytest.raises(InputError, match="snapshot of an environment with reach = 1: this one has 3"):
        env.restore(other.snapshot())
    for option in ("mounting_deg", "sway_phases", "start_speed_mps"):
        with pytest.raises(InputError, match=f"options: unknown option '{option}'"):
            env.reset(options={option: 1.0})


def test_a_filter_that_takes_no_correction_is_refused():
    with pytest.raises(InputError, match=r"estimator = 'aqe-ekf': allowed are .* inside this environment: loosely-coupled$"):
        CorrectionEnv(estimator="aqe-ekf")
    with pytest.raises(InputError, match="reach = -1: allowed is a number from 0 to 1000"):
        CorrectionEnv(reach=-1)
