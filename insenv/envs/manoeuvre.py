"""`ManoeuvreEnv`: the action moves the vehicle so that its heading becomes known; and its vector face."""

from __future__ import annotations

from functools import lru_cache, partial
from math import radians
from typing import Any

from insenv.core.model import Model
from insenv.envs.commands import COMMANDS
from insenv.envs.estimation import ScenarioLike
from insenv.envs.filter_inside import inner_loop
from insenv.envs.manoeuvre_task import REWARDS, manoeuvre_task
from insenv.envs.setup import Setup, chosen_scenario, make_setup
from insenv.envs.single import InertialEnv
from insenv.envs.starts import IMU_RANGE, InnerStarts, Range, Ranges
from insenv.envs.vector import FACE, InertialVectorEnv
from insenv.errors import InputError
from insenv.plant import plant_model
from insenv.scenario import Scenario, plant_of
from insenv.scenario.legs import Structure
from insenv.scenario.vehicles import make_vehicle
from insenv.vehicles.turntable import on_turntable


def _setup(
    scenario: ScenarioLike,
    vehicle: str = "",
    estimator: str = "aqe-ekf",
    reward: str = "uncertainty",
    goal_deg: float = 0.5,
    samples_per_step: int = 200,
    duration_s: float | None = None,
    imu: str | None = None,
    imu_range: tuple[str, str] = IMU_RANGE,
    heading_deg: Range | None = None,
    sea_state: Range | None = None,
    initial_error: Range | None = None,
    gnss_outages_s: tuple[Range, ...] | None = None,
    time_weight: float = 1.0,
) -> Setup:
    """The setup that the arguments of both faces ask for; they are explained in the class below."""
    found = chosen_scenario(scenario, vehicle)
    name = found.name or found.title
    if found.vehicle.kind not in COMMANDS:
        raise InputError(f"a manoeuvre environment needs a car or an aircraft: scenario {name!r} has a {found.vehicle.kind}")
    if found.gnss is None:
        raise InputError(f"a manoeuvre environment needs GNSS fixes: scenario {name!r} has no [gnss]")
    if reward not in REWARDS:
        raise InputError(f"reward = {reward!r}: allowed are {', '.join(map(repr, REWARDS))}")
    if not 0.0 < goal_deg <= 180.0:
        raise InputError(f"goal_deg = {goal_deg!r} deg: allowed is a number above 0 up to 180")
    if not 0.0 <= time_weight <= 1e6:
        raise InputError(f"time_weight = {time_weight!r}: allowed is a number from 0 to 1e6")
    ranges = Ranges(imu, tuple(imu_range), heading_deg, sea_state, initial_error, gnss_outages_s)  # type: ignore[arg-type]
    plant, kind = _commanded(found)
    task = manoeuvre_task(plant, kind, estimator, reward)
    constants = {"time_weight": float(time_weight), "goal": radians(goal_deg)}
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
        self,
        scenario: ScenarioLike = "car-unknown-heading",
        *,
        backend: str | None = None,
        render_mode: str | None = None,
        **given: Any,
    ) -> None:
        super().__init__(_setup(scenario, **given), backend, render_mode)


class ManoeuvreVectorEnv(InertialVectorEnv):
    """Many `ManoeuvreEnv` at once: its arguments, and those of `InertialVectorEnv`."""

    def __init__(self, num_envs: int = 1, scenario: ScenarioLike = "car-unknown-heading", **given: Any) -> None:
        face = {name: given.pop(name) for name in FACE if name in given}
        super().__init__(_setup(scenario, **given), num_envs, **face)
