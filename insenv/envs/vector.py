"""The vector interface of an environment: a `gymnasium.vector.VectorEnv` on one batch of its task.

Row i is bit-identical to the single environment reset with seed + i, through all its episodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.batch import Batch, make_batch
from insenv.core.tables import Array
from insenv.envs.checks import check_type, check_whole, is_whole, refused
from insenv.envs.setup import checked_action
from insenv.envs.single import Interface, Snapshot, places_of

Infos = dict[str, Any]


@dataclass(kw_only=True, repr=False, eq=False)
class InertialVectorEnv(Interface, VectorEnv[Array, Array, Any]):
    """Many environments of a task in one batch; its subclasses define the task.

    num_envs: number of rows.  autoreset_mode: NEXT_STEP (an ended row restarts on the next step, which ignores its
    action and gives it reward 0), SAME_STEP (it restarts within the step; ``infos["final_obs"]`` and ``infos["final_info"]``
    hold its end) or DISABLED (``reset(options={"reset_mask": mask})`` restarts the rows of the mask).
    threads: worker threads over the rows.  max_episode_steps: truncates as the wrapper TimeLimit does.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    num_envs: int = field(default=1, kw_only=False)
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP
    threads: int = 1
    backend: str | None = None
    render_mode: str | None = None
    max_episode_steps: int | None = None

    def __post_init__(self) -> None:
        self.setup = setup = self.set_up()
        if self.render_mode is not None:
            raise refused("render_mode", self.render_mode, "None; only a single environment is drawn")
        mode = next((m for m in AutoresetMode if self.autoreset_mode in (m, m.value, m.name)), None)
        if mode is None:
            raise refused("autoreset_mode", self.autoreset_mode, " or ".join(repr(m.value) for m in AutoresetMode))
        self.num_envs, self.autoreset_mode = check_whole("num_envs", self.num_envs), mode
        self._most = np.inf if self.max_episode_steps is None else check_whole("max_episode_steps", self.max_episode_steps)
        self._elapsed = np.zeros(self.num_envs)
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        self.single_action_space, self.single_observation_space = setup.spaces()
        self.action_space, self.observation_space = (
            batch_space(space, self.num_envs) for space in (self.single_action_space, self.single_observation_space)
        )
        task = setup.task
        base = np.tile(setup.task.model.parameters.start_vector(), (self.num_envs, 1))
        self._batch: Batch = make_batch(
            task.model, self.num_envs, base, threads=check_whole("threads", self.threads), backend=self.backend
        )
        self._places = places_of(setup)
        self._reward, self._terminated, self._truncated = (
            self._places[name].start for name in ("reward", "terminated", "truncated")
        )
        self._observed = self._reward
        self._info_places = [(row.name, f"_{row.name}", self._places[row.name], bool(row.shape)) for row in task.info]
        self._outputs = slice(task.watched.size * setup.samples, None)
        self._call, self._inputs = self._batch.cycle(task.judge, task.watched.names, setup.samples)
        self._inputs[:] = task.model.inputs.start_vector()
        self._actions = self._inputs[:, task.place]
        self._over: NDArray[np.bool_] | None = None
        self._generators: list[np.random.Generator] = []
        self._generator_seeds: list[int] = [-1] * self.num_envs

    @property
    def np_random_seed(self) -> Any:
        """Seed of each row's generator, a tuple; -1 where it is not known, as after `restore`."""
        return tuple(self._generator_seeds)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Start all rows, or those of ``options["reset_mask"]``.

        Row i takes seed + i, or the i-th seed of a sequence.  The other options (see the class) replace the arguments
        for these episodes.
        """
        check_type("options", options, (Mapping, type(None)), "a mapping or None")
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        rows = np.arange(self.num_envs) if mask is None else np.flatnonzero(self._mask(mask))
        chosen: list[int] = rows.tolist()
        if mask is not None and self._over is None:
            raise ResetNeeded("reset() with a reset_mask before the first reset() of all rows")
        seeds = self._seeds(seed)
        if not self._generators:
            self._generators, self._generator_seeds = map(list, zip(*(seeding.np_random(s) for s in seeds), strict=True))
        else:
            for i in chosen:
                if seeds[i] is not None:
                    self._generators[i], self._generator_seeds[i] = seeding.np_random(seeds[i])
        if self._over is None:
            self._over = np.zeros(self.num_envs, dtype=bool)
        self._start(rows, options or None)
        values = np.zeros((self.num_envs, max(place.stop for place in self._places.values())))
        values[:, self._outputs] = self._batch.output()
        return self.setup.seen(values[:, : self._observed]), self._info(values)

    def step(self, actions: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], Infos]:
        """Judge each row's action, then advance to the next decision; `autoreset_mode` decides about ended rows."""
        if self._over is None:
            raise ResetNeeded("step() before reset(): call reset() first")
        self._actions[:] = checked_action(actions, self._actions.shape)
        over = self._over.nonzero()[0]
        if len(over) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ResetNeeded(f'rows {over[:8].tolist()} have ended: reset(options={{"reset_mask": mask}}) starts them again')
        values = self._call()
        self._elapsed += 1
        if len(over):  # NEXT_STEP: the new episode has no score yet
            self._show_starts(over, values)
            values[over, self._reward : self._truncated + 1] = 0.0
        reward, terminated, truncated = self._rewards(values, over), values[:, self._terminated], values[:, self._truncated]
        # as the wrapper TimeLimit does for a single environment
        terminated, truncated = terminated != 0.0, (truncated != 0.0) | (self._elapsed >= self._most)
        self._over = terminated | truncated
        final: Infos = {}
        ended = self._over.nonzero()[0]
        if len(ended) and self.autoreset_mode is AutoresetMode.SAME_STEP:
            final = self._final(ended, values)
            self._show_starts(ended, values)
        return self.setup.seen(values[:, : self._observed]), reward, terminated, truncated, {**self._info(values), **final}

    def _rewards(self, values: Array, restarted: NDArray[np.intp]) -> Array:
        """Return the rewards of the rows: the task's, or those of the function that the environment was made with."""
        if self.setup.reward is None:
            return values[:, self._reward].copy()
        infos, rewards = self._info(values), np.zeros(self.num_envs)
        for row in np.setdiff1d(np.arange(self.num_envs), restarted):
            rewards[row] = self.setup.paid({name: infos[name][row] for name, *_ in self._info_places})
        return rewards

    def _show_starts(self, rows: NDArray[np.intp], values: Array) -> None:
        """Start rows again and write their first observations into `values`."""
        self._start(rows, None)
        values[rows] = 0.0
        values[rows, self._outputs] = self._batch.output()[rows]

    def _final(self, rows: NDArray[np.intp], values: Array) -> Infos:
        """Return the last observations and infos of ended rows, in the form of `gymnasium.vector.SyncVectorEnv`."""
        ended = np.zeros(self.num_envs, dtype=bool)
        ended[rows] = True
        observations = np.full(self.num_envs, None, dtype=object)
        for row in rows:
            observations[row] = self.setup.seen(values[row, : self._observed].copy())
        infos = {
            name: ended.copy() if name.startswith("_") else np.where(ended.reshape(-1, *[1] * (info.ndim - 1)), info, 0.0)
            for name, info in self._info(values).items()
        }
        return {"final_obs": observations, "_final_obs": ended, "final_info": infos, "_final_info": ended.copy()}

    def _start(self, rows: NDArray[np.intp], options: dict[str, Any] | None) -> None:
        if not len(rows):
            return
        starts = self.setup.starts.with_options(options)
        p = starts.draw([self._generators[i] for i in rows])
        self._batch.start_rows(rows, starts.complete(p, self._batch.starts(p)))
        assert self._over is not None
        self._over[rows] = False
        self._elapsed[rows] = 0

    def _info(self, values: Array) -> Infos:
        infos: Infos = {}
        every = np.ones(self.num_envs, dtype=bool)
        for name, mask, place, several in self._info_places:
            infos[name] = values[:, place] if several else values[:, place.start]
            infos[mask] = every
        return infos

    def _seeds(self, seed: Any) -> list[int | None]:
        count = self.num_envs
        if is_whole(seed):
            return [int(seed) + i for i in range(count)]
        several = [None] * count if seed is None else list(seed) if isinstance(seed, (Sequence, np.ndarray)) else []
        if len(several) != count or not all(each is None or is_whole(each) for each in several):
            raise refused("seed", seed, f"a whole number from 0, or a sequence of {count} of them, or None")
        return [None if each is None else int(each) for each in several]

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_:
            raise InputError(f"reset_mask of shape {array.shape} and type {array.dtype}: allowed is ({self.num_envs},) of bool")
        return array

    def snapshot(self) -> Snapshot:
        """Return the complete state, for `restore` of this environment or of another made with the same arguments."""
        states = tuple(generator.bit_generator.state for generator in self._generators)
        over = None if self._over is None else self._over.copy()
        return Snapshot(self._batch.p, self._batch.x, self._inputs.copy(), over, states, self._elapsed.copy())

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot.  Raises `InputError` for a snapshot of a different environment."""
        check_type("snapshot", snapshot, Snapshot, "a Snapshot that snapshot() returned")
        shape = (self.num_envs, self.setup.task.model.state.size)
        if snapshot.inputs.shape != self._inputs.shape or snapshot.state.shape != shape:
            raise InputError(f"snapshot of states {snapshot.state.shape}: this environment has {shape}")
        self.check_constants(snapshot.parameters)
        self._batch.set_parameters(np.arange(self.num_envs), snapshot.parameters)
        self._batch.x = snapshot.state
        self._inputs[:] = snapshot.inputs
        self._elapsed[:] = snapshot.elapsed
        self._over = None if snapshot.over is None else snapshot.over.copy()
        self._generators, self._generator_seeds = [seeding.np_random(0)[0] for _ in snapshot.generators], [-1] * self.num_envs
        for generator, state in zip(self._generators, snapshot.generators, strict=True):
            generator.bit_generator.state = state
