"""The arguments of an environment, declared once for its single and its vector interface, and the setup that they define."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from insenv.base.errors import InputError, nearest
from insenv.core.tables import Array, Table
from insenv.envs.checks import check_choice, check_type, check_whole, is_number, refused
from insenv.envs.starts import Ranges, Starts, Variation
from insenv.envs.task import Task
from insenv.scenario import Scenario, ScenarioLike, load
from insenv.scenario.inputs import DRIVEN
from insenv.scenario.poles import check_reach
from insenv.vehicles import registry
from insenv.vehicles.section import MAX_DURATION_S

FLOAT64 = np.dtype(np.float64)
RewardOf = Callable[[Mapping[str, Any]], float]


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that defines an environment.

    samples: inertial samples per decision.  decisions: decisions per episode.  interval: time between inertial samples,
    s.  constants: parameter rows of the task that are the same in all episodes.  dtype: of observations and actions; the model
    computes with float64.  reward: of a step by its info, instead of the task's.
    """

    scenario: Scenario
    task: Task
    starts: Starts
    samples: int
    decisions: int
    interval: float
    constants: Mapping[str, float]
    dtype: np.dtype[Any] = FLOAT64
    reward: RewardOf | None = None

    @property
    def layout(self) -> Table:
        """Rows of an observation."""
        return self.task.layout(self.samples)

    def spaces(self) -> tuple[spaces.Box, spaces.Box]:
        """Return the action space and the observation space of one environment."""
        low, high = self.task.bounds(self.samples)
        size = self.task.actions.size
        kind: Any = self.dtype.type
        return spaces.Box(-1.0, 1.0, (size,), kind), spaces.Box(low.astype(kind), high.astype(kind), dtype=kind)

    def seen(self, observation: Array) -> Any:
        """Return observations, slices of a fresh float64 array, in `dtype`."""
        return observation if self.dtype == np.float64 else observation.astype(self.dtype)

    def paid(self, info: Mapping[str, Any]) -> float:
        """Return what `reward` makes of the info of a step.  Raises `InputError` unless it is a finite number."""
        assert self.reward is not None
        value = self.reward(info)
        if isinstance(value, np.ndarray) and value.shape == ():
            value = value.item()
        if not is_number(value) or not isfinite(value):
            raise refused("reward(info)", value, "a finite number")
        return float(value)

    @property
    def step_s(self) -> float:
        """Time between two observations, s."""
        return self.samples * self.interval


@dataclass(kw_only=True, repr=False, eq=False)
class Arguments(Variation):
    """The arguments of an environment: those of every environment here, its own in a subclass for each kind of task.

    A subclass says what its task is (`_task`: actions, observation, reward), which parameters of it are constant
    (`_constants`), and how an episode starts (`_starts`).  `AlignmentEnv` describes the arguments.

    needs_vehicle_in_place, needs_gnss: what the scenario must have.  rewards: the names that `reward` takes.  drawn: names of
    the arguments, besides those of `Variation`, that say what an episode draws.
    """

    needs_vehicle_in_place: ClassVar[bool] = False
    needs_gnss: ClassVar[bool] = False
    rewards: ClassVar[tuple[str, ...]] = ("final", "dense")
    drawn: ClassVar[tuple[str, ...]] = ()

    scenario: ScenarioLike = field(default="", kw_only=False)
    vehicle: str = ""
    samples_per_step: int = 100
    duration_s: float | None = None
    dtype: str = "float64"
    reward: str | RewardOf = "final"

    def set_up(self) -> Setup:
        """Return the setup that the arguments define.  Raises `InputError` for an argument that is not allowed."""
        scenario = self._scenario()
        ranges = self._ranges(scenario)
        samples = check_whole("samples_per_step", self.samples_per_step)
        check_choice("dtype", self.dtype, ("float64", "float32"))
        reward = self._function()
        constants, task = self._constants(scenario), self._task(scenario)
        duration = scenario.duration_s if self.duration_s is None else self.duration_s
        step = samples / scenario.rate_hz
        decisions = int(duration / step * (1.0 + 1e-12)) if is_number(duration) and 0.0 < duration <= MAX_DURATION_S else 0
        if decisions < 1:
            raise refused("duration_s", duration, f"a number from one step, {step:g} s, to {MAX_DURATION_S:g} s", "s")
        check_reach(scenario, task.model, decisions * step)
        constants = {"decision_limit": float(decisions), "dense": float(reward is None and self.reward != "final"), **constants}
        starts = self._starts(scenario, task, ranges, constants, decisions * step)
        interval, dtype = 1.0 / scenario.rate_hz, np.dtype(self.dtype)
        return Setup(scenario, task, starts, samples, decisions, interval, constants, dtype, reward)

    def _function(self) -> RewardOf | None:
        """Return the function that `reward` is; None for a name."""
        if callable(self.reward) and _takes_one(self.reward):
            return self.reward
        if isinstance(self.reward, str) and self.reward in self.rewards:
            return None
        names = ", ".join(map(repr, self.rewards))
        raise refused("reward", self.reward, f"{names} or a function of the info that returns a number")

    def _scenario(self) -> Scenario:
        """Return the scenario; a track stands for each kind of vehicle."""
        check_type("vehicle", self.vehicle, str, "a kind of vehicle or ''")
        if self.vehicle not in ("", *registry.names()):
            raise InputError(f"vehicle = {self.vehicle!r}: no such kind{nearest(self.vehicle, registry.names())}")
        scenario = load(self.scenario)
        name, kind = scenario.name or scenario.title, scenario.vehicle.kind
        if self.vehicle and kind != self.vehicle and scenario.vehicle.lasts_s is None:
            raise InputError(f"scenario {name!r} has a vehicle of kind {kind!r}: this environment is for {self.vehicle!r}")
        if scenario.commands:
            raise InputError(f"scenario {scenario.name!r} {DRIVEN}")
        if self.needs_vehicle_in_place and not scenario.vehicle.in_place:
            raise InputError(f"{type(self).__name__} needs a vehicle in place: that of scenario {name!r} moves")
        if self.needs_gnss and scenario.gnss is None:
            raise InputError(f"{type(self).__name__} needs GNSS fixes: scenario {name!r} has no [gnss]")
        return scenario

    def _ranges(self, scenario: Scenario) -> Ranges:
        """Return what varies between episodes."""
        return Ranges.of(self)

    def _task(self, scenario: Scenario) -> Task:
        """Return the task in a scenario."""
        raise NotImplementedError

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        """Return the parameter rows of the task that are the same in all episodes."""
        return {}

    def _starts(
        self, scenario: Scenario, task: Task, ranges: Ranges, constants: Mapping[str, float], duration: float
    ) -> Starts:
        """Return what draws the start of an episode."""
        return Starts(scenario, task, ranges, constants, duration)


def _takes_one(function: Callable[..., Any]) -> bool:
    """Return whether a function can be called with one argument; one that tells no signature, as if it could."""
    try:
        signature(function).bind(None)
    except TypeError:
        return False
    except ValueError:
        pass
    return True


_NOT_REAL = "cSUMm"
"""Kinds of arrays that NumPy turns into numbers, of complex ones with only a warning."""


def checked_action(action: Any, shape: tuple[int, ...]) -> Array:
    """Return the action as float64; the task judges what is not finite.  Raises `InputError` for a wrong shape."""
    if type(action) is np.ndarray and action.dtype is FLOAT64 and action.shape == shape:
        return action
    try:
        if np.asarray(action).dtype.kind in _NOT_REAL:
            raise TypeError
        array = np.asarray(action, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise refused("action", action, f"an array of shape {shape} of real numbers") from None
    if array.shape != shape:
        raise InputError(f"action of shape {array.shape}: allowed is {shape}")
    return array
