"""The vector interface: rows that end and start again, seeds of rows, starts that are drawn."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from insenv.envs import testing

SHIP, TUNING = "insenv/ShipAlignment-v0", "insenv/Tuning-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}


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


def test_max_episode_steps_acts_like_the_wrapper():
    testing.check_rows(
        lambda: gymnasium.make(SHIP, max_episode_steps=4, **SHORT),
        lambda n, **more: gymnasium.make_vec(SHIP, n, max_episode_steps=4, **SHORT, **more),
    )


def test_one_row_ends_alone():
    """By an estimate that is not a number, or by its declaration; without autoreset it takes no further step."""
    venv = gymnasium.make_vec(SHIP, 3, autoreset_mode=AutoresetMode.DISABLED, **SHORT)
    actions = np.tile(np.array([1.0, 0.0, 0.0, 0.0, -1.0]), (3, 1))
    with pytest.raises(ResetNeeded, match="before reset"):
        venv.step(actions)
    for place, value, name in ((1, np.nan, "diverged"), (-1, 1.0, "declared")):
        venv.reset(seed=1)
        wrong = actions.copy()
        wrong[2, place] = value
        _, _, terminated, _, info = venv.step(wrong)
        assert terminated.tolist() == [False, False, True] and info[name].tolist() == [0.0, 0.0, 1.0]
        with pytest.raises(ResetNeeded, match=r"rows \[2\] have ended"):
            venv.step(actions)
