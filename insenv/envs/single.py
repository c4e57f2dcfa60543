"""The single interface of an environment: a `gymnasium.Env` on one runner of its task."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.runner import make_runner
from insenv.envs.checks import check_choice, check_type
from insenv.envs.interface import Interface, Snapshot, places_of
from insenv.envs.rendering import draw, write
from insenv.envs.setup import Setup, checked_action

Array = NDArray[np.float64]


class InertialEnv(Interface, gymnasium.Env[Array, Array]):
    """One environment of a task; its subclasses define the task.

    `step` runs the judge on the action and then the inertial samples until the next decision.  Observation and info are
    views of one fresh array: returned values never change later.
    """

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}

    def __init__(self, setup: Setup, *, backend: str | None = None, render_mode: str | None = None) -> None:
        if render_mode is not None:
            check_choice("render_mode", render_mode, ("rgb_array", "ansi"))
        self.setup, self.render_mode = setup, render_mode
        self.action_space: Any
        self.observation_space: Any
        self.action_space, self.observation_space = setup.spaces()
        task = setup.task
        self._runner = make_runner(task.model, None, backend)
        self._call, self._buffer = self._runner.cycle(task.judge, task.watched.names, setup.samples)
        places = places_of(setup)
        self._observed = places["reward"].start
        self._reward, self._terminated, self._truncated = (places[name].start for name in ("reward", "terminated", "truncated"))
        self._names = task.info.names
        self._info_places = [places[row.name] if row.shape else places[row.name].start for row in task.info]
        self._action = self._runner._u[task.place]
        self._shape = (task.actions.size,)
        self._over: bool | None = None
        self.history: list[tuple[Array, dict[str, Any]]] | None = None if render_mode is None else []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; `options` (see the class) replace the arguments for this episode."""
        super().reset(seed=seed)
        starts, runner = self.setup.starts, self._runner
        p = starts.draw([self.np_random], options)
        runner.p[:] = p[0]
        runner.start()
        runner.p[:] = starts.complete(p, runner.x[None], options)[0]
        runner.start()  # a filter inside starts from what is known
        runner._u[:] = self.setup.task.model.inputs.start_vector()
        self._over = False
        self._buffer[:] = 0.0
        self._buffer[self.setup.task.watched.size * self.setup.samples :] = runner.output()
        shown = self._buffer.copy()
        observation, info = self.setup.seen(shown[: self._observed]), self._info(shown)
        if self.history is not None:
            self.history[:] = [(observation, info)]
        return observation, info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Judge the action, then advance to the next decision.

        An action outside the space is clipped (a quaternion is normalized), and one that is not finite ends the episode
        with the lowest reward.  Raises `InputError` for an action of another shape, `ResetNeeded` outside an episode.
        """
        if self._over is not False:
            raise ResetNeeded(_NOT_STARTED if self._over is None else _OVER)
        self._action[:] = checked_action(action, self._shape)
        self._call()
        shown = self._buffer.copy()
        terminated, truncated = shown.item(self._terminated) != 0.0, shown.item(self._truncated) != 0.0
        self._over = terminated or truncated
        observation, info = self.setup.seen(shown[: self._observed]), self._info(shown)
        if self.history is not None:
            self.history.append((observation, info))
        return observation, shown.item(self._reward), terminated, truncated, info

    def _info(self, shown: Array) -> dict[str, Any]:
        return dict(zip(self._names, map(shown.__getitem__, self._info_places), strict=True))

    def snapshot(self) -> Snapshot:
        """Return the complete state, for `restore` of this environment or of another made with the same arguments."""
        runner = self._runner
        state = self.np_random.bit_generator.state
        history = tuple(self.history or ())
        return Snapshot(runner.p.copy(), runner.x.copy(), runner._u.copy(), self._over, (state,), history=history)

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a snapshot.  Raises `InputError` for a snapshot of a different environment.

        A rendered environment takes the history of the episode, if that of the snapshot was rendered too.
        """
        check_type("snapshot", snapshot, Snapshot, "a Snapshot that snapshot() returned")
        runner = self._runner
        if snapshot.parameters.shape != runner.p.shape or snapshot.state.shape != runner.x.shape:
            raise InputError(
                f"snapshot of {snapshot.parameters.shape} parameters and {snapshot.state.shape} states: this environment has "
                f"{runner.p.shape} and {runner.x.shape}"
            )
        runner.p[:], runner.x[:], runner._u[:] = snapshot.parameters, snapshot.state, snapshot.inputs
        self._over = snapshot.over
        if self.history is not None:
            self.history[:] = snapshot.history
        self.np_random.bit_generator.state = snapshot.generators[0]

    def render(self) -> Any:
        """Return the episode so far as an image (height, width, 3) uint8, or as text, depending on `render_mode`."""
        if self.render_mode is None:
            raise InputError('render() needs an environment made with render_mode="rgb_array" or "ansi"')
        if self._over is None:
            raise ResetNeeded("render() before reset(): call reset() first")
        if not self.history:
            raise ResetNeeded("render() after restore() of a snapshot that was not rendered: call step() or reset() first")
        return (draw if self.render_mode == "rgb_array" else write)(self.setup, self.history)


_NOT_STARTED = "step() before reset(): call reset() first"
_OVER = "step() after the end of the episode: call reset() first"
