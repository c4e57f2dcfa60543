"""What learners ask of the environments: float32, short observations, corrections, autoreset, specifications, VecEnv."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeAwareObservation

from insenv import attitude, geodesy
from insenv.envs import agents, testing
from insenv.errors import InputError

SHIP, TUNING = "insenv/ShipAlignment-v0", "insenv/Tuning-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3, "backend": "interpreter"}
COMPACT = {"observation": "compact", "action": "correction"}


@pytest.mark.parametrize("more", [{"dtype": "float32"}, COMPACT, {**COMPACT, "dtype": "float32"}, {"observation": "compact"}])
def test_each_form_conforms(more):
    testing.check_id(SHIP, **SHORT, **more)


def test_float32_is_float64_rounded():
    for id in (SHIP, TUNING):
        wide, narrow = (gymnasium.make(id, **SHORT, dtype=dtype) for dtype in ("float64", "float32"))
        assert narrow.observation_space.dtype == narrow.action_space.dtype == np.float32
        pairs = [(wide.reset(seed=1)[0], narrow.reset(seed=1)[0])]
        action = np.full(wide.action_space.shape, -0.5, dtype=np.float32)
        for _ in range(3):
            one, other = wide.step(action), narrow.step(action)
            pairs.append((one[0], other[0]))
            assert one[1] == other[1]  # the model computes the same
        for one, other in pairs:
            assert other.dtype == np.float32 and np.array_equal(one.astype(np.float32), other)


def test_compact_observations_are_of_order_one():
    venv = gymnasium.make_vec(SHIP, 16, samples_per_step=100, duration_s=10.0, **COMPACT)
    assert venv.single_observation_space.shape == (12,) and venv.single_action_space.shape == (4,)
    observation, _ = venv.reset(seed=1)
    generator = np.random.default_rng(0)
    for _ in range(10):
        observation, *_ = venv.step(generator.uniform(-1.0, 0.8, venv.action_space.shape))
        assert np.abs(observation).max() <= 4.0


def test_the_compact_observation_vanishes_for_the_true_attitude_and_measures_a_tilt():
    """With a perfect unit at rest; the held attitude is replaced by the truth, and by one that is tilted about east."""
    env = gymnasium.make(
        SHIP,
        scenario="static-ecef",
        vehicle="",
        imu="perfect",
        samples_per_step=200,
        duration_s=300.0,
        sway_phases=False,
        **COMPACT,
    ).unwrapped
    _, info = env.reset(seed=1)
    true, place = info["q_nb"], env.setup.task.model.state.slice("held_q")
    for tilt in (0.0, 0.01):
        env.reset(seed=1)
        env.step(np.array([0.0, 0.0, 0.0, -1.0]))
        snapshot = env.snapshot()
        turn = attitude.numeric.from_rotation_vector(np.array([0.0, tilt, 0.0]))
        snapshot.state[place] = attitude.numeric.multiply(turn, true)
        env.restore(snapshot)
        for _ in range(250):
            observation, *_, info = env.step(np.array([0.0, 0.0, 0.0, -1.0]))
        seen = env.named(observation)
        # up turned by 0.01 rad about east points 0.01 to the south
        assert seen["vertical"] == pytest.approx([-tilt, 0.0], abs=1e-5)
        assert np.abs(seen["slope"]).max() < 0.1 + tilt
        # the error is fixed in the inertial frame, in which n turns with the Earth
        earth = geodesy.numeric.earth_rate_n(
            env.snapshot().parameters[env.setup.task.model.parameters.slice("known_latitude")][0]
        )
        turned = attitude.numeric.rotate(attitude.numeric.from_rotation_vector(-250.0 * earth), np.array([0.0, tilt, 0.0]))
        assert info["error"] == pytest.approx(turned, abs=1e-8)


def test_a_correction_turns_the_held_attitude_on_a_logarithmic_scale():
    env = gymnasium.make(SHIP, samples_per_step=20, duration_s=10.0, **COMPACT).unwrapped
    env.reset(seed=1)
    stay = np.array([0.0, 0.0, 0.0, -1.0])
    place = env.setup.task.model.state.slice("held_q")
    env.step(stay)
    for action, expected in (([1.0, 0.0, 0.0], [0.8, 0.0, 0.0]), ([0.0, -1.0, 0.0], [0.0, -0.8, 0.0]), ([0, 0, 0.5], None)):
        before = env.snapshot().state[place]
        env.step(np.array([*action, -1.0]))
        turned = attitude.numeric.error_rotation_vector(env.snapshot().state[place], before)
        if expected is None:
            expected = [0.0, 0.0, 5.8e-4 * (np.sqrt(1.0 + np.pi / 5.8e-4) - 1.0)]
        assert turned == pytest.approx(expected, rel=1e-9, abs=1e-12)
    *_, terminated, _, info = env.step(np.array([0.0, 0.0, 0.0, 0.8]))
    assert not terminated and info["declared"] == 0.0
    *_, terminated, _, info = env.step(np.array([0.0, 0.0, 0.0, 0.95]))
    assert terminated and info["declared"] == 1.0


@pytest.mark.parametrize("more", [COMPACT, {"observation": "compact"}, {"action": "correction"}])
def test_estimators_need_samples_and_an_attitude(more):
    env = gymnasium.make(SHIP, **SHORT, **more)
    with pytest.raises(InputError, match="whose observation holds the samples"):
        agents.make("q-method", env)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"observation": "short"}, "observation = 'short': allowed is 'samples' or 'compact'"),
        ({"action": "gain"}, "action = 'gain': allowed is 'attitude' or 'correction'"),
        ({"dtype": "float16"}, "dtype = 'float16': allowed is 'float64' or 'float32'"),
    ],
)
def test_forms_that_are_not_allowed(given, message):
    with pytest.raises(InputError, match=message):
        gymnasium.make(SHIP, **SHORT, **given)


@pytest.mark.parametrize("id", [SHIP, TUNING])
def test_rows_that_restart_in_the_same_step_are_those_of_sync_vector_env(id):
    venv = gymnasium.make_vec(id, 3, autoreset_mode=AutoresetMode.SAME_STEP, **SHORT)
    sync = SyncVectorEnv([lambda: gymnasium.make(id, **SHORT)] * 3, autoreset_mode=AutoresetMode.SAME_STEP)
    assert venv.unwrapped.autoreset_mode is AutoresetMode.SAME_STEP
    assert np.array_equal(venv.reset(seed=3)[0], sync.reset(seed=3)[0])
    action, ended = np.full(venv.action_space.shape, -0.5), 0
    if id == SHIP:
        action[1, -1] = 1.0  # a row that declares at every step
    for _ in range(18):
        one, other = venv.step(action), sync.step(action)
        testing.assert_same(testing.row_of(one, slice(3)), testing.row_of(other, slice(3)), "SAME_STEP")
        assert ("final_obs" in one[4]) == ("final_obs" in other[4])
        if "final_obs" in one[4]:
            ended += 1
            for mine, theirs in zip(one[4]["final_obs"], other[4]["final_obs"], strict=True):
                assert (mine is None) == (theirs is None) and (mine is None or np.array_equal(mine, theirs))
            assert set(one[4]["final_info"]) == set(other[4]["final_info"])
            for name, values in other[4]["final_info"].items():
                assert np.array_equal(one[4]["final_info"][name], values), name
            assert np.array_equal(one[4]["_final_info"], other[4]["_final_info"])
    assert ended >= 2


def test_the_specification_knows_the_steps_of_an_episode():
    env = gymnasium.make(SHIP, **SHORT)
    assert env.spec.max_episode_steps == 8 and gymnasium.make_vec(SHIP, 2, **SHORT).spec.max_episode_steps == 8
    aware = TimeAwareObservation(env)
    observation, _ = aware.reset(seed=1)
    assert observation.shape == (env.observation_space.shape[0] + 1,)
    assert gymnasium.make(SHIP, max_episode_steps=4, **SHORT).spec.max_episode_steps == 4


def test_a_batch_names_the_seeds_of_its_rows():
    venv = gymnasium.make_vec(SHIP, 3, **SHORT).unwrapped
    venv.reset(seed=5)
    assert venv.np_random_seed == (5, 6, 7)
    snapshot = venv.snapshot()
    venv.reset(seed=[8, None, 9])
    assert venv.np_random_seed == (8, 6, 9)
    venv.restore(snapshot)
    assert venv.np_random_seed == (-1, -1, -1)


def test_an_end_by_time_of_an_alignment_is_terminal_for_stable_baselines():
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed: pip install -e '.[rl]'")
    from insenv.envs.sb3 import BatchVecEnv

    for id, truncated in ((SHIP, False), (TUNING, True)):
        venv, plain = BatchVecEnv(id, 3, seed=4, **SHORT), gymnasium.make_vec(id, 3, autoreset_mode="SameStep", **SHORT)
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
        with pytest.raises(InputError, match="the rows of a batch have no attributes of their own"):
            venv.set_attr("x", 1)


def test_stable_baselines_is_asked_for_when_it_is_missing(monkeypatch):
    import importlib
    import sys

    for name in ("stable_baselines3", "stable_baselines3.common", "stable_baselines3.common.vec_env"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "insenv.envs.sb3", raising=False)
    with pytest.raises(InputError, match="needs Stable-Baselines3, which is not installed: pip install"):
        importlib.import_module("insenv.envs.sb3")
