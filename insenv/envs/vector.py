"""The vector face of an environment: a `gymnasium.vector.VectorEnv` on one batch of its task.

Row i is the single environment reset with seed + i, to the bit, through all its episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from insenv.core.batch import Batch, make_batch
from insenv.core.tables import Table
from insenv.envs.setup import Setup, checked_action
from insenv.envs.single import Remade, Snapshot
from insenv.errors import InputError

Array = NDArray[np.float64]
Infos = dict[str, Any]

FACE = ("autoreset_mode", "threads", "backend", "render_mode", "max_episode_steps")
"""Arguments of the vector face itself."""


class InertialVectorEnv(Remade, VectorEnv[Array, Array, Any]):
    """Many environments of a task at once.

    autoreset_mode: NEXT_STEP (an ended row starts afresh on the next step, whose action for it is ignored, with reward 0) or
    DISABLED (``reset(options={"reset_mask": mask})`` starts the rows of the mask afresh).  threads: over the rows.
    max_episode_steps: truncates as the wrapper TimeLimit does.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self, setup: Setup, num_envs: int, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, threads: int = 1,
        backend: str | None = None, render_mode: str | None = None, max_episode_steps: int | None = None,
    ) -> None:  # fmt: skip
        if render_mode is not None:
            raise InputError(f"render_mode = {render_mode!r}: many environments at once are not drawn; make a single one")
        allowed = (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)
        mode = next((m for m in AutoresetMode if autoreset_mode in (m, m.value, m.name)), None)
        if mode not in allowed:
            raise InputError(f"autoreset_mode = {autoreset_mode!r}: allowed are {', '.join(str(m) for m in allowed)}")
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise InputError(f"num_envs = {num_envs!r}: allowed is a whole number from 1")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise InputError(f"max_episode_steps = {max_episode_steps}: allowed is a whole number from 1")
        self.setup, self.num_envs = setup, int(num_envs)
        self._most = np.inf if max_episode_steps is None else max_episode_steps
        self._elapsed = np.zeros(self.num_envs)
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        self.single_action_space, self.single_observation_space = setup.spaces()
        self.action_space, self.observation_space = (
            batch_space(space, self.num_envs) for space in (self.single_action_space, self.single_observation_space)
        )
        task = setup.task
        base = np.tile(setup.task.model.parameters.start_vector(), (self.num_envs, 1))
        self._batch: Batch = make_batch(task.model, self.num_envs, base, threads=threads, backend=backend)
        size = task.watched.size * setup.samples
        outputs = task.model.outputs
        places = {name: slice(s.start + size, s.stop + size) for name in outputs.names for s in [outputs.slice(name)]}
        self._places = places
        self._observed = places["reward"].start
        self._inputs = np.tile(task.model.inputs.start_vector(), (self.num_envs, 1))
        self._over: NDArray[np.bool_] | None = None
        self._generators: list[np.random.Generator] = []

    @property
    def layout(self) -> Table:
        """Rows of an observation of one environment."""
        return self.setup.layout

    def named(self, observations: Array) -> dict[str, Any]:
        """Observations by name of their rows (views), the environments along the first axis."""
        return self.layout.unpack(observations)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Infos]:
        """Start all rows, or those of ``options["reset_mask"]``.  Row i takes seed + i, or the i-th of several."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        rows = np.arange(self.num_envs) if mask is None else np.flatnonzero(self._mask(mask))
        chosen: list[int] = rows.tolist()
        if mask is not None and self._over is None:
            raise ResetNeeded("reset() with a reset_mask before the first reset() of all rows")
        seeds: Sequence[int | None] = [seed + i for i in range(self.num_envs)] if isinstance(seed, (int, np.integer)) else (
            seed if seed is not None else [None] * self.num_envs
        )  # fmt: skip
        if len(seeds) != self.num_envs:
            raise InputError(f"seed of {len(seeds)} numbers: allowed are one, or {self.num_envs}")
        if not self._generators:
            self._generators = [seeding.np_random(s)[0] for s in seeds]
        else:
            for i in chosen:
                if seeds[i] is not None:
                    self._generators[i] = seeding.np_random(seeds[i])[0]
        if self._over is None:
            self._over = np.zeros(self.num_envs, dtype=bool)
        self._start(rows, options or None)
        shown = np.zeros((self.num_envs, max(place.stop for place in self._places.values())))
        shown[:, self._observed_outputs] = self._batch.output()
        return shown[:, : self._observed], self._told(shown)

    @property
    def _observed_outputs(self) -> slice:
        return slice(self.setup.task.watched.size * self.setup.samples, None)

    def step(self, actions: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], Infos]:
        """Judge every row's action, then go on to the next; ended rows as the autoreset mode says."""
        if self._over is None:
            raise ResetNeeded("step() before reset(): call reset() first")
        self._inputs[:, self.setup.task.place] = checked_action(actions, self.action_space.shape)  # type: ignore[arg-type]
        over = np.flatnonzero(self._over)
        if len(over) and self.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            raise ResetNeeded(f'rows {over[:8].tolist()} have ended: reset(options={{"reset_mask": mask}}) starts them afresh')
        task = self.setup.task
        shown = self._batch.cycle(task.judge, task.watched.names, self.setup.samples, self._inputs)
        if len(over):
            self._start(over, None)
            shown[over] = 0.0
            shown[over, self._observed_outputs] = self._batch.output()[over]
            score = slice(self._places["reward"].start, self._places["truncated"].stop)
            shown[over, score] = 0.0  # nothing has been done yet
        reward, terminated, truncated = (shown[:, self._places[name].start] for name in ("reward", "terminated", "truncated"))
        self._elapsed += 1
        self._elapsed[over] = 0
        # what the wrapper TimeLimit does to a single environment
        terminated, truncated = terminated != 0.0, (truncated != 0.0) | (self._elapsed >= self._most)
        self._over = terminated | truncated
        return shown[:, : self._observed], reward.copy(), terminated, truncated, self._told(shown)

    def _start(self, rows: NDArray[np.intp], options: dict[str, Any] | None) -> None:
        if not len(rows):
            return
        starts = self.setup.starts
        p = starts.draw([self._generators[i] for i in rows], options)
        states = self._batch.start_rows(rows, p)
        told = starts.tell(p, states, options)
        if self.setup.task.starts_as_told:
            self._batch.start_rows(rows, told)
        else:
            self._batch.set_parameters(rows, told)
        assert self._over is not None
        self._over[rows] = False
        self._elapsed[rows] = 0

    def _told(self, shown: Array) -> Infos:
        infos: Infos = {}
        every = np.ones(self.num_envs, dtype=bool)
        for row in self.setup.task.info:
            place = self._places[row.name]
            infos[row.name] = shown[:, place] if row.shape else shown[:, place.start]
            infos[f"_{row.name}"] = every
        return infos

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        array = np.asarray(mask)
        if array.shape != (self.num_envs,) or array.dtype != np.bool_:
            raise InputError(f"reset_mask of shape {array.shape} and type {array.dtype}: allowed is ({self.num_envs},) of bool")
        return array

    def snapshot(self) -> Snapshot:
        """The complete state, for `restore` of this or another environment made with the same arguments."""
        states = tuple(generator.bit_generator.state for generator in self._generators)
        over = None if self._over is None else self._over.copy()
        return Snapshot(self._batch.p, self._batch.x, self._inputs.copy(), over, states, self._elapsed.copy())

    def restore(self, snapshot: Snapshot) -> None:
        """Go back (or over) to a snapshot.  Raises `InputError` for one of another environment."""
        if snapshot.inputs.shape != self._inputs.shape or snapshot.state.shape != (
            self.num_envs,
            self.setup.task.model.state.size,
        ):
            raise InputError(
                f"snapshot of states {snapshot.state.shape}: this environment has "
                f"{(self.num_envs, self.setup.task.model.state.size)}"
            )
        self._batch.set_parameters(np.arange(self.num_envs), snapshot.parameters)
        self._batch.x = snapshot.state
        self._inputs[:] = snapshot.inputs
        self._elapsed[:] = snapshot.elapsed
        self._over = None if snapshot.over is None else snapshot.over.copy()
        self._generators = [seeding.np_random(0)[0] for _ in snapshot.generators]
        for generator, state in zip(self._generators, snapshot.generators, strict=True):
            generator.bit_generator.state = state
