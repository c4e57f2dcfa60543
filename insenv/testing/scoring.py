"""The score of a policy in an environment: its returns over seeds, a row of the tables of docs/leaderboard.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.envs import agents
from insenv.envs.checks import is_whole, refused
from insenv.estimators import Estimator

HELD_OUT = range(1_000_000, 1_000_064)
"""Seeds of the tables, on which nothing is trained or chosen."""

Act = Callable[[Any, Any], Any]
Policy = str | Estimator | Callable[[Any], Act]


@dataclass(frozen=True, eq=False)
class Score:
    """What a policy scores.  returns (seeds,): the sum of the rewards of each episode."""

    env_id: str
    seeds: tuple[int, ...]
    returns: Array

    @property
    def mean(self) -> float:
        """The mean over the seeds."""
        return float(self.returns.mean())

    @property
    def error(self) -> float:
        """The standard error of the mean; no number (NaN) for one seed."""
        return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns))) if len(self.returns) > 1 else math.nan

    def __str__(self) -> str:
        return f"{self.env_id}, {len(self.seeds)} seeds from {self.seeds[0]}: {self.mean:.3f} +- {self.error:.3f}"


def score(env_id: str, policy: Policy, seeds: Sequence[int] = HELD_OUT, **arguments: Any) -> Score:
    """Return the score of a policy over one episode of each seed, all in one batch of the environment.

    policy: an estimator by its id or the object, or a function that takes the vector environment, which has been reset, and
    returns the policy of these episodes: a function of observations and infos that returns actions.  arguments: of the
    environment.  Raises `InputError` for seeds that are no whole numbers, and for an estimator that cannot act there.
    """
    chosen = list(seeds) if isinstance(seeds, Iterable) else []
    if not chosen or not all(is_whole(seed) for seed in chosen):
        raise refused("seeds", seeds, "a sequence of whole numbers from 0")
    if not callable(policy) and not isinstance(policy, (str, Estimator)):
        raise InputError(f"policy of type {type(policy).__name__}: allowed is an estimator, or a function of the environment")
    if "num_envs" in arguments:
        raise refused("num_envs", arguments["num_envs"], "none: there is one row for each seed")
    returns, running = np.zeros(len(chosen)), np.ones(len(chosen), dtype=bool)
    venv: Any
    with closing(gymnasium.make_vec(env_id, len(chosen), **arguments)) as venv:
        observations, infos = venv.reset(seed=[int(seed) for seed in chosen])
        act = policy(venv) if callable(policy) else agents.make(policy, venv).act
        if not callable(act):
            raise InputError(f"policy(env) gives {act!r}: allowed is a function of observations and infos")
        while running.any():
            observations, rewards, terminated, truncated, infos = venv.step(act(observations, infos))
            returns += np.where(running, rewards, 0.0)
            running &= ~(terminated | truncated)
    return Score(env_id, tuple(int(seed) for seed in chosen), returns)
