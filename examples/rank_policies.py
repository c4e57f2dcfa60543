"""Rank policies in the alignment environments: mean score and standard error over seeds, with the bound of the sensors.

python examples/rank_policies.py --seeds 8 --duration 60 insenv/ShipAlignment-v0
"""

import argparse

import gymnasium
import numpy as np
from own_estimator import FrozenFrame, scores

from insenv.attitude import numeric as attitude
from insenv.envs import IDS, agents, estimate_action


class Random:
    """A random attitude at every step."""

    def __init__(self, env):
        self.env, self.generator = env, np.random.default_rng(1)

    def act(self, observation, info=None):
        return estimate_action(self.env.unwrapped.setup.task, self.generator.normal(size=(len(observation), 4)).clip(-1, 1))


class Quit:
    """The reported attitude, declared at the first step."""

    def __init__(self, env):
        self.env = env

    def act(self, observation, info=None):
        reported = np.moveaxis(self.env.unwrapped.named(observation)["known_attitude"], -1, 0)
        return estimate_action(self.env.unwrapped.setup.task, attitude.from_euler(*reported), declare=1.0)


def bound(time_weight=1.0, draws=200_000):
    """Return the mean score at the end of the time of errors that are exactly normal with the limit as deviation."""
    ratio = np.random.default_rng(1).normal(size=(draws, 3))
    return -np.mean(np.log(1.0 + np.sqrt(np.mean(ratio**2, axis=1)))) - time_weight


def ranking(id, seeds, seed=1, **kwargs):
    """Return the scores (seeds,) of each policy, by name, worst first."""
    venv = gymnasium.make_vec(id, seeds, samples_per_step=200, **kwargs)
    policies = {
        "random": Random(venv),
        "quit": Quit(venv),
        "analytic": agents.make("analytic", venv),
        "frozen frame": FrozenFrame(venv),
        "q-method": agents.make("q-method", venv),
    }
    return {name: scores(venv, policy, seed) for name, policy in policies.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", default=[id for id in IDS if "Alignment" in id])
    parser.add_argument("--seeds", type=int, default=64)
    parser.add_argument("--duration", type=float, default=None, help="s; the scenario's if absent")
    arguments = parser.parse_args()
    for id in arguments.ids:
        print(f"{id}, {arguments.seeds} seeds")
        for name, found in ranking(id, arguments.seeds, duration_s=arguments.duration).items():
            print(f"  {name:14} {found.mean():7.2f} +- {found.std() / np.sqrt(len(found)):.2f}")
        print(f"  {'bound':14} {bound():7.2f}")
