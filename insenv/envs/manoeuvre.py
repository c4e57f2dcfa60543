"""`ManoeuvreEnv`: the action moves the vehicle so that its filter can observe the heading.

One decision consists of the step ``act``, which takes the command and stores how well the heading is known, and then of
the inertial samples.  The score is how much better the heading is known after them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import radians
from types import SimpleNamespace
from typing import Any, ClassVar

import casadi as ca

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, select, wrap_angle
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs.checks import check_number, check_type
from insenv.envs.embedded_filter import (
    COMMON,
    ERROR,
    LOG_FLOOR,
    STATISTICS,
    Inner,
    empty_window,
    inner_loop,
    log10,
    statistics,
    window_part,
    within,
)
from insenv.envs.setup import Arguments
from insenv.envs.single import InertialEnv
from insenv.envs.starts import InnerStarts, Range, Ranges
from insenv.envs.task import CLOCK, DECISIONS, INVALID, NEVER, RESULT, TRUTH, Task, finite_action, truth
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario, ScenarioLike, plant_of
from insenv.scenario.plant import plant_model
from insenv.vehicles import Actions, Vehicle, registry
from insenv.vehicles.turntable import INDEXING, on_turntable

DIVERGENCE_COST = 10.0
"""Reward lost when the filter diverges, in addition to the cost of the time left."""
MAX_ERROR_NORM = 1e5
"""Position error above which the filter has diverged, m."""

UNITS = ("tactical", "industrial")
"""Default grades between which the unit is drawn."""
GOAL = "Stated standard deviation of the heading below which the task is done"
_PARAMETERS = COMMON + Table((
    Row("time_weight", "Reward lost by using all the time", start=1.0, lower=0.0, upper=1e6),
    Row("goal", GOAL, "rad", start=0.0, lower=0.0, upper=4.0),
))  # fmt: skip
_STATE = Table((
    NEVER,
    DECISIONS,
    INVALID,
    Row("level_before", "Natural logarithm of the heading uncertainty at the last action"),
    Row("level_start", "The same at the first action"),
))  # fmt: skip
_ESTIMATES = Table((
    Row("roll_pitch", "Estimated roll and pitch", "rad", (2,), "n", lower=-4.0, upper=4.0),
    Row("heading_cosine_sine", "Cosine and sine of the estimated heading", "1", (2,), "n", lower=-1.0, upper=1.0),
    Row("velocity_estimate", "Estimated velocity", "m/s", (3,), "n", lower=-1e4, upper=1e4),
    Row("position_estimate", "Estimated position from the reported start", "m", (3,), "n", lower=-1e7, upper=1e7),
    *(
        Row(f"{name}_level", f"Decimal logarithm of the stated standard deviation of the {what}", "1", (3,), "n",
            lower=-16.0, upper=16.0)
        for name, what in (("attitude", "misalignment (rad)"), ("velocity", "velocity (m/s)"), ("position", "position (m)"))
    ),
    Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b", lower=-1e3, upper=1e3),
    Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b", lower=-1e5, upper=1e5),
))  # fmt: skip
_INFO = Table((
    *TRUTH,
    ERROR,
    Row("heading_error", "Heading error, estimate minus truth, in (-pi, pi]", "rad"),
    Row("heading_sigma", "Stated standard deviation of the misalignment about down", "rad"),
    Row("goal", GOAL, "rad"),
    Row("reached", "1 if the goal is reached"),
    Row("diverged", "1 if the filter has diverged"),
))  # fmt: skip


def _by_uncertainty(inner: Inner, p: Any, x: Any) -> Any:
    """Return ln of the stated standard deviation of the heading."""
    return _log(inner.outputs(p, x).attitude_sigma[2])


def _by_error(inner: Inner, p: Any, x: Any) -> Any:
    """Return ln of the heading error, with a floor at the goal."""
    error = _heading_error(inner, p, x)
    return 0.5 * _log(error * error + p.goal * p.goal)


LEVELS: dict[str, Callable[[Inner, Any, Any], Any]] = {"error": _by_error, "uncertainty": _by_uncertainty}
"""Logarithm whose fall is the reward."""


@lru_cache(maxsize=16)
def manoeuvre_task(plant: Model, actions: Actions, estimator: str, level_of: str) -> Task:
    """Return the task of making the heading observable by moving.

    actions: how the agent steers the vehicle.  estimator: id of the inner filter.  level_of: a key of `LEVELS`.

    Raises `InputError` for a filter that cannot run inside.
    """
    inner, level = inner_loop(plant, estimator), LEVELS[level_of]
    command = Row("command", "The action in force", "1", (actions.rows.size,), lower=-1.0, upper=1.0)
    observation = Table((CLOCK,)) + _ESTIMATES + STATISTICS + Table((command,))

    def act(p: Any, x: Any, u: Any) -> dict[str, Any]:
        finite, values = finite_action(ca.vertcat(*(getattr(u, row.name) for row in actions.rows)))
        action, now = clamp(values, -1.0, 1.0), level(inner, p, x)
        return {
            **_taken(plant, p, x, u, actions.commands(x, actions.rows.symbols(action))),
            "invalid": ca.logic_not(finite),
            "command": action,
            "decisions": x.decisions + 1.0,
            "level_before": now,
            "level_start": select(x.decisions > 0.0, x.level_start, now),
            **empty_window(),
        }

    def output(p: Any, x: Any) -> dict[str, Any]:
        seen = {"time": x.time, **_seen(inner, p, x), **statistics(p, x), "command": x.command}
        return within(observation, seen) | _scored(inner, level, p, x)

    score = Part(
        parameters=_PARAMETERS,
        state=_STATE + Table((command,)),
        inputs=actions.rows,
        steps={"act": Step(act, when="never")},
    )
    title = f"{inner.model.title}: manoeuvres"
    model = merge(
        f"{inner.model.id}-manoeuvre", title, [as_part(inner.model), window_part(), score], observation + RESULT + _INFO, output
    )
    return Task(model, actions.rows, Table(), observation, _INFO, judge="act")


def _taken(plant: Model, p: Any, x: Any, u: Any, commands: Mapping[str, Any]) -> Mapping[str, Any]:
    """The commands in force after an action, by state row: the vehicle's own step ``command`` ends the scenario's script."""
    if any(f"command_{name}" not in plant.inputs for name in commands):
        return {f"commanded_{name}": value for name, value in commands.items()}
    inputs = {f"command_{name}": value for name, value in commands.items()}
    return plant.steps["command"].function(p, x, SimpleNamespace(**{**vars(u), **inputs}))


def _seen(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    estimate = inner.outputs(p, x)
    roll, pitch, _ = attitude.to_euler(estimate.q_nb)
    forward = attitude.to_dcm(estimate.q_nb)[:2, 0]
    length = ca.sqrt(ca.sumsqr(forward))
    places = (estimate.latitude, estimate.longitude, estimate.height, p.known_latitude, p.known_longitude, p.known_height)
    return {
        "roll_pitch": ca.vertcat(roll, pitch),
        "heading_cosine_sine": forward / select(length > 0.0, length, 1.0),
        "velocity_estimate": estimate.velocity_n,
        "position_estimate": geodesy.ned_offset(*places),
        "attitude_level": log10(estimate.attitude_sigma),
        "velocity_level": log10(estimate.velocity_sigma),
        "position_level": log10(estimate.position_sigma),
        "gyro_bias": estimate.gyro_bias,
        "accel_bias": estimate.accel_bias,
    }


def _scored(inner: Inner, level: Callable[[Inner, Any, Any], Any], p: Any, x: Any) -> dict[str, Any]:
    error, sigma = inner.error(p, x), inner.outputs(p, x).attitude_sigma[2]
    # comparisons with NaN are false
    sound = ca.logic_and(ca.sumsqr(error) <= MAX_ERROR_NORM**2, ca.logic_and(sigma >= 0.0, sigma <= 1e3))
    sound = ca.logic_and(sound, ca.logic_not(x.invalid))
    reached = ca.logic_and(sound, sigma < p.goal)
    each = 1.0 / p.decision_limit
    left = 1.0 - (x.decisions - 1.0) * each  # share of the time left, this decision included
    over, last, now = ca.logic_or(reached, ca.logic_not(sound)), x.decisions >= p.decision_limit, level(inner, p, x)
    whole = select(ca.logic_or(over, last), x.level_start - now, 0.0)
    fall = select(p.dense, x.level_before - now, whole)
    so_far = select(p.dense, 0.0, x.level_start - x.level_before)
    return {
        "reward": select(sound, fall - each * p.time_weight, so_far - (DIVERGENCE_COST + left * p.time_weight)),
        "terminated": over,
        "truncated": ca.logic_and(last, ca.logic_not(over)),
        **truth(p, x),
        "error": select(sound, error, 0.0),
        "heading_error": select(sound, _heading_error(inner, p, x), 0.0),
        "heading_sigma": select(sound, sigma, 0.0),
        "goal": p.goal,
        "reached": reached,
        "diverged": ca.logic_not(sound),
    }


def _heading_error(inner: Inner, p: Any, x: Any) -> Any:
    estimated, true = (attitude.to_euler(q)[2] for q in (inner.outputs(p, x).q_nb, x.q_nb))
    return wrap_angle(estimated - true)


def _log(value: Any) -> Any:
    return log(select(value >= LOG_FLOOR, value, LOG_FLOOR))


@dataclass(kw_only=True, repr=False, eq=False)
class Manoeuvre(Arguments):
    """The arguments and the task of `ManoeuvreEnv` and `ManoeuvreVectorEnv`."""

    needs_gnss: ClassVar[bool] = True
    units: ClassVar[tuple[str, str]] = UNITS
    rewards: ClassVar[tuple[str, ...]] = (*Arguments.rewards, "uncertainty")
    scenario: ScenarioLike = field(default="car-unknown-heading", kw_only=False)
    samples_per_step: int = 400
    imu: str | None = "random"
    heading_deg: Range | None = (0.0, 360.0)
    start_speed_mps: Range | None = None
    estimator: str = "aqe-ekf"
    goal_deg: float = 0.1
    time_weight: float = 1.0

    def _ranges(self, scenario: Scenario) -> Ranges:
        ranges = super()._ranges(scenario)
        if ranges.start_speed_mps is None and plant_of(scenario)[1].get("start_speed", 0.0) > 0.0:
            return replace(ranges, start_speed_mps=_commanded(scenario)[1].start_speeds)
        return ranges

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        return {
            "time_weight": check_number("time_weight", self.time_weight, 0.0, 1e6),
            "goal": radians(check_number("goal_deg", self.goal_deg, 0.0, 180.0, "deg", above=True)),
        }

    def _task(self, scenario: Scenario) -> Task:
        check_type("estimator", self.estimator, str, "the id of an estimator")
        level_of = "uncertainty" if self.reward == "uncertainty" else "error"
        return manoeuvre_task(*_commanded(scenario), self.estimator, level_of)

    def _starts(self, scenario: Scenario, *rest: Any) -> InnerStarts:
        return InnerStarts(scenario, *rest, estimator=self.estimator)


def _commanded(scenario: Scenario) -> tuple[Model, Actions]:
    """Return the plant and how it is steered; a vehicle that stays in place stands on a turntable."""
    actions, name = scenario.vehicle.traits.actions, scenario.name or scenario.title
    if actions is None:
        kinds = [kind for kind in registry.names() if registry.traits_of(kind).actions is not None]
        raise InputError(
            f"ManoeuvreEnv needs a vehicle that an agent steers ({', '.join(kinds)}): scenario {name!r} has a "
            f"{scenario.vehicle.kind}"
        )
    if not scenario.vehicle.in_place:
        return plant_of(scenario)[0], actions
    return _turntable_plant(scenario.vehicle.vehicle()), INDEXING


@lru_cache(maxsize=16)
def _turntable_plant(vehicle: Vehicle) -> Model:
    return plant_model(on_turntable(vehicle))


@dataclass(kw_only=True, repr=False, eq=False)
class ManoeuvreEnv(Manoeuvre, InertialEnv):
    """
    ## Description
    A vehicle with GNSS does not know its heading. Fixes give its direction of travel; they do not give the orientation
    of its inertial unit until it accelerates, brakes or turns. The agent commands the vehicle such that the built-in
    filter finds the heading quickly: active alignment. A vehicle that stays in place stands on a turntable, which the
    agent turns (indexing). Id: `insenv/Manoeuvre-v0`.

    ## Action Space
    `Box(-1, 1, float64)`; actions outside the space are clipped to it, and one that is not finite ends the episode as a
    divergence. A car, (2,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | acceleration along the path, up to 25 m/s; negative: brake to a stop | -1 | 1 | 3 m/s^2 |
    | 1 | acceleration across the path, positive to the right: a turn | -1 | 1 | 3 m/s^2 |

    An aircraft, (3,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | acceleration along the path, between 60 and 120 m/s | -1 | 1 | 2.5 m/s^2 |
    | 1 | bank of a coordinated turn, positive to the right | -1 | 1 | 0.7 rad |
    | 2 | rate of climb | -1 | 1 | 10 m/s |

    A car or aircraft in place, (1,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | target angle of the turntable, clockwise; it turns at 10 deg/s | -1 | 1 | 180 deg |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` returns it by name. "Level" is the decimal logarithm of a
    value in SI units. The window is the time since the last step. A is the size of the action.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | time since the start | 0 | 1e6 | s |
    | 1-2 | estimated roll and pitch | -4 | 4 | rad |
    | 3-4 | cosine and sine of the estimated heading | -1 | 1 | 1 |
    | 5-7 | estimated velocity, n | -1e4 | 1e4 | m/s |
    | 8-10 | estimated position from the reported start, n | -1e7 | 1e7 | m |
    | 11-13 | levels of the stated standard deviations of the misalignment about north, east, down (rad) | -16 | 16 | 1 |
    | 14-16 | levels of those of the velocity (m/s) | -16 | 16 | 1 |
    | 17-19 | levels of those of the position (m) | -16 | 16 | 1 |
    | 20-22 | estimated gyro bias, b | -1e3 | 1e3 | rad/s |
    | 23-25 | estimated accelerometer bias, b | -1e5 | 1e5 | m/s^2 |
    | 26-57 | statistics of the fixes and sensors in the window: components 1-32 of `TuningEnv` | | | |
    | 58 .. 57+A | the action in force | -1 | 1 | 1 |

    ## Rewards
    Let k be `ln sqrt(error^2 + goal^2)` with the true error of the heading, and T the number of steps. The return of an
    episode is the total fall of k, minus `time_weight` times the share of the time used. With `reward="final"`, the default,
    a step pays `-time_weight / T`, and the last one the fall of k too; with `reward="dense"` every step pays
    `(k before - k after) - time_weight / T`, which reveals the true error. With `reward="uncertainty"` k is the logarithm of
    the stated standard deviation, which the observation contains: it reveals nothing, has less noise, and also pays for
    overconfidence. A function of the info as for `AlignmentEnv`. Divergence ends the episode and costs
    `10 + time_weight * (share of the time left)`.

    ## Starting State
    That of the scenario, with a seed from the environment's generator; inertial unit, heading and start speed are drawn,
    so that no fixed sequence of commands is the best for every seed. The first action ends the commands of the scenario's
    own legs.

    ## Episode End
    Terminated when the stated standard deviation of the heading is below the goal, or when the filter diverges: a
    position error above 100 km, or NaN. Truncated at the end of the time.

    ## Arguments
    - `scenario`: as for `AlignmentEnv`, of a car or aircraft with GNSS.
    - `estimator`: "aqe-ekf", "aqe-sukf" (both made for an unknown heading) or "loosely-coupled". Its parameters are those
      of `insenv.run`; for a turntable, `rotation_error = 0` in the scenario's [estimator.ID] fits better than the default.
    - `start_speed_mps`: range of the start speed, m/s. None: from 2 to 12 m/s for a car and from 70 to 110 m/s for an
      aircraft, if the vehicle of the scenario moves at the start.
    - `goal_deg`: goal for the heading, deg. `reward`, `time_weight`: see Rewards.
    - All others, and the options of `reset`: as for `AlignmentEnv`, without `sway_phases`, `mounting_deg`, `observation` and
      `action`; `start_speed_mps` is an option too.

    ## Vectorized environment
    `gymnasium.make_vec` makes `ManoeuvreVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """


@dataclass(kw_only=True, repr=False, eq=False)
class ManoeuvreVectorEnv(Manoeuvre, InertialVectorEnv):
    """Many `ManoeuvreEnv` in one batch; takes the arguments of `ManoeuvreEnv` and of `InertialVectorEnv`."""
