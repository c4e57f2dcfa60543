"""Tasks: a model that is a whole environment, and how its rows make an action, an observation and an info."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.core.compose import as_part, merge
from insenv.core.model import Model
from insenv.core.tables import Row, Table
from insenv.envs.knowledge import TOLD
from insenv.envs.referee import FIX, POSITION_RANGE, VELOCITY_RANGE, Referee, fix_part, true_position
from insenv.errors import InputError
from insenv.vehicles import TRUTH_STATE

Array = NDArray[np.float64]

WINDOW = Table((
    Row("delta_angle", "Gyro increment", "rad", (3,), "b", lower=-10.0, upper=10.0),
    Row("delta_velocity", "Accelerometer increment", "m/s", (3,), "b", lower=-1e4, upper=1e4),
    Row("imu_valid", "0 if the sample was lost", lower=0.0, upper=1.0),
))  # fmt: skip
"""What of each inertial sample stands in an observation."""

CLOCK = Row("time", "Time since the start", "s", lower=0.0, upper=1e6)
FIX_AGE = Row("fix_age", "Time since the epoch of the latest fix", "s", lower=0.0, upper=1e6)
REWARD = ("reward", "terminated", "truncated")


@dataclass(frozen=True, eq=False)
class Task:
    """An environment as a model.

    model: its outputs are the rows of `observation`, then reward, terminated, truncated, then the rows of `info`.
    actions: rows of its inputs that an action is, each element in [-1, 1].  watched: state rows that an observation has for
    every sample, with their bounds.  judge: the step that takes the action, run before the samples of a step.
    starts_as_told: whether the start state depends on what is told (an estimator is inside).
    """

    model: Model
    actions: Table
    watched: Table
    observation: Table
    info: Table
    judge: str = "judge"
    starts_as_told: bool = False

    @property
    def place(self) -> slice:
        """Where the action stands among the model's inputs (a plant has inputs of its own)."""
        first = self.model.inputs.slice(self.actions.names[0]).start
        return slice(first, first + self.actions.size)

    def layout(self, samples: int) -> Table:
        """The rows of an observation over `samples` inertial samples: ``imu`` (samples, 7) and those of `observation`."""
        if not self.watched.rows:
            return self.observation
        meaning = "; ".join(f"{row.meaning.lower()} ({row.unit})" for row in self.watched)
        imu = Row("imu", f"Inertial samples since the last step, a row each: {meaning}", "1", (samples, self.watched.size), "b")
        return Table((imu,)) + self.observation

    def bounds(self, samples: int) -> tuple[Array, Array]:
        """Lower and upper bounds of an observation, flat."""
        return (
            np.concatenate([np.tile(_bound(self.watched, b), samples), _bound(self.observation, b)]) for b in ("lower", "upper")
        )  # type: ignore[return-value]


def _bound(table: Table, which: str) -> Array:
    return np.concatenate([np.full(row.size, getattr(row, which)) for row in table] or [np.zeros(0)])


@lru_cache(maxsize=64)
def estimation_task(plant: Model, navigates: bool) -> Task:
    """The task of estimating the attitude of a plant, or all of its navigation state.

    Raises `InputError` for navigation without a GNSS receiver.
    """
    has_gnss = "gnss_valid" in plant.state
    if navigates and not has_gnss:
        raise InputError("a navigation environment needs GNSS fixes: the scenario has no [gnss]")
    referee = Referee(navigates)
    fix = Table((FIX["fix_new"], FIX_AGE)) + Table(FIX.rows[3:]) if has_gnss else Table()
    observation = Table((CLOCK,)) + fix + TOLD
    truth = Table(tuple(TRUTH_STATE[name] for name in ("q_nb", "velocity_n")))
    position = Row("position", "True position of the inertial unit from the reference", "m", (3,), "n")
    score = tuple(Row(name, name) for name in REWARD)
    flags = tuple(Row(name, name) for name in ("declared", "diverged"))
    info = truth + Table((position, referee.error, referee.limit, *flags))

    def output(p: Any, x: Any) -> dict[str, Any]:
        rows = {name: getattr(p, name) for name in (*TOLD.names, "limit")}
        rows |= {name: getattr(x, name) for name in ("time", *truth.names, "error", *REWARD, "declared", "diverged")}
        if has_gnss:
            rows |= {name: getattr(x, name) for name in fix.names if name != "fix_age"}
            rows["fix_age"] = (x.time - x.fix_time) + x.fix_delay
        return rows | {"position": true_position(p, x)}

    what = "navigation" if navigates else "alignment"
    parts = [as_part(plant), *([fix_part()] if has_gnss else []), referee.part()]
    outputs = observation + Table(score) + info
    model = merge(f"{plant.id}-{what}", f"{plant.title}: {what}", parts, outputs, output)
    return Task(model, referee.actions, WINDOW, observation, info)


def estimate_action(
    task: Task, q_nb: Array, declare: Array | float = -1.0, velocity_n: Array | None = None, position: Array | None = None
) -> Array:
    """The action that states an estimate: of one environment, or (with a first axis of rows) of many.

    q_nb (..., 4); declare: above 0 ends an alignment; velocity_n (..., 3) m/s and position (..., 3) m from the reference, in n,
    for navigation tasks.
    """
    action = np.empty((*np.shape(q_nb)[:-1], task.actions.size))
    values: Mapping[str, Any] = {"estimate_q_nb": q_nb, "declare": declare}
    if velocity_n is not None and position is not None:
        values = {**values, "estimate_velocity": velocity_n / VELOCITY_RANGE, "estimate_position": position / POSITION_RANGE}
    for row in task.actions:
        if row.name not in values:
            raise InputError(f"an action of this task has {row.name!r} ({row.meaning}): it was not given")
        value = np.asarray(values[row.name])
        action[..., task.actions.slice(row.name)] = value if row.shape else value[..., None]
    return action
