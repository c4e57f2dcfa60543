"""`ManoeuvreEnv`: the action moves the vehicle so that its filter can observe the heading.

One decision consists of the step ``act``, which takes the command and stores how well the heading is known, and then of the
inertial samples.  The score is how much better the heading is known after them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from math import radians
from typing import Any

import casadi as ca
from gymnasium.vector import AutoresetMode

from insenv import attitude, geodesy
from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, select, wrap_angle
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs.checks import check_choice, check_number, check_type
from insenv.envs.commands import COMMANDS
from insenv.envs.filter_inside import COMMON, ERROR, SMALLEST, Inner, inner_loop, log10, within
from insenv.envs.setup import ScenarioLike, Setup, chosen_scenario, make_setup
from insenv.envs.single import InertialEnv
from insenv.envs.starts import IMU_RANGE, InnerStarts, Range, Ranges
from insenv.envs.task import CLOCK, DECISIONS, NEVER, RESULT, TRUTH, Task, truth
from insenv.envs.vector import InertialVectorEnv
from insenv.envs.window import SHOWN, begun, shown, window_part
from insenv.errors import InputError
from insenv.plant import plant_model
from insenv.scenario import Scenario, plant_of
from insenv.scenario.legs import Structure
from insenv.scenario.vehicles import make_vehicle
from insenv.vehicles.turntable import on_turntable

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


def _setup(
    scenario: ScenarioLike, vehicle: str, ranges: Ranges, samples_per_step: int, duration_s: float | None, estimator: str,
    reward: str, goal_deg: float, time_weight: float,
) -> Setup:  # fmt: skip
    """Return the setup for the arguments of the classes below."""
    found = chosen_scenario(scenario, vehicle)
    name = found.name or found.title
    if found.vehicle.kind not in COMMANDS:
        raise InputError(f"a manoeuvre environment needs a car or an aircraft: scenario {name!r} has a {found.vehicle.kind}")
    if found.gnss is None:
        raise InputError(f"a manoeuvre environment needs GNSS fixes: scenario {name!r} has no [gnss]")
    check_type("estimator", estimator, str, "the id of an estimator")
    check_choice("reward", reward, tuple(REWARDS))
    constants = {
        "time_weight": check_number("time_weight", time_weight, 0.0, 1e6),
        "goal": radians(check_number("goal_deg", goal_deg, 0.0, 180.0, "deg", above=True)),
    }
    plant, kind = _commanded(found)
    task = manoeuvre_task(plant, kind, estimator, reward)
    starts = partial(InnerStarts, inner=inner_loop(plant, estimator))
    return make_setup(found, task, ranges, samples_per_step, duration_s, constants, starts)


def _commanded(scenario: Scenario) -> tuple[Model, str]:
    """The plant, and what of it is commanded: a vehicle that stays in place stands on a turntable."""
    if not scenario.vehicle.in_place:
        return plant_of(scenario)[0], scenario.vehicle.kind
    return _turntable_plant(scenario.vehicle.structure()), "turntable"


@lru_cache(maxsize=16)
def _turntable_plant(structure: Structure) -> Model:
    return plant_model(on_turntable(make_vehicle(structure)))


class ManoeuvreEnv(InertialEnv):
    """
    ## Description
    A vehicle with GNSS does not know its heading: fixes tell where it goes, not where its unit looks, until it
    accelerates, brakes or turns. The agent commands the vehicle so that the filter, built in, finds the heading soon:
    active alignment.  A vehicle that stays in place stands on a turntable, which the agent turns (indexing). Id:
    `insenv/Manoeuvre-v0`.

    ## Action Space
    `Box(-1, 1, float64)`; what is outside is taken as the nearest allowed. A car, (2,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | acceleration along the path; negative: brake, to a stop; up to 25 m/s | -1 | 1 | 3 m/s^2 |
    | 1 | acceleration across the path, right positive: a turn | -1 | 1 | 3 m/s^2 |

    An aircraft, (3,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | acceleration along the path, between 60 and 120 m/s | -1 | 1 | 2.5 m/s^2 |
    | 1 | bank of a coordinated turn, right positive | -1 | 1 | 0.7 rad |
    | 2 | rate of climb | -1 | 1 | 10 m/s |

    A car or aircraft in place, (1,):

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | angle that the turntable goes to, at 10 deg/s, clockwise | -1 | 1 | 180 deg |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` gives it by name. "Level": decimal logarithm of a value in
    SI units. The window is the time since the last step. A is the size of the action.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | time since the start | 0 | 1e6 | s |
    | 1-2 | roll and pitch, as the filter finds them | -4 | 4 | rad |
    | 3-4 | cosine and sine of the heading, likewise | -1 | 1 | 1 |
    | 5-7 | velocity, likewise, n | -1e4 | 1e4 | m/s |
    | 8-10 | position from the start as told, likewise, n | -1e7 | 1e7 | m |
    | 11-13 | levels of the stated standard deviations of the misalignment about north, east, down (rad) | -16 | 16 | 1 |
    | 14-16 | of the velocity (m/s) | -16 | 16 | 1 |
    | 17-19 | of the position (m) | -16 | 16 | 1 |
    | 20-22 | gyro bias, as the filter finds it, b | -1e3 | 1e3 | rad/s |
    | 23-25 | accelerometer bias, likewise | -1e5 | 1e5 | m/s^2 |
    | 26 | fixes in the window | 0 | 1e6 | 1 |
    | 27 | time since the epoch of the latest fix | 0 | 1e6 | s |
    | 28-30 | root mean square of their innovations: position, north, east, down | 0 | 1e6 | m |
    | 31-33 | velocity | 0 | 1e6 | m/s |
    | 34-39 | mean of their test ratios (innovation over its standard deviation as the filter sees it) | -100 | 100 | 1 |
    | 40-45 | level of the root mean square of the test ratios; 0 if the filter is right, or without fixes | -6 | 2 | 1 |
    | 46-48 | mean of the gyros in the window, b | -1e3 | 1e3 | rad/s |
    | 49-51 | standard deviation of a gyro sample | 0 | 1e3 | rad/s |
    | 52-54 | mean of the accelerometers | -1e5 | 1e5 | m/s^2 |
    | 55-57 | standard deviation of an accelerometer sample | 0 | 1e5 | m/s^2 |
    | 58 .. 57+A | the action in force | -1 | 1 | 1 |

    ## Rewards
    With k = ln of the heading's standard deviation as the filter states it (`reward="uncertainty"`), or k = ln
    sqrt(error^2 + goal^2) of the heading's true error (`reward="error"`), and T the number of steps: `(k before - k
    after) - time_weight / T`.  The sum over an episode is what has been won in all, less `time_weight` times the share
    of the time that it took. A filter that has diverged ends the episode with -10, less the time left.

    ## Starting State
    The scenario's, with a seed of its own drawn from the environment's generator; other draws as the arguments say. The
    commands of the scenario's own legs end with the first action.

    ## Episode End
    Terminated when the stated standard deviation of the heading is below the goal, or when the filter has diverged: off
    by 100 km, or no numbers. Truncated at the end of the time.

    ## Arguments
    - `scenario`: name, path, `insenv.scenario.Scenario` or mapping, of a car or aircraft with GNSS. `duration_s`: instead of
      the scenario's. `samples_per_step`: inertial samples in a step.
    - `estimator`: "aqe-ekf", "aqe-sukf" (both made for headings quite unknown) or "loosely-coupled".
    - `reward`: "uncertainty" or "error". `goal_deg`: of the heading, deg. `time_weight`: see Rewards.
    - `initial_error`: standard deviations (tilt, heading) of what is told, deg; `heading_deg`: range of the start heading, deg.
    - `imu`: a grade of `insenv list`, or "random": between the two grades `imu_range`, drawn at each reset. `sea_state`: range
      of a factor on the amplitudes of engine, wind and gusts. `gnss_outages_s`: windows, s.
    - `backend`: "native", "interpreter" or None (native if there is a compiler). `render_mode`: "rgb_array", "ansi".

    `reset(options=...)` takes imu, heading_deg, sea_state, initial_error, gnss_outages_s for one episode, and
    `run_seed`: the seed of `insenv run`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `ManoeuvreVectorEnv`, one batch: row i is the single environment reset with seed + i, to
    the bit. `autoreset_mode` NEXT_STEP or DISABLED; `threads`.

    ## Version History
    - v0: first version.
    """

    def __init__(
        self, scenario: ScenarioLike = "car-unknown-heading", *, vehicle: str = "", samples_per_step: int = 200,
        duration_s: float | None = None, imu: str | None = None, imu_range: tuple[str, str] = IMU_RANGE,
        heading_deg: Range | None = None, sea_state: Range | None = None, initial_error: Range | None = None,
        gnss_outages_s: tuple[Range, ...] | None = None, estimator: str = "aqe-ekf", reward: str = "uncertainty",
        goal_deg: float = 0.5, time_weight: float = 1.0, backend: str | None = None, render_mode: str | None = None,
    ) -> None:  # fmt: skip
        """Make the environment; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(scenario, vehicle, ranges, samples_per_step, duration_s, estimator, reward, goal_deg, time_weight)
        super().__init__(setup, backend=backend, render_mode=render_mode)


class ManoeuvreVectorEnv(InertialVectorEnv):
    """Many `ManoeuvreEnv` in one batch; takes the arguments of `ManoeuvreEnv` and of `InertialVectorEnv`."""

    def __init__(
        self, num_envs: int = 1, scenario: ScenarioLike = "car-unknown-heading", *, vehicle: str = "",
        samples_per_step: int = 200, duration_s: float | None = None, imu: str | None = None,
        imu_range: tuple[str, str] = IMU_RANGE, heading_deg: Range | None = None, sea_state: Range | None = None,
        initial_error: Range | None = None, gnss_outages_s: tuple[Range, ...] | None = None, estimator: str = "aqe-ekf",
        reward: str = "uncertainty", goal_deg: float = 0.5, time_weight: float = 1.0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, threads: int = 1, backend: str | None = None,
        render_mode: str | None = None, max_episode_steps: int | None = None,
    ) -> None:  # fmt: skip
        """Make the environments; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(scenario, vehicle, ranges, samples_per_step, duration_s, estimator, reward, goal_deg, time_weight)
        super().__init__(
            setup, num_envs, autoreset_mode=autoreset_mode, threads=threads, backend=backend, render_mode=render_mode,
            max_episode_steps=max_episode_steps,
        )  # fmt: skip
