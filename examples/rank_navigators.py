"""Rank policies in the navigation environments: mean return and standard error over seeds.

python examples/rank_navigators.py --seeds 8 --duration 60 insenv/VehicleNavigation-v0
"""

import argparse

import gymnasium
import numpy as np

import insenv
from insenv.attitude import numeric as attitude
from insenv.envs import IDS, agents, estimate_action

LONGEST = 1800.0
"""s: of the survey flight it contains all outages."""


class Random:
    """A random attitude, velocity and position at every step, anywhere in the action space."""

    def __init__(self, env):
        self.env, self.generator = env, np.random.default_rng(1)

    def act(self, observation, info=None):
        return self.generator.uniform(-1.0, 1.0, self.env.action_space.shape)


class Reported:
    """The reported start, as if the vehicle stood still."""

    def __init__(self, env):
        self.env = env.unwrapped

    def act(self, observation, info=None):
        seen = self.env.named(observation)
        q_nb = attitude.from_euler(*np.moveaxis(seen["known_attitude"], -1, 0))
        return estimate_action(self.env.setup.task, q_nb, -1.0, seen["known_velocity_n"], np.zeros((len(q_nb), 3)))


class Fixes:
    """The latest fix, with the reported attitude turned about down such that it drives forward; no inertial sample."""

    def __init__(self, env):
        self.env = env.unwrapped

    def act(self, observation, info=None):
        seen = self.env.named(observation)
        fixed = np.any(seen["fix_position_sigma"] > 0.0, axis=1, keepdims=True)
        velocity = np.where(fixed, seen["fix_velocity_n"], seen["known_velocity_n"])
        roll, pitch, heading = np.moveaxis(seen["known_attitude"], -1, 0)
        moves = np.linalg.norm(velocity[:, :2], axis=1) > 1.0
        q_nb = attitude.from_euler(roll, pitch, np.where(moves, np.arctan2(velocity[:, 1], velocity[:, 0]), heading))
        position = np.where(fixed, seen["fix_position"] + velocity * seen["fix_age"][:, None], 0.0)
        return estimate_action(self.env.setup.task, q_nb, -1.0, velocity, position)


def returns(venv, agent, seed):
    """Return the return of one episode per row, minus the mean over its time of the measure m."""
    observation, info = venv.reset(seed=seed)
    total, over = np.zeros(venv.num_envs), np.zeros(venv.num_envs, dtype=bool)
    while not over.all():
        observation, reward, terminated, truncated, info = venv.step(agent.act(observation, info))
        total += np.where(over, 0.0, reward)
        over |= terminated | truncated
    return total


def at_the_limit(draws=200_000):
    """Return the mean return of errors that are exactly normal with the limit as standard deviation at all times."""
    ratio = np.random.default_rng(1).normal(size=(draws, 9))
    return -np.mean(np.log(1.0 + np.sqrt(np.mean(ratio**2, axis=1))))


def ranking(id, seeds, seed=1, **kwargs):
    """Return the returns (seeds,) of each policy, by name, worst first."""
    venv = gymnasium.make_vec(id, seeds, samples_per_step=200, **kwargs)
    policies = {
        "random": Random(venv),
        "reported start": Reported(venv),
        "wander-sins": agents.make("wander-sins", venv),
        "fixes": Fixes(venv),
        "loosely-coupled": agents.make("loosely-coupled", venv),
        "fusion": agents.make("fusion", venv),
    }
    return {name: returns(venv, policy, seed) for name, policy in policies.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", default=[id for id in IDS if "Navigation" in id])
    parser.add_argument("--seeds", type=int, default=64)
    parser.add_argument("--duration", type=float, default=LONGEST, help="s; at most that of the scenario")
    arguments = parser.parse_args()
    print(f"insenv {insenv.__version__}: mean return and standard error of {arguments.seeds} episodes")
    for id in arguments.ids:
        duration = min(arguments.duration, gymnasium.make(id).unwrapped.setup.scenario.duration_s)
        print(f"{id}, {duration:g} s")
        for name, found in ranking(id, arguments.seeds, duration_s=duration).items():
            print(f"  {name:16} {found.mean():7.3f} +- {found.std() / np.sqrt(len(found)):.3f}")
    print(f"errors exactly as large as the limit: {at_the_limit():.3f}")
