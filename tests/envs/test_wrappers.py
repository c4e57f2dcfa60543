"""The environments inside wrappers and vector environments; pickling, images, video."""

import copy
import pickle
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.error import ResetNeeded
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as vector_wrappers

from insenv.envs import agents, testing
from insenv.errors import InputError

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 10, "duration_s": 0.5}
LEVEL = np.array([1.0, 0.0, 0.0, 0.0, -1.0])


def test_normalised_stacked_narrow_observations():
    env = gymnasium.make(SHIP, **SHORT)
    env = wrappers.FrameStackObservation(wrappers.DtypeObservation(wrappers.NormalizeObservation(env), np.float32), 3)
    observation, _ = env.reset(seed=1)
    size = gymnasium.make(SHIP, **SHORT).observation_space.shape[0]
    assert observation.shape == (3, size) and observation.dtype == np.float32
    for _ in range(5):
        observation, *_ = env.step(LEVEL)
    assert np.isfinite(observation).all()
    # rows that are constant during an episode are normalised to 0; the samples are not
    assert np.abs(observation[-1, :70]).max() > 0.1


def test_rescaled_actions_and_episode_statistics():
    env = wrappers.RecordEpisodeStatistics(wrappers.ClipAction(gymnasium.make(SHIP, **SHORT)))
    env.reset(seed=1)
    over = False
    while not over:
        _, _, terminated, truncated, info = env.step(LEVEL * 3.0)  # clipped to the space: a valid estimate
        over = terminated or truncated
    assert truncated and info["episode"]["l"] == 10


def test_batches_normalised():
    venv = vector_wrappers.NormalizeObservation(gymnasium.make_vec(SHIP, 4, **SHORT))
    venv = vector_wrappers.DictInfoToList(vector_wrappers.RecordEpisodeStatistics(venv))
    venv.reset(seed=1)
    for _ in range(12):
        observation, _, _, _, infos = venv.step(np.tile(LEVEL, (4, 1)))
    assert np.isfinite(observation).all() and len(infos) == 4
    assert infos[2]["q_nb"].shape == (4,)


@pytest.mark.parametrize("shared", [True, False])
def test_several_processes_give_the_results_of_one(shared):
    makers = [partial(gymnasium.make, SHIP, **SHORT)] * 3
    interfaces = SyncVectorEnv(makers), AsyncVectorEnv(makers, shared_memory=shared)
    shown = []
    try:
        for interface in interfaces:
            observation, _ = interface.reset(seed=5)
            steps = [observation]
            for _ in range(14):
                observation, reward, *_ = interface.step(np.tile(LEVEL, (3, 1)))
                steps.append(np.column_stack([observation, reward]))
            shown.append(steps)
    finally:
        interfaces[1].close()
    testing.assert_same(*shown, "SyncVectorEnv and AsyncVectorEnv")


def test_copies_and_pickles_of_batches_continue_bit_identically():
    venv = gymnasium.make_vec(SHIP, 3, **SHORT)
    venv.reset(seed=2)
    actions = np.tile(LEVEL, (3, 1))
    for _ in range(4):
        venv.step(actions)
    copies = [pickle.loads(pickle.dumps(venv)), copy.deepcopy(venv)]
    for _ in range(12):  # beyond the end of an episode
        expected = venv.step(actions)
        for other in copies:
            testing.assert_same([testing.row_of(expected, slice(3))], [testing.row_of(other.step(actions), slice(3))], "a copy")


def test_a_batch_restored_from_a_snapshot_is_bit_identical():
    venv = gymnasium.make_vec(DRIVE, 3, autoreset_mode=AutoresetMode.NEXT_STEP, **SHORT)
    venv.reset(seed=2)
    actions = np.tile(np.eye(10)[0], (3, 1))
    venv.step(actions)
    snapshot = venv.snapshot()
    first = [testing.row_of(venv.step(actions), slice(3)) for _ in range(12)]
    venv.restore(snapshot)
    testing.assert_same(first, [testing.row_of(venv.step(actions), slice(3)) for _ in range(12)], "a restored batch")


@pytest.mark.parametrize("id", [SHIP, DRIVE])
def test_an_image_shows_the_episode(id):
    env = gymnasium.make(id, render_mode="rgb_array", **SHORT)
    env.reset(seed=1)
    before = env.render()
    action = np.zeros(env.action_space.shape)
    action[0], action[-1] = 1.0, -0.5
    for _ in range(4):
        env.step(action)
    after = env.render()
    assert after.shape == (480, 960, 3) and after.dtype == np.uint8
    assert len(np.unique(after.reshape(-1, 3), axis=0)) > 20
    assert not np.array_equal(before, after)


def test_text_shows_the_error_of_the_last_estimate():
    env = gymnasium.make(DRIVE, render_mode="ansi", **SHORT)
    env.reset(seed=1)
    *_, info = env.step(np.eye(10)[0])
    text = env.render()
    assert f"{np.degrees(info['error'][2]):.4f}" in text and "position" in text and len(text.splitlines()) == 8
    with pytest.raises(InputError, match="render_mode"):
        gymnasium.make(SHIP, **SHORT).unwrapped.render()


def test_a_video_is_recorded(tmp_path):
    pytest.importorskip("moviepy", reason="moviepy is not installed")
    env = gymnasium.make(SHIP, render_mode="rgb_array", samples_per_step=20, duration_s=0.5)
    env = wrappers.RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda episode: True, disable_logger=True)
    env.reset(seed=1)
    for _ in range(5):
        env.step(LEVEL)
    env.close()
    videos = list(tmp_path.glob("videos/*.mp4"))
    assert len(videos) == 1 and videos[0].stat().st_size > 2000


def test_an_agent_acts_through_wrappers():
    env = wrappers.RecordEpisodeStatistics(gymnasium.make(SHIP, **SHORT))
    agent = agents.make("q-method", env)
    observation, info = env.reset(seed=1)
    assert env.action_space.contains(agent.act(observation, info))


@pytest.mark.parametrize("mode", ["rgb_array", "ansi"])
def test_a_restored_or_pickled_environment_carries_its_history(mode):
    env = gymnasium.make(SHIP, render_mode=mode, **SHORT).unwrapped
    env.reset(seed=1)
    for _ in range(4):
        env.step(LEVEL)
    other = gymnasium.make(SHIP, render_mode=mode, **SHORT).unwrapped
    other.reset(seed=9)
    other.restore(env.snapshot())
    for copied in (other, pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert np.array_equal(copied.render(), env.render())
        copied.step(LEVEL)
        assert len(copied.history) == 6 and len(env.history) == 5


def test_a_history_that_was_not_recorded_is_not_drawn():
    plain, drawn = gymnasium.make(SHIP, **SHORT).unwrapped, gymnasium.make(SHIP, render_mode="ansi", **SHORT).unwrapped
    plain.reset(seed=1)
    drawn.reset(seed=9)
    plain.step(LEVEL)
    drawn.restore(plain.snapshot())
    with pytest.raises(ResetNeeded, match="a snapshot that was not rendered"):
        drawn.render()
    drawn.step(LEVEL)
    assert "0.10 s" in drawn.render()
