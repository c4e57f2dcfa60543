"""The single interface of an environment: a `gymnasium.Env` on one runner of its task."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from insenv.base.errors import InputError, nearest
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Table
from insenv.envs.checks import as_numbers, check_choice, check_keywords, check_type, refused
from insenv.envs.rendering import Drawing, Seen, write
from insenv.envs.setup import RewardOf, Setup, checked_action
from insenv.envs.starts import RANGES
from insenv.envs.task import DECISIONS

Made = TypeVar("Made", bound="Interface")


@dataclass(frozen=True)
class Snapshot:
    """The complete state of an environment; an environment restored from it continues bit-identically.

    parameters, state, inputs: vectors of the model, (rows, elements) for a vector environment.  over: whether the
    episode has ended, None before the first reset.  generators: states of the random generators.  elapsed: steps made
    in the episode (vector environments).  history: of the episode so far, if it is rendered.
    """

    parameters: Array
    state: Array
    inputs: Array
    over: Any
    generators: tuple[Mapping[str, Any], ...]
    elapsed: Any = 0
    history: tuple[Seen, ...] = ()


class Interface:
    """Base of `InertialEnv` and `InertialVectorEnv`; pickled and copied as constructor arguments plus snapshot.

    An environment is a dataclass of one of them and of a subclass of `Arguments`: its fields are its constructor's arguments.
    """

    setup: Setup
    reward: str | RewardOf
    drawn: ClassVar[tuple[str, ...]]
    _made_with: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls: type[Made], *args: Any, **kwargs: Any) -> Made:
        # the __init__ of a dataclass refuses an unknown argument; here the message can name the nearest one
        check_keywords(cls.__name__, cls.__init__, kwargs)
        made = super().__new__(cls)
        made._made_with = (args, kwargs)
        return made

    def set_up(self) -> Setup:
        """Return the setup that the arguments define."""
        raise NotImplementedError

    def check_constants(self, parameters: Array) -> None:
        """Raise `InputError` for parameters (..., k) of an environment that was made with other arguments."""
        rows = self.setup.task.model.parameters.unpack(parameters, self.setup.constants)
        for name, value in self.setup.constants.items():
            others = np.ravel(rows[name])
            if np.any(others != value):
                raise InputError(f"snapshot of an environment with {name} = {others[0]:g}: this one has {value:g}")

    def __reduce__(self) -> Any:
        return _remade, (type(self), *self._made_with, self.snapshot())

    @property
    def spec(self) -> Any:
        """Gymnasium's specification; `max_episode_steps` is that of the environment's own time."""
        return getattr(self, "_spec", None)

    @spec.setter
    def spec(self, value: Any) -> None:
        self._spec = copy(value)
        if value is not None and value.max_episode_steps is None:
            self._spec.max_episode_steps = self.setup.decisions

    @property
    def layout(self) -> Table:
        """Rows of the observation of one environment, with units, frames and meanings."""
        return self.setup.layout

    def named(self, observation: Array) -> dict[str, Any]:
        """Return an observation by row name (views): ``imu`` (samples, 7), ``time``, ``fix_position`` ...

        A vector environment's rows have the environments along the first axis.  Raises `InputError` for anything else.
        """
        if as_numbers(observation) is None:
            raise refused("observation", observation, f"an array of {self.layout.size} numbers, or one of each environment")
        return self.layout.unpack(observation)

    def set_ranges(self, **ranges: Any) -> None:
        """Change arguments that say what varies, for all episodes that start from now on, those of an autoreset included.

        Raises `InputError` for another argument, or for a value that is not allowed; nothing is changed then.
        """
        allowed = [name for name in (*RANGES, *self.drawn) if hasattr(self, name)]
        for name in ranges:
            if name not in allowed:
                raise InputError(f"set_ranges: {name!r} is not an argument that can vary{nearest(name, allowed)}")
        before = {name: getattr(self, name) for name in ranges}
        vars(self).update(ranges)
        try:
            self.setup = replace(self.setup, starts=self.set_up().starts)
        except Exception:
            vars(self).update(before)
            raise
        positional, keywords = self._made_with
        self._made_with = positional, {**keywords, **ranges}

    def snapshot(self) -> Snapshot:
        """Return the complete state."""
        raise NotImplementedError


def _remade(kind: Any, args: tuple[Any, ...], kwargs: dict[str, Any], snapshot: Snapshot) -> Any:
    env = kind(*args, **kwargs)
    env.restore(snapshot)
    return env


def places_of(setup: Setup) -> dict[str, slice]:
    """Return the place of each output of the task behind the watched samples, by row name."""
    outputs, before = setup.task.model.outputs, setup.task.watched.size * setup.samples
    return {name: slice(s.start + before, s.stop + before) for name in outputs.names for s in [outputs.slice(name)]}


@dataclass(kw_only=True, repr=False, eq=False)
class InertialEnv(Interface, gymnasium.Env[Array, Array]):
    """One environment of a task; its subclasses define the task.

    `step` runs the judge on the action and then the inertial samples until the next decision.  Observation and info are
    views of one fresh array: returned values never change later.
    """

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}

    backend: str | None = None
    render_mode: str | None = None

    def __post_init__(self) -> None:
        self.setup = setup = self.set_up()
        if self.render_mode is not None:
            check_choice("render_mode", self.render_mode, ("rgb_array", "ansi"))
        self.action_space: Any
        self.observation_space: Any
        self.action_space, self.observation_space = setup.spaces()
        task = setup.task
        self._runner = make_runner(task.model, None, self.backend)
        self._call, self._buffer = self._runner.cycle(task.judge, task.watched.names, setup.samples)
        places = places_of(setup)
        self._observed = places["reward"].start
        self._reward, self._terminated, self._truncated = (places[name].start for name in ("reward", "terminated", "truncated"))
        self._names = task.info.names
        self._info_places = [places[row.name] if row.shape else places[row.name].start for row in task.info]
        self._action = self._runner._u[task.place]
        self._shape = (task.actions.size,)
        self._over: bool | None = None
        self.history: list[Seen] | None = None if self.render_mode is None else []
        self._decisions = task.model.state.slice(DECISIONS.name).start
        self._drawing: Drawing | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode; `options` (see the class) replace the arguments for this episode."""
        super().reset(seed=seed)
        starts, runner = self.setup.starts.with_options(options), self._runner
        p = starts.draw([self.np_random])
        runner.p[:] = p[0]
        runner.start()
        runner.p[:] = starts.complete(p, runner.x[None])[0]
        runner.start()  # a filter inside starts from what is known
        runner._u[:] = self.setup.task.model.inputs.start_vector()
        self._over = False
        self._buffer[:] = 0.0
        self._buffer[self.setup.task.watched.size * self.setup.samples :] = runner.output()
        values = self._buffer.copy()
        observation, info = self.setup.seen(values[: self._observed]), self._info(values)
        if self.history is not None:
            self.history[:] = [Seen(0.0, observation, info)]
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
        values = self._buffer.copy()
        terminated, truncated = values.item(self._terminated) != 0.0, values.item(self._truncated) != 0.0
        self._over = terminated or truncated
        observation, info = self.setup.seen(values[: self._observed]), self._info(values)
        if self.history is not None:
            self.history.append(Seen(self._runner.x.item(self._decisions) * self.setup.step_s, observation, info))
        reward = values.item(self._reward) if self.setup.reward is None else self.setup.paid(info)
        return observation, reward, terminated, truncated, info

    def _info(self, values: Array) -> dict[str, Any]:
        return dict(zip(self._names, map(values.__getitem__, self._info_places), strict=True))

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
        self.check_constants(snapshot.parameters)
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
        if self.render_mode == "ansi":
            return write(self.setup, self.history)
        if self._drawing is None:
            self._drawing = Drawing(self.setup, self.history[0].info)
        return self._drawing.image(self.history)


_NOT_STARTED = "step() before reset(): call reset() first"
_OVER = "step() after the end of the episode: call reset() first"
