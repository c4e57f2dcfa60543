"""Baseline agents: the registered estimators as agents of the estimation environments, single and vector.

    agent = insenv.envs.agents.make("qakf-improved", env)
    observation, info = env.reset(seed=1)
    action = agent.act(observation, info)

An agent uses observations only: they contain the initial knowledge, and the first one of an episode has time 0.  It
accepts the info and ignores it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from insenv import estimators, geodesy
from insenv.base.errors import InputError
from insenv.core.batch import make_batch
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.envs.checks import check_number, check_whole
from insenv.envs.estimation_task import FIX_SOURCES, estimate_action
from insenv.envs.knowledge import knowledge_of
from insenv.envs.setup import Setup
from insenv.estimators import Estimator
from insenv.scenario import build
from insenv.scenario.inputs import bridge_lost


def make(
    estimator: str | Estimator,
    env: Any,
    *,
    declare_after_s: float | None = None,
    tuning: Mapping[str, Any] | None = None,
    threads: int = 1,
) -> Agent:
    """Return an estimator, by its id or the object, as an agent of `env`, which is single (wrapped or not) or vector.

    declare_after_s: time from which an alignment is declared, s; None: never.  tuning: parameter rows of the estimator,
    SI, which override those of the scenario.  threads: worker threads over the rows of a vector environment.  Raises
    `InputError` for an estimator that cannot act in `env`.
    """
    chosen, setup = estimators.get(estimator), getattr(env.unwrapped, "setup", None)
    if not isinstance(setup, Setup) or "estimate_q_nb" not in setup.task.actions or "delta_angle" not in setup.task.watched:
        name = getattr(getattr(env, "spec", None), "id", None) or env
        raise InputError(
            f"estimator {chosen.id!r} cannot act in {name}: allowed is an environment whose action is an estimate and whose "
            "observation holds the samples (insenv/...Alignment, ...Navigation)"
        )
    navigates = "estimate_velocity" in setup.task.actions
    if navigates and not chosen.navigates:
        raise InputError(f"estimator {chosen.id!r} gives no velocity and position: this environment asks for them")
    scenario = setup.scenario
    chosen = build(scenario).adapted(chosen, offline=False)
    chosen.check(scenario.drive(offline=False), {**scenario.tunings.get(chosen.id, {}), **(tuning or {})})
    kind = VectorAgent if isinstance(env.unwrapped, VectorEnv) else SingleAgent
    rows = env.unwrapped.num_envs if kind is VectorAgent else 1
    return kind(chosen, setup, rows, declare_after_s, dict(tuning or {}), threads)


class Agent:
    """An estimator that acts in an environment.  Made by `make`."""

    def __init__(
        self, estimator: Estimator, setup: Setup, rows: int, declare_after: float | None, tuned: dict[str, Any], threads: int
    ) -> None:
        self.estimator, self.setup, self.rows = estimator, setup, rows
        check_whole("threads", threads)
        most = np.finfo(float).max
        self._declare_after = (
            np.inf if declare_after is None else check_number("declare_after_s", declare_after, 0.0, most, "s")
        )
        self._tunings, self._tuned = setup.scenario.tunings, tuned
        self._same = build(setup.scenario, driven=True).knowledge
        self._layout, self._samples = setup.layout, setup.samples
        model = estimator.model
        self._inputs = np.tile(model.inputs.start_vector(), (rows, setup.samples, 1))
        if "dt" in model.inputs:
            self._inputs[..., model.inputs.slice("dt")] = setup.interval
        taken = [name for name in setup.task.watched.names if name in model.inputs]
        self._taken = _joined([(model.inputs.slice(name), setup.task.watched.slice(name)) for name in taken])
        self._takes_fixes = "gnss_valid" in model.inputs and "fix_new" in setup.task.observation

    def act(self, observation: Array, info: Mapping[str, Any] | None = None) -> Array:
        """Return the action for an observation (or those of all rows): the estimate at its time."""
        observation = np.asarray(observation)
        seen = self._layout.unpack(observation.reshape(self.rows, -1))
        action = self._action(self._outputs(seen, np.flatnonzero(seen["time"] == 0.0)), seen)
        return action if observation.ndim > 1 else action[0]

    def _outputs(self, seen: Mapping[str, Any], fresh: NDArray[np.intp]) -> Array:
        """Return the estimator's outputs (rows, outputs.size); the rows `fresh` begin an episode."""
        raise NotImplementedError

    def _parameters(self, known: Mapping[str, Any]) -> Array:
        rows = self.estimator.parameters(knowledge_of(known, self._same), self._tunings, self._tuned)
        return self.estimator.model.parameters.pack(rows)

    def _feed(self, seen: Mapping[str, Any]) -> Array:
        """Return the estimator's inputs (rows, samples, inputs.size) for observations by name, (rows, ...)."""
        imu = seen["imu"]
        if not imu[..., 6].all():
            imu = _bridged(imu)
        for mine, theirs in self._taken:
            self._inputs[..., mine] = imu[..., theirs]
        if self._takes_fixes:
            self._fixes(seen)
        return self._inputs

    def _fixes(self, seen: Mapping[str, Any]) -> None:
        """Write each new fix into the inputs of the sample with which it was delivered."""
        inputs, table = self._inputs, self.estimator.model.inputs
        for name in ("gnss_valid", "gnss_velocity_valid"):
            if name in table:
                inputs[..., table.slice(name)] = 0.0
        new = np.flatnonzero(seen["fix_new"])
        if not len(new):
            return
        since = (seen["fix_age"][new] - seen["fix_delay"][new]) / self.setup.interval
        sample = self._samples - 1 - np.rint(since).astype(int)
        reference = (seen[f"known_{name}"][new] for name in ("latitude", "longitude", "height"))
        latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(seen["fix_position"][new], *reference)
        rows = {source: seen[name][new] for name, source in FIX_SOURCES.items()}
        rows |= {"gnss_latitude": latitude, "gnss_longitude": longitude, "gnss_height": height, "gnss_valid": np.ones(len(new))}
        for name, values in rows.items():
            if name in table:
                inputs[new, sample, table.slice(name)] = values.reshape(len(new), -1)

    def _action(self, outputs: Array, seen: Mapping[str, Any]) -> Array:
        """Return the actions (rows, actions.size) from the estimator's outputs."""
        estimate = self.estimator.model.outputs.unpack(outputs)
        q_nb = estimate["q_nb"] / np.linalg.norm(estimate["q_nb"], axis=1, keepdims=True)
        declare = np.where(seen["time"] >= self._declare_after, 1.0, -1.0)
        if "estimate_velocity" not in self.setup.task.actions:
            return estimate_action(self.setup.task, q_nb, declare)
        reference = (seen[f"known_{name}"] for name in ("latitude", "longitude", "height"))
        position = geodesy.numeric.ned_offset(estimate["latitude"], estimate["longitude"], estimate["height"], *reference)
        return estimate_action(self.setup.task, q_nb, -1.0, estimate["velocity_n"], position)


class SingleAgent(Agent):
    """The agent of a single environment, on one runner."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._runner = make_runner(self.estimator.model)

    def _outputs(self, seen: Mapping[str, Any], fresh: NDArray[np.intp]) -> Array:
        if not len(fresh):
            return self._runner.run(self._samples, self._feed(seen)[0], self._samples)
        self._runner.p[:] = self._parameters({name: value[0] for name, value in seen.items()})
        self._runner.start()
        return self._runner.output()[None]


class VectorAgent(Agent):
    """The agent of a vector environment, on one batch; row i is bit-identical to the single agent."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        model: Model = self.estimator.model
        base = np.tile(model.parameters.start_vector(), (self.rows, 1))
        self._batch = make_batch(model, self.rows, base, threads=args[-1])

    def _outputs(self, seen: Mapping[str, Any], fresh: NDArray[np.intp]) -> Array:
        outputs = np.empty((self.rows, self.estimator.model.outputs.size))
        if len(fresh) < self.rows:
            outputs = self._batch.run(self._samples, self._feed(seen), self._samples)[:, 0]
        if len(fresh):
            parameters = [self._parameters({name: value[i] for name, value in seen.items()}) for i in fresh]
            self._batch.start_rows(fresh, np.array(parameters))
            outputs[fresh] = self._batch.output()[fresh]
        return outputs


def _joined(pairs: Sequence[tuple[slice, slice]]) -> list[tuple[slice, slice]]:
    """Return the places to copy to and from, merging neighbours: copying six numbers is as fast as copying three."""
    joined = [pairs[0]]
    for to, come in pairs[1:]:
        before_to, before_come = joined[-1]
        if before_to.stop == to.start and before_come.stop == come.start:
            joined[-1] = slice(before_to.start, to.stop), slice(before_come.start, come.stop)
        else:
            joined.append((to, come))
    return joined


def _bridged(imu: Array) -> Array:
    """Return samples (rows, n, 7) with the lost ones interpolated between their neighbours."""
    imu = imu.copy()
    for row in np.flatnonzero(~imu[..., 6].all(axis=1)):
        columns = {"delta_angle": imu[row, :, 0:3], "delta_velocity": imu[row, :, 3:6], "imu_valid": imu[row, :, 6]}
        bridge_lost(columns)
    return imu
