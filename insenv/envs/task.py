"""A task: a model that is a complete environment, and the rows that form its action, observation and info."""

from __future__ import annotations

from dataclasses import dataclass
from sys import float_info
from typing import Any

import casadi as ca
import numpy as np

from insenv import geodesy
from insenv.core.elementary import select
from insenv.core.model import Model, Values
from insenv.core.tables import Array, Row, Table
from insenv.vehicles import TRUTH_STATE

CLOCK = Row("time", "Time since the start", "s", lower=0.0, upper=1e6)
DECISION_LIMIT = Row("decision_limit", "Decisions in an episode", start=1.0, lower=1.0, upper=1e9)
"""Parameter row of every task.  A decision is one action of the agent, that is one call of an environment's `step`."""
DENSE = Row("dense", "1 if each step pays what it gains, 0 if the end pays for all steps", start=0.0, lower=0.0, upper=1.0)
"""Parameter row of every task."""
DECISIONS = Row("decisions", "Decisions so far")
INVALID = Row("invalid", "1 if the latest action was not finite", lower=0.0, upper=1.0)
NEVER = Row("never", "Always 0: steps conditioned on it run only when called by name")
RESULT = Table((
    Row("reward", "Reward of the latest action"),
    Row("terminated", "1 if the task is over", lower=0.0, upper=1.0),
    Row("truncated", "1 if the time is over", lower=0.0, upper=1.0),
))  # fmt: skip
TRUTH = Table((
    *(TRUTH_STATE[name] for name in ("q_nb", "velocity_n")),
    Row("position", "True position of the inertial unit from the reference", "m", (3,), "n"),
))  # fmt: skip
"""Rows of every info."""


@dataclass(frozen=True, eq=False)
class Task:
    """An environment as a model.

    model: its outputs are the rows of `observation`, then those of `RESULT`, then those of `info`.  actions: its input
    rows that form the action, each element in [-1, 1].  watched: state rows, with their bounds, that the observation
    contains for every inertial sample.  judge: the step that takes the action; it runs before the inertial samples.
    """

    model: Model
    actions: Table
    watched: Table
    observation: Table
    info: Table
    judge: str = "judge"

    @property
    def place(self) -> slice:
        """Place of the action among the model's inputs (a plant has inputs of its own)."""
        first = self.model.inputs.slice(self.actions.names[0]).start
        return slice(first, first + self.actions.size)

    def layout(self, samples: int) -> Table:
        """Rows of an observation: ``imu`` (samples, watched.size), one row per inertial sample, then `observation`."""
        if not self.watched.rows:
            return self.observation
        meaning = "; ".join(f"{row.meaning.lower()} ({row.unit})" for row in self.watched)
        imu = Row(
            "imu", f"Inertial samples since the last step, one per row: {meaning}", "1", (samples, self.watched.size), "b"
        )
        return Table((imu,)) + self.observation

    def bounds(self, samples: int) -> tuple[Array, Array]:
        """Lower and upper bounds of a flat observation over `samples` inertial samples."""
        return (
            np.concatenate([np.tile(_bound(self.watched, b), samples), _bound(self.observation, b)]) for b in ("lower", "upper")
        )  # type: ignore[return-value]


def _bound(table: Table, which: str) -> Array:
    return np.concatenate([np.full(row.size, getattr(row, which)) for row in table] or [np.zeros(0)])


def finite_action(action: Any) -> tuple[Any, Any]:
    """Return whether all elements of an action are finite, and the action with 0 in place of those that are not."""
    wrong = select(ca.fabs(action) <= float_info.max, 0.0, 1.0)  # 1 for a NaN too
    return ca.sumsqr(wrong) == 0.0, select(wrong, 0.0, action)


def truth(p: Values, x: Values) -> dict[str, Any]:
    """Return the values of `TRUTH`; the reference of positions is the reported start."""
    return {"q_nb": x.q_nb, "velocity_n": x.velocity_n, "position": from_reference(p, x)}


def from_reference(p: Values, place: Values) -> Any:
    """Return the position of a place (with latitude, longitude and height) from the reference (3, m, n)."""
    return geodesy.ned_offset(
        place.latitude, place.longitude, place.height, p.known_latitude, p.known_longitude, p.known_height
    )
