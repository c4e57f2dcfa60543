"""`insenv.testing.score`: the returns of single episodes, and what it refuses."""

import gymnasium
import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.envs import agents
from insenv.testing import score

SHIP, SHORT = "insenv/ShipNavigation-v0", {"samples_per_step": 50, "duration_s": 1.5}


def test_a_score_is_the_mean_return_of_single_episodes_with_these_seeds():
    found = score(SHIP, "loosely-coupled", [7, 3], **SHORT)
    env, returns = gymnasium.make(SHIP, **SHORT), []
    agent = agents.make("loosely-coupled", env)
    for seed in (7, 3):
        observation, info = env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, info = env.step(agent.act(observation, info))
            total, over = total + reward, terminated or truncated
        returns.append(total)
    assert found.returns.tolist() == returns and found.mean == np.mean(returns)
    assert found.error == pytest.approx(abs(returns[0] - returns[1]) / 2.0)
    assert np.isnan(score(SHIP, "loosely-coupled", [7], **SHORT).error)
    assert str(found) == f"{SHIP}, 2 seeds from 7: {found.mean:.3f} +- {found.error:.3f}"


def test_an_ended_episode_earns_no_more():
    """A quaternion of zeros ends an episode as diverged; the row then starts again, and its next episode is not counted."""

    def policy(venv):
        action = np.zeros((2, venv.single_action_space.shape[0]))
        action[1, 0] = 1.0
        return lambda observations, infos: action

    one, other = score(SHIP, policy, [1, 2], **SHORT).returns
    assert one == pytest.approx(score(SHIP, policy, [1, 1], **SHORT, max_episode_steps=1).returns[0]) and one != other


@pytest.mark.parametrize(
    ("policy", "seeds", "message"),
    [("q-method", [], "seeds = "), ("q-method", [1.5], r"seeds = \[1.5\]"), (3, [1], "policy of type int: allowed is an")],
)
def test_it_refuses(policy, seeds, message):
    with pytest.raises(InputError, match=message):
        score(SHIP, policy, seeds, **SHORT)
