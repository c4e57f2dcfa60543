"""Rank policies in the alignment environments: mean score and standard error over seeds, with the bound of the sensors.

The time at which an estimator declares is chosen on seeds of its own.

python examples/rank_policies.py --seeds 8 --duration 60 insenv/ShipAlignment-v0
"""

import argparse

import gymnasium
import numpy as np
from own_estimator import FrozenFrame

import insenv
from insenv.attitude import numeric as attitude
from insenv.envs import IDS, agents, estimate_action

CHOICE = 500_000
"""First seed of those on which a time is chosen."""


class Random:
    """A random attitude at every step."""

    def __init__(self, env):
        self.env, self.generator = env, np.random.default_rng(1)

    def act(self, observation, info=None):
        return estimate_action(self.env.unwrapped.setup.task, self.generator.normal(size=(len(observation), 4)).clip(-1, 1))


class Reported:
    """The reported attitude."""

    def __init__(self, env):
        self.env = env

    def act(self, observation, info=None):
        reported = np.moveaxis(self.env.unwrapped.named(observation)["known_attitude"], -1, 0)
        return estimate_action(self.env.unwrapped.setup.task, attitude.from_euler(*reported))


def scores(venv, policy, seed):
    """Return the scores (steps, rows) of one episode per row, had it been declared at each step: -(m + share of the time)."""
    observation, info = venv.reset(seed=seed)
    steps = venv.unwrapped.setup.decisions
    measures = []
    for _ in range(steps):
        observation, _, _, _, info = venv.step(policy.act(observation, info))
        measures.append(info["measure"].copy())
    return -np.array(measures) - np.arange(1, steps + 1)[:, None] / steps


def bound(venv, draws=20_000):
    """Return the mean score at each step (steps,) of errors that are normal with the limit at its time as deviation.

    The limit is that of a level unit with the scenario's heading.  If errors are as normal as that, nothing that is observed
    tells more about them, and the best time is the same in all episodes.
    """
    setup, time = venv.unwrapped.setup, np.arange(venv.unwrapped.setup.decisions) * venv.unwrapped.setup.samples
    tilt, heading = setup.starts.ranges.initial_error
    values = setup.scenario.model_dump(exclude_unset=True)
    values["knowledge"] = {**values.get("knowledge", {}), "tilt_sigma_deg": tilt, "heading_sigma_deg": heading}
    found = insenv.limit(values, duration_s=setup.decisions * setup.samples * setup.interval)
    limit = np.stack([np.sqrt(np.interp(time * setup.interval, found.time, axis**2)) for axis in found.rotation.T], axis=1)
    errors = np.random.default_rng(1).normal(size=(draws, 3))
    ratio = limit / found.rotation[-1]
    measure = np.array([np.mean(np.log(1.0 + np.sqrt(np.mean((errors * each) ** 2, axis=1)))) for each in ratio])
    return -measure - np.arange(1, len(time) + 1) / len(time)


def ranking(id, seeds, seed=1, **kwargs):
    """Return the scores (seeds,) of each policy, by name, worst first; then, by name and time, of those that declare at a time
    that is best on other seeds; then the bound at its best time."""
    venv = gymnasium.make_vec(id, seeds, samples_per_step=200, **kwargs)
    step = 200 * venv.unwrapped.setup.interval
    policies = {
        "random": Random(venv),
        "quit": Reported(venv),
        "analytic": agents.make("analytic", venv),
        "frozen frame": FrozenFrame(venv),
        "q-method": agents.make("q-method", venv),
    }
    found = {name: scores(venv, policy, seed) for name, policy in policies.items()}
    ranked = {name: each[0 if name == "quit" else -1] for name, each in found.items()}
    for name in ("frozen frame", "q-method"):
        chosen = scores(venv, policies[name], CHOICE).mean(axis=1).argmax()
        ranked[f"{name}, {chosen * step:g} s"] = found[name][chosen]
    best = bound(venv)
    return {**ranked, f"bound, {best.argmax() * step:g} s": np.full(seeds, best.max())}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ids", nargs="*", default=[id for id in IDS if "Alignment" in id])
    parser.add_argument("--seeds", type=int, default=64)
    parser.add_argument("--duration", type=float, default=None, help="s; the scenario's if absent")
    arguments = parser.parse_args()
    for id in arguments.ids:
        print(f"{id}, {arguments.seeds} seeds")
        for name, found in ranking(id, arguments.seeds, duration_s=arguments.duration).items():
            print(f"  {name:20} {found.mean():7.2f} +- {found.std() / np.sqrt(len(found)):.2f}")
