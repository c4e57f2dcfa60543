"""The single face of an environment: a `gymnasium.Env` on one runner of its task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from insenv.core.runner import make_runner
from insenv.core.tables import Table
from insenv.envs.setup import Setup, checked_action
from insenv.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Snapshot:
    """The complete state of an environment: restored, it goes on to the bit.

    parameters, state, inputs: vectors of the model ((rows, elements) of a vector environment); over: whether the episode has
    ended; generators: states of the generators of episodes; elapsed: steps made in the episode, of a vector environment.
    """

    parameters: Array
    state: Array
    inputs: Array
    over: Any
    generators: tuple[Mapping[str, Any], ...]
    elapsed: Any = 0


class Remade:
    """Pickles and copies by the arguments that an environment was made with, and its snapshot."""

    _made_with: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *args: Any, **kwargs: Any) -> Any:
        made = super().__new__(cls)
        made._made_with = (args, kwargs)
        return made

    def __reduce__(self) -> Any:
        return _remade, (type(self), *self._made_with, self.snapshot())

    def snapshot(self) -> Snapshot:
        """The complete state."""
        raise NotImplementedError


def _remade(kind: Any, args: tuple[Any, ...], kwargs: dict[str, Any], snapshot: Snapshot) -> Any:
    env = kind(*args, **kwargs)
    env.restore(snapshot)
    return env


class InertialEnv(Remade, gymnasium.Env[Array, Array]):
    """One environment of a task; the classes made from it say which.

    `step` runs the judge on the action, then the inertial samples until the next.  Observation and info are views of one
    fresh array: nothing that is returned changes later.
    """

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}

    def __init__(self, setup: Setup, backend: str | None = None, render_mode: str | None = None) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError(f"render_mode = {render_mode!r}: allowed are None, {', '.join(self.metadata['render_modes'])}")
        self.setup, self.render_mode = setup, render_mode
        self.action_space: Any
        self.observation_space: Any
        self.action_space, self.observation_space = setup.spaces()
        task = setup.task
        self._runner = make_runner(task.model, None, backend)
        self._call, self._buffer = self._runner.cycle(task.judge, task.watched.names, setup.samples)
        outputs, before = task.model.outputs, len(self._buffer) - task.model.outputs.size
        places = {name: slice(s.start + before, s.stop + before) for name in outputs.names for s in [outputs.slice(name)]}
        self._observed = places["reward"].start
        self._reward, self._terminated, self._truncated = (places[name].start for name in ("reward", "terminated", "truncated"))
        self._names = task.info.names
        self._told_places = [places[row.name] if row.shape else places[row.name].start for row in task.info]
        self._action = self._runner._u[task.place]
        self._shape = (task.actions.size,)
        self._over: bool | None = None
        self.history: list[tuple[Array, dict[str, Any]]] | None = None if render_mode is None else []

    @property
    def layout(self) -> Table:
        """Rows of an observation, with units, frames and meanings."""
        return self.setup.layout

    def named(self, observation: Array) -> dict[str, Any]:
        """An observation by name of its rows (views): ``imu`` (samples, 7), ``time``, ``fix_position`` ..."""
        return self.layout.unpack(observation)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; `options` (see the class) stand in place of the arguments for this one."""
        super().reset(seed=seed)
        starts, runner = self.setup.starts, self._runner
        p = starts.draw([self.np_random], options)
        runner.p[:] = p[0]
        runner.start()
        runner.p[:] = starts.tell(p, runner.x[None], options)[0]
        if self.setup.task.starts_as_told:
            runner.start()
        runner._u[:] = self.setup.task.model.inputs.start_vector()
        self._over = False
        self._buffer[:] = 0.0
        self._buffer[len(self._buffer) - self.setup.task.model.outputs.size :] = runner.output()
        shown = self._buffer.copy()
        observation, info = shown[: self._observed], self._told(shown)
        if self.history is not None:
            self.history[:] = [(observation, info)]
        return observation, info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Judge the action, then go on to the next.  Raises `InputError` for an action of another shape or not finite."""
        if self._over is not False:
            raise ResetNeeded(_NOT_STARTED if self._over is None else _OVER)
        self._action[:] = checked_action(action, self._shape)
        self._call()
        shown = self._buffer.copy()
        terminated, truncated = shown.item(self._terminated) != 0.0, shown.item(self._truncated) != 0.0
        self._over = terminated or truncated
        observation, info = shown[: self._observed], self._told(shown)
        if self.history is not None:
            self.history.append((observation, info))
        return observation, shown.item(self._reward), terminated, truncated, info

    def _told(self, shown: Array) -> dict[str, Any]:
        return dict(zip(self._names, map(shown.__getitem__, self._told_places), strict=True))

    def snapshot(self) -> Snapshot:
        """The complete state, for `restore` of this or another environment made with the same arguments."""
        runner = self._runner
        state = self.np_random.bit_generator.state
        return Snapshot(runner.p.copy(), runner.x.copy(), runner._u.copy(), self._over, (state,))

    def restore(self, snapshot: Snapshot) -> None:
        """Go back (or over) to a snapshot.  Raises `InputError` for one of another environment."""
        runner = self._runner
        if snapshot.parameters.shape != runner.p.shape or snapshot.state.shape != runner.x.shape:
            raise InputError(
                f"snapshot of {snapshot.parameters.shape} parameters and {snapshot.state.shape} states: this environment has "
                f"{runner.p.shape} and {runner.x.shape}"
            )
        runner.p[:], runner.x[:], runner._u[:] = snapshot.parameters, snapshot.state, snapshot.inputs
        self._over = snapshot.over
        self.np_random.bit_generator.state = snapshot.generators[0]

    def render(self) -> Any:
        """The episode so far: an image (height, width, 3) uint8, or text."""
        if self.render_mode is None:
            raise InputError('render() needs an environment made with render_mode="rgb_array" or "ansi"')
        from insenv.envs.rendering import drawn, written

        return drawn(self) if self.render_mode == "rgb_array" else written(self)


_NOT_STARTED = "step() before reset(): call reset() first"
_OVER = "step() after the end of the episode: call reset() first"
