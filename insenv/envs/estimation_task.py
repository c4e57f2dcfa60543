"""The task of estimating the attitude of a plant, or its full navigation state.

One decision consists of the step ``judge``, which scores the action against the present truth, and then of the inertial
samples until the next decision.  The task changes neither the plant nor its noise, whose streams are those of `insenv
run`.

Error measure, with each of the k error components e (a rotation vector in n; for navigation also velocity and position)
in units of its limit s: ``m = ln(1 + sqrt(sum((e / s)^2) / k))``, at most `WORST_MEASURE`.

The score of an alignment is -(m of its last estimate + time_weight * share of the time used), that of a navigation minus the
mean of m over the time.  By default an episode returns its score: a step pays no more than the cost of its time, and the last
one the rest.  With the parameter `dense` each step of an alignment pays the decrease of m, and the return is the score plus m
of the reported attitude; each step of a navigation pays its share of the score.  Dense rewards show the error to a policy that
sees them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, reduce
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, maximum, minimum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Array, Row, Table
from insenv.envs import gravity
from insenv.envs.checks import as_numbers, refused
from insenv.envs.gravity import CORRECTION
from insenv.envs.knowledge import KNOWN
from insenv.envs.task import (
    CLOCK,
    DECISION_LIMIT,
    DECISIONS,
    DENSE,
    NEVER,
    RESULT,
    TRUTH,
    Task,
    finite_action,
    from_reference,
    truth,
)

WORST_MEASURE = 20.0
"""Largest value of the error measure, and its value for an invalid estimate."""
VELOCITY_RANGE = 1000.0
"""m/s for an action component of 1."""
POSITION_RANGE = 1e6
"""m for an action component of 1."""
MIN_SQUARED_NORM = 1e-12
"""Squared norm below which a quaternion is invalid."""

SAMPLE = Table((
    Row("delta_angle", "Gyro increment", "rad", (3,), "b", lower=-10.0, upper=10.0),
    Row("delta_velocity", "Accelerometer increment", "m/s", (3,), "b", lower=-1e4, upper=1e4),
    Row("imu_valid", "0 if the sample was lost", lower=0.0, upper=1.0),
))  # fmt: skip
"""Rows of each inertial sample in an observation."""
FIX = Table((
    Row("fix_new", "1 if the fix arrived since the last step", lower=0.0, upper=1.0),
    Row("fix_time", "Time of delivery of the latest fix", "s", lower=0.0, upper=1e6),
    Row("fix_delay", "Time from its epoch to its delivery", "s", lower=0.0, upper=1e6),
    Row("fix_position", "Antenna from the reference, latest fix", "m", (3,), "n", lower=-1e8, upper=1e8),
    Row("fix_position_sigma", "Its standard deviation, as the receiver reports", "m", (3,), "n", lower=0.0, upper=1e8),
    Row("fix_has_velocity", "1 if the latest fix has a velocity", lower=0.0, upper=1.0),
    Row("fix_velocity_n", "Velocity of the antenna, latest fix", "m/s", (3,), "n", lower=-1e5, upper=1e5),
    Row("fix_velocity_sigma", "Its standard deviation, as the receiver reports", "m/s", (3,), "n", lower=0.0, upper=1e5),
))  # fmt: skip
"""State rows of the latest fix, zeros before the first."""
FIX_SOURCES = {
    "fix_delay": "gnss_age",
    "fix_position_sigma": "gnss_position_sigma",
    "fix_has_velocity": "gnss_velocity_valid",
    "fix_velocity_n": "gnss_velocity_n",
    "fix_velocity_sigma": "gnss_velocity_sigma",
}
"""Rows of `FIX` and the rows of the plant, and of an estimator's inputs, that have the same value."""
FIX_AGE = Row("fix_age", "Time since the epoch of the latest fix", "s", lower=0.0, upper=1e6)
FLAGS = Table((
    Row("declared", "1 if the agent has declared itself aligned", lower=0.0, upper=1.0),
    Row("diverged", "1 if the estimate was invalid", lower=0.0, upper=1.0),
))  # fmt: skip
OWED = Row("owed", "What the score has lost so far and the end takes off")
MEASURE = Row("measure", "Measure of the latest estimate's error; before the first, of the reported attitude's")


def fix_part() -> Part:
    """Return the part that keeps the latest fix; it reads the plant's GNSS rows, `time` and the parameters `KNOWN`."""

    def keep(p: Any, x: Any, u: Any) -> dict[str, Any]:
        antenna = geodesy.ned_offset(
            x.gnss_latitude, x.gnss_longitude, x.gnss_height, p.known_latitude, p.known_longitude, p.known_height
        )
        copied = {name: getattr(x, source) for name, source in FIX_SOURCES.items()}
        return {"fix_new": ca.SX(1), "fix_time": x.time, "fix_position": antenna, **copied}

    return Part(state=FIX, steps={"keep_fix": Step(keep, when="gnss_valid")})


_QUATERNION = Row("estimate_q_nb", "Estimate of q_nb; any norm but 0", "1", (4,), "n", (1, 0, 0, 0), -1.0, 1.0)
ALIGNMENT_ACTIONS = Table((
    _QUATERNION,
    Row("declare", "Above 0: aligned, end the episode", start=-1.0, lower=-1.0, upper=1.0),
))  # fmt: skip
"""Action of an alignment, elements in [-1, 1]: it ends when it is declared."""
NAVIGATION_ACTIONS = Table((
    _QUATERNION,
    Row("estimate_velocity", f"Estimate of velocity_n, in {VELOCITY_RANGE:g} m/s", "1", (3,), "n", 0.0, -1.0, 1.0),
    Row("estimate_position", f"Estimate of the position from the reference, in {POSITION_RANGE:g} m", "1", (3,), "n", 0.0,
        -1.0, 1.0),
))  # fmt: skip
"""Action of a navigation, elements in [-1, 1]: it lasts its full time."""


def _error_rows(navigates: bool) -> tuple[Row, Row]:
    """Return the rows of the error (estimate minus truth) and of its limit."""
    size, what = (9, "rotation vector (rad), velocity (m/s), position (m)") if navigates else (3, "rotation vector (rad)")
    error = Row("error", f"Error of the latest estimate in n: {what}", "1", (size,), "n")
    limit = Row("limit", "1-sigma limit of each component of the error", "1", (size,), "n", 1.0, lower=1e-15, upper=1e9)
    return error, limit


def _measure(error: Any, limit: Any) -> Any:
    """Return the error measure m of the module's docstring."""
    return minimum(log(1.0 + ca.sqrt(ca.sumsqr(error / limit) / error.numel())), WORST_MEASURE)


def _measure_before(p: Any, x: Any) -> Any:
    """Return the measure of the latest estimate of an alignment: before the first one, of the reported attitude."""
    reported = attitude.from_euler(*(p.known_attitude[k] for k in range(3)))
    at_start = _measure(attitude.error_rotation_vector(reported, x.q_nb), p.limit)
    return select(x.decisions > 0.0, x.measure, at_start)


def _judge(actions: Table, p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Score the action.

    A quaternion is normalized and all else is clipped to [-1, 1]; what is not finite, and a zero quaternion, is invalid.
    """
    navigates = "declare" not in actions
    finite, values = finite_action(ca.vertcat(*(getattr(u, row.name) for row in actions)))
    changed: dict[str, Any] = {}
    threshold = 0.0
    if CORRECTION.name in actions:
        action = actions.symbols(clamp(values, -1.0, 1.0))
        threshold = gravity.DECLARE_ABOVE
        changed["held_q"] = gravity.corrected(p, x, action.correction)
        quaternion = gravity.stated(p, x, changed["held_q"])
    else:
        # a long quaternion must not overflow when it is squared
        largest = reduce(maximum, (ca.fabs(values[k]) for k in range(4)), ca.SX(1.0))
        action = actions.symbols(ca.vertcat(values[:4] / largest, clamp(values[4:], -1.0, 1.0)))
        quaternion = action.estimate_q_nb
    square = ca.dot(quaternion, quaternion)
    invalid = ca.logic_or(square < MIN_SQUARED_NORM, ca.logic_not(finite))
    q_nb = select(square < MIN_SQUARED_NORM, ca.SX([1, 0, 0, 0]), quaternion)
    error = attitude.error_rotation_vector(q_nb / ca.sqrt(select(square < MIN_SQUARED_NORM, 1.0, square)), x.q_nb)
    if navigates:
        velocity = action.estimate_velocity * VELOCITY_RANGE - x.velocity_n
        error = ca.vertcat(error, velocity, action.estimate_position * POSITION_RANGE - from_reference(p, x))
    measure = _measure(error, p.limit)

    decisions = x.decisions + 1.0
    last = decisions >= p.decision_limit
    share = 1.0 / p.decision_limit
    left = 1.0 - x.decisions * share  # share of the time left, this decision included
    declared = ca.SX(0) if navigates else ca.logic_and(action.declare > threshold, ca.logic_not(invalid))
    terminated = ca.logic_or(declared, invalid)
    over = ca.logic_or(terminated, last)
    if navigates:
        lost = select(invalid, left * WORST_MEASURE, share * measure)
        changed["owed"] = x.owed + lost
        reward = -select(p.dense, lost, select(over, changed["owed"], 0.0))
    else:
        changed["measure"] = measure = select(invalid, WORST_MEASURE, measure)
        gained = select(p.dense, _measure_before(p, x) - measure, select(over, -measure, 0.0))
        reward = gained - p.time_weight * select(invalid, left, share)
    return {
        "reward": reward,
        "terminated": terminated,
        "truncated": ca.logic_and(last, ca.logic_not(terminated)),
        "declared": declared,
        "diverged": invalid,
        "decisions": decisions,
        "error": error,
        **changed,
        **({"fix_new": ca.SX(0)} if hasattr(x, "fix_new") else {}),
    }


@lru_cache(maxsize=64)
def estimation_task(
    plant: Model, navigates: bool, shown: tuple[str, ...] = (), compact: bool = False, corrects: bool = False
) -> Task:
    """Return the task of estimating the attitude of a plant, or (navigates) its attitude, velocity and position.

    shown: state rows of the plant, of sensors other than the inertial unit and the GNSS receiver, that an observation
    contains for every inertial sample too.  compact: whether the observation of an alignment is that of
    `insenv.envs.gravity` instead of the samples.  corrects: whether its action is a correction.
    """
    has_gnss = "gnss_valid" in plant.state
    error, limit = _error_rows(navigates)
    actions = NAVIGATION_ACTIONS if navigates else gravity.ACTIONS if corrects else ALIGNMENT_ACTIONS
    fix = Table((FIX["fix_new"], FIX_AGE)) + Table(FIX.rows[2:]) if has_gnss else Table()
    observation = gravity.OBSERVED if compact else Table((CLOCK,)) + fix + KNOWN
    info = TRUTH + Table((error, limit)) + FLAGS + Table(() if navigates else (MEASURE,))

    def output(p: Any, x: Any) -> dict[str, Any]:
        rows = {"limit": p.limit, **{name: getattr(x, name) for name in (*RESULT.names, "error", *FLAGS.names)}}
        if not navigates:
            rows[MEASURE.name] = _measure_before(p, x)
        if compact:
            return rows | gravity.observed(p, x) | truth(p, x)
        rows |= {"time": x.time, **{name: getattr(p, name) for name in KNOWN.names}}
        if has_gnss:
            rows |= {name: getattr(x, name) for name in fix.names if name != "fix_age"}
            rows["fix_age"] = (x.time - x.fix_time) + x.fix_delay
        return rows | truth(p, x)

    what = "navigation" if navigates else "alignment"
    weight = Row("time_weight", "Reward lost by using all the time before declaring", start=1.0, lower=0.0, upper=1e6)
    referee = Part(
        parameters=KNOWN + Table((limit, DECISION_LIMIT, DENSE, weight)),
        state=RESULT + FLAGS + Table((DECISIONS, error, NEVER, OWED if navigates else MEASURE)),
        inputs=actions,
        steps={"judge": Step(lambda p, x, u: _judge(actions, p, x, u), when="never")},
    )
    parts = [
        as_part(plant),
        *([fix_part()] if has_gnss else []),
        *([gravity.gravity_part()] if compact or corrects else []),
        referee,
    ]
    model = merge(f"{plant.id}-{what}", f"{plant.title}: {what}", parts, observation + RESULT + info, output)
    watched = Table() if compact else SAMPLE + Table(tuple(plant.state[name] for name in shown))
    return Task(model, actions, watched, observation, info)


def estimate_action(
    task: Task, q_nb: Array, declare: Array | float = -1.0, velocity_n: Array | None = None, position: Array | None = None
) -> Array:
    """Return the action that states an estimate, (actions.size,), or (rows, actions.size) for estimates of many rows.

    q_nb (..., 4).  declare: above 0 ends an alignment.  velocity_n (..., 3), m/s, and position from the reference
    (..., 3), m, both in n: for navigation tasks.  Raises `InputError` for a missing component or a wrong shape.
    """
    lead = np.shape(q_nb)[:-1]
    action = np.empty((*lead, task.actions.size))
    values: Mapping[str, Any] = {"estimate_q_nb": q_nb, "declare": declare}
    if velocity_n is not None and position is not None:
        values = {**values, "estimate_velocity": velocity_n / VELOCITY_RANGE, "estimate_position": position / POSITION_RANGE}
    for row in task.actions:
        if row.name not in values:
            raise InputError(f"estimate_action: {row.name!r} ({row.meaning}) is missing; this task's action needs it")
        value = as_numbers(values[row.name])
        if value is None or value.shape not in ((*lead, *row.shape), row.shape):
            raise refused(row.name, values[row.name], f"numbers of shape {(*lead, *row.shape)}")
        action[..., task.actions.slice(row.name)] = value if row.shape else value[..., None]
    return action
