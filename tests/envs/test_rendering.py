"""Images, text and video of an episode, and the history that they are drawn from."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

from insenv.envs import IDS

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 10, "duration_s": 0.5}
LEVEL = np.array([1.0, 0.0, 0.0, 0.0, -1.0])


@pytest.mark.parametrize("id", IDS)
def test_an_episode_of_every_environment_has_its_time_and_error_as_text(id):
    env = gymnasium.make(id, render_mode="ansi", samples_per_step=50, duration_s=1.0)
    env.reset(seed=1)
    env.step(np.zeros(env.action_space.shape) + 0.1)
    time, truth, *errors = env.render().splitlines()
    assert time.split() == ["time", f"{50 * env.unwrapped.setup.interval:.2f}", "s"] and "heading" in truth and errors


@pytest.mark.parametrize("id", [SHIP, *(pytest.param(id, marks=pytest.mark.slow) for id in (DRIVE, *IDS[-3:]))])
def test_an_image_shows_the_episode(id):
    env = gymnasium.make(id, render_mode="rgb_array", **SHORT)
    env.reset(seed=1)
    before = env.render() if id == SHIP else 0
    action = np.zeros(env.action_space.shape)
    action[0], action[-1] = 1.0, -0.5
    for _ in range(4):
        env.step(action)
    after = env.render()
    assert after.shape == (480, 960, 3) and after.dtype == np.uint8
    assert len(np.unique(after.reshape(-1, 3), axis=0)) > 20 and not np.array_equal(before, after)


def test_an_image_depends_on_the_episode_alone_and_shows_all_of_it():
    """Drawn at each step, as bounds grow, or once at the end; every place and every error lies within the bounds."""
    env, other = (gymnasium.make(DRIVE, render_mode="rgb_array", samples_per_step=200, duration_s=40.0).unwrapped for _ in "12")
    for each in (env, other):
        each.reset(seed=1)
    action = np.eye(env.action_space.shape[0])[0]
    for _ in range(30):
        env.step(action)
        other.step(action)
        seen = env.render()
        if len(other.history) == 7:
            other.render()
    assert np.array_equal(seen, other.render())
    track, *panels = env._drawing._panels[1:]
    places = np.array([info["position"] for *_, info in env.history])
    (left, right), (low, high) = track.axes.get_xlim(), track.axes.get_ylim()
    assert (places[:, 1] > left).all() and (places[:, 1] < right).all()
    assert (places[:, 0] > low).all() and (places[:, 0] < high).all()
    box = track.axes.bbox
    assert (right - left) / box.width == pytest.approx((high - low) / box.height)
    assert len(panels) == 4
    for panel in panels:
        (curve, limit), (low, high) = panel.parts, panel.axes.get_ylim()
        drawn = np.concatenate([curve.get_ydata(), limit.get_ydata()])
        assert len(curve.get_ydata()) == 30 and np.nanmin(drawn) >= low and np.nanmax(drawn) <= high < 11.0 * np.nanmax(drawn)


def test_a_restored_copied_or_pickled_environment_carries_its_history():
    env, other = (gymnasium.make(SHIP, render_mode="ansi", **SHORT).unwrapped for _ in range(2))
    for each, seed in ((env, 1), (other, 9)):
        each.reset(seed=seed)
    for _ in range(4):
        env.step(LEVEL)
    other.restore(env.snapshot())
    for copied in (other, pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert copied.render() == env.render()
        copied.step(LEVEL)
        assert len(copied.history) == 6 and len(env.history) == 5
