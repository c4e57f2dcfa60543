"""The task and the starts of an environment, made from its arguments; common to the single and the vector interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.tables import Table
from insenv.envs.checks import check_choice, check_type, check_whole, is_number, refused
from insenv.envs.starts import Ranges, Starts
from insenv.envs.task import HUGE_ACTION, Task
from insenv.scenario import Scenario, ScenarioLike, load
from insenv.scenario.commands import DRIVEN
from insenv.scenario.description import MAX_DURATION_S
from insenv.scenario.poles import check_reach

Array = NDArray[np.float64]
FLOAT64 = np.dtype(np.float64)


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that defines an environment.

    samples: inertial samples per decision.  decisions: decisions per episode.  interval: time between inertial samples,
    s.  dtype: of observations and actions; the model computes with float64.
    """

    scenario: Scenario
    task: Task
    starts: Starts
    samples: int
    decisions: int
    interval: float
    dtype: np.dtype[Any] = FLOAT64

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

    def time_of(self, observation: Any) -> float:
        """Return the time since the start of an observation, s."""
        seen = self.layout.unpack(observation)
        if "time" in seen:
            return float(seen["time"])
        return float(seen["time_share"]) * self.decisions * self.samples * self.interval


def chosen_scenario(scenario: ScenarioLike, vehicle: str) -> Scenario:
    """Return the scenario of a name, path, mapping or object.

    vehicle: required kind of vehicle ("ship", "car", "aircraft", "multirotor"; empty: any); a track
        stands for each kind.  Raises `InputError`.
    """
    check_type("vehicle", vehicle, str, "a kind of vehicle or ''")
    found = load(scenario)
    if vehicle and found.vehicle.kind != vehicle and found.vehicle.lasts_s is None:
        raise InputError(
            f"scenario {found.name or found.title!r} has a vehicle of kind {found.vehicle.kind!r}: this environment is for "
            f"{vehicle!r}"
        )
    if found.commands:
        raise InputError(f"scenario {found.name!r} {DRIVEN}")
    return found


def make_setup(
    scenario: Scenario, task: Task, ranges: Ranges, samples_per_step: int, duration_s: float | None,
    constants: Mapping[str, float], make_starts: Callable[..., Starts] = Starts, dtype: str = "float64",
) -> Setup:  # fmt: skip
    """Return the setup of a task in a scenario.

    duration_s: None: that of the scenario.  constants: parameter rows of the task common to all episodes.  make_starts:
    `Starts` or a function that takes its arguments.  Raises `InputError` for a duration shorter than one step or too
    long.
    """
    samples = check_whole("samples_per_step", samples_per_step)
    check_choice("dtype", dtype, ("float64", "float32"))
    duration = scenario.duration_s if duration_s is None else duration_s
    step = samples / scenario.rate_hz
    decisions = int(duration / step * (1.0 + 1e-12)) if is_number(duration) and 0.0 < duration <= MAX_DURATION_S else 0
    if decisions < 1:
        raise refused("duration_s", duration, f"a number from one step, {step:g} s, to {MAX_DURATION_S:g} s", "s")
    check_reach(scenario, task.model, decisions * step)
    starts = make_starts(scenario, task, ranges, {"decision_limit": float(decisions), **constants}, decisions * step)
    return Setup(scenario, task, starts, samples, decisions, 1.0 / scenario.rate_hz, np.dtype(dtype))


_NOT_REAL = "cSUMm"
"""Kinds of arrays that NumPy turns into numbers, of complex ones with only a warning."""


def checked_action(action: Any, shape: tuple[int, ...]) -> Array:
    """Return the action as float64, with a huge number in place of what is not finite, for the task to judge.

    Raises `InputError` for a wrong shape.
    """
    plain = type(action) is np.ndarray and action.dtype is FLOAT64 and action.shape == shape
    # a sum is fast for a short row, and not finite if an element is not
    if plain and (isfinite(sum(action.tolist())) if len(shape) == 1 else np.isfinite(action).all()):
        return action
    try:
        if np.asarray(action).dtype.kind in _NOT_REAL:
            raise TypeError
        array = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise refused("action", action, f"an array of shape {shape} of real numbers") from None
    if array.shape != shape:
        raise InputError(f"action of shape {array.shape}: allowed is {shape}")
    return np.nan_to_num(array, nan=HUGE_ACTION, posinf=HUGE_ACTION, neginf=-HUGE_ACTION)
