"""The task of making the heading known by moving: the action commands the vehicle, a filter inside finds the attitude.

A round is: the step ``act``, which takes the command and keeps how well the heading was known, then the samples; the
score is how much better it is known then.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, select, wrap_angle
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs.commands import COMMANDS
from insenv.envs.filter_inside import COMMON, ERROR, SMALLEST, Inner, inner_loop, log10, within
from insenv.envs.task import CLOCK, DECISIONS, NEVER, RESULT, TRUTH, Task, truth
from insenv.envs.window import SHOWN, begun, shown, window_part

WORST = 10.0
"""Lost, besides what the time left costs, when the filter diverges."""
FARTHEST = 1e5
"""m of position error beyond which the filter has diverged."""

_PARAMETERS = COMMON + Table((
    Row("time_weight", "Reward lost by using all the time", start=1.0, lower=0.0, upper=1e6),
    Row("goal", "Stated standard deviation of the heading at which the task is done", "rad", start=0.0, lower=0.0, upper=4.0),
))  # fmt: skip
_STATE = Table((
    NEVER,
    DECISIONS,
    Row("level_before", "How well the heading was known at the last action: a natural logarithm"),
))  # fmt: skip
_FOUND = Table((
    Row("roll_pitch", "Roll and pitch, as the filter finds them", "rad", (2,), "n", lower=-4.0, upper=4.0),
    Row("heading_cosine_sine", "Cosine and sine of the heading, likewise", "1", (2,), "n", lower=-1.0, upper=1.0),
    Row("velocity_estimate", "Velocity, likewise", "m/s", (3,), "n", lower=-1e4, upper=1e4),
    Row("position_estimate", "Position from the start as told, likewise", "m", (3,), "n", lower=-1e7, upper=1e7),
    Row("attitude_level", "Decimal logarithm of the stated standard deviation of the misalignment, north, east, down (rad)",
        "1", (3,), "n", lower=-16.0, upper=16.0),
    Row("velocity_level", "Likewise of the velocity (m/s)", "1", (3,), "n", lower=-16.0, upper=16.0),
    Row("position_level", "Likewise of the position (m)", "1", (3,), "n", lower=-16.0, upper=16.0),
    Row("gyro_bias", "Gyro bias, as the filter finds it", "rad/s", (3,), "b", lower=-1e3, upper=1e3),
    Row("accel_bias", "Accelerometer bias, likewise", "m/s^2", (3,), "b", lower=-1e5, upper=1e5),
))  # fmt: skip
_INFO = Table((
    *TRUTH,
    ERROR,
    Row("heading_error", "Heading found less the true one, in (-pi, pi]", "rad"),
    Row("heading_sigma", "Standard deviation of the misalignment about down that the filter states", "rad"),
    Row("goal", "That at which the task is done", "rad"),
    Row("reached", "1 if the goal is reached"),
    Row("diverged", "1 if the filter has diverged"),
))  # fmt: skip


def _by_uncertainty(inner: Inner, p: Any, x: Any) -> Any:
    """ln of the stated standard deviation."""
    return _log(inner.found(p, x).attitude_sigma[2])


def _by_error(inner: Inner, p: Any, x: Any) -> Any:
    """ln of the error, of which errors below the goal hardly count."""
    error = _heading_error(inner, p, x)
    return 0.5 * _log(error * error + p.goal * p.goal)


REWARDS: dict[str, Callable[[Inner, Any, Any], Any]] = {"uncertainty": _by_uncertainty, "error": _by_error}
"""What falls, by name."""


@lru_cache(maxsize=16)
def manoeuvre_task(plant: Model, kind: str, estimator: str, reward: str) -> Task:
    """The task for a plant whose vehicle is of a kind of `COMMANDS`, with the filter `estimator` and a reward of `REWARDS`.

    Raises `InputError` for a filter that cannot run inside.
    """
    inner, commands, level = inner_loop(plant, estimator), COMMANDS[kind], REWARDS[reward]
    command = Row("command", "The action in force", "1", (commands.actions.size,), lower=-1.0, upper=1.0)
    observation = Table((CLOCK,)) + _FOUND + SHOWN + Table((command,))

    def act(p: Any, x: Any, u: Any) -> dict[str, Any]:
        action = ca.vertcat(*(clamp(getattr(u, row.name), -1.0, 1.0) for row in commands.actions))
        return {
            **commands.taken(plant, p, x, u),
            "command": action,
            "decisions": x.decisions + 1.0,
            "level_before": level(inner, p, x),
            **begun(),
        }

    def output(p: Any, x: Any) -> dict[str, Any]:
        seen = {"time": x.time, **_seen(inner, p, x), **shown(p, x), "command": x.command}
        return within(observation, seen) | _scored(inner, level, p, x)

    score = Part(
        parameters=_PARAMETERS,
        state=_STATE + Table((command,)),
        inputs=commands.actions,
        steps={"act": Step(act, when="never")},
    )
    title = f"{inner.model.title}: manoeuvres"
    model = merge(
        f"{inner.model.id}-manoeuvre", title, [as_part(inner.model), window_part(), score], observation + RESULT + _INFO, output
    )
    return Task(model, commands.actions, Table(), observation, _INFO, judge="act", starts_from_knowledge=True)


def _seen(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    found = inner.found(p, x)
    roll, pitch, _ = attitude.to_euler(found.q_nb)
    forward = attitude.to_dcm(found.q_nb)[:2, 0]
    length = ca.sqrt(ca.sumsqr(forward))
    places = (found.latitude, found.longitude, found.height, p.known_latitude, p.known_longitude, p.known_height)
    return {
        "roll_pitch": ca.vertcat(roll, pitch),
        "heading_cosine_sine": forward / select(length > 0.0, length, 1.0),
        "velocity_estimate": found.velocity_n,
        "position_estimate": geodesy.ned_offset(*places),
        "attitude_level": log10(found.attitude_sigma),
        "velocity_level": log10(found.velocity_sigma),
        "position_level": log10(found.position_sigma),
        "gyro_bias": found.gyro_bias,
        "accel_bias": found.accel_bias,
    }


def _scored(inner: Inner, level: Callable[[Inner, Any, Any], Any], p: Any, x: Any) -> dict[str, Any]:
    error, sigma = inner.error(p, x), inner.found(p, x).attitude_sigma[2]
    # neither holds of what is no number
    sound = ca.logic_and(ca.sumsqr(error) <= FARTHEST**2, ca.logic_and(sigma >= 0.0, sigma <= 1e3))
    reached = ca.logic_and(sound, sigma < p.goal)
    each = 1.0 / p.decision_limit
    left = 1.0 - (x.decisions - 1.0) * each  # share of the time left, this decision included
    fall = x.level_before - level(inner, p, x)
    over = ca.logic_or(reached, ca.logic_not(sound))
    return {
        "reward": select(sound, fall - each * p.time_weight, -(WORST + left * p.time_weight)),
        "terminated": over,
        "truncated": ca.logic_and(x.decisions >= p.decision_limit, ca.logic_not(over)),
        **truth(p, x),
        "error": select(sound, error, 0.0),
        "heading_error": select(sound, _heading_error(inner, p, x), 0.0),
        "heading_sigma": select(sound, sigma, 0.0),
        "goal": p.goal,
        "reached": reached,
        "diverged": ca.logic_not(sound),
    }


def _heading_error(inner: Inner, p: Any, x: Any) -> Any:
    found, true = (attitude.to_euler(q)[2] for q in (inner.found(p, x).q_nb, x.q_nb))
    return wrap_angle(found - true)


def _log(value: Any) -> Any:
    return log(select(value >= SMALLEST, value, SMALLEST))
