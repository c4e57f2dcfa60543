"""`AlignmentEnv`, `NavigationEnv` and their vector forms: the action is the agent's estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from insenv.envs.checks import check_choice, check_number
from insenv.envs.estimation_task import estimation_task
from insenv.envs.setup import Arguments
from insenv.envs.single import InertialEnv
from insenv.envs.starts import Range
from insenv.envs.task import Task
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario, ScenarioLike, plant_of

INITIAL_ERROR = (30.0, 180.0)
"""Default standard deviations of the reported tilt and heading of an alignment, deg: vague enough that stating the report does
not pay."""
MOUNTING_DEG = 20.0
"""Default of the largest tilt with which the unit is mounted, deg: a level estimate is then no answer."""


@dataclass(kw_only=True, repr=False, eq=False)
class Alignment(Arguments):
    """The arguments and the task of `AlignmentEnv` and `AlignmentVectorEnv`."""

    needs_vehicle_in_place: ClassVar[bool] = True
    scenario: ScenarioLike = field(default="ship-swaying", kw_only=False)
    heading_deg: Range | None = (0.0, 360.0)
    initial_error: Range | None = INITIAL_ERROR
    sway_phases: bool = True
    mounting_deg: float | None = MOUNTING_DEG
    time_weight: float = 1.0
    observation: str = "samples"
    action: str = "attitude"

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        return {"time_weight": check_number("time_weight", self.time_weight, 0.0, 1e6)}

    def _task(self, scenario: Scenario) -> Task:
        check_choice("observation", self.observation, ("samples", "compact"))
        check_choice("action", self.action, ("attitude", "correction"))
        compact, corrects = self.observation == "compact", self.action == "correction"
        return estimation_task(plant_of(scenario)[0], False, _measured(scenario), compact, corrects)


@dataclass(kw_only=True, repr=False, eq=False)
class Navigation(Arguments):
    """The arguments and the task of `NavigationEnv` and `NavigationVectorEnv`."""

    needs_gnss: ClassVar[bool] = True
    scenario: ScenarioLike = field(default="car-city-drive", kw_only=False)

    def _task(self, scenario: Scenario) -> Task:
        return estimation_task(plant_of(scenario)[0], True, _measured(scenario))


def _measured(scenario: Scenario) -> tuple[str, ...]:
    """Return the outputs of the scenario's sensors other than the inertial unit and the GNSS receiver."""
    return tuple(name for id, section in scenario.sensors.items() if id != "gnss" for name in section.sensor.outputs)


@dataclass(kw_only=True, repr=False, eq=False)
class AlignmentEnv(Alignment, InertialEnv):
    """
    ## Description
    A vehicle stays in place; it may sway, shake or be loaded. The errors of its inertial unit are those of a grade. The
    agent estimates the attitude `q_nb` from the inertial samples and declares when it is aligned. Ids:
    `insenv/ShipAlignment-v0`, `insenv/VehicleAlignment-v0`, `insenv/AircraftAlignment-v0`.

    ## Action Space
    `Box(-1, 1, (5,), float64)`: the estimate at the time of the latest observation.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-3 | quaternion `q_nb` (b to n, scalar first), any norm but 0: it is normalized | -1 | 1 | 1 |
    | 4 | above 0: aligned, end the episode | -1 | 1 | 1 |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` returns it by name. N is `samples_per_step`.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 7i .. 7i+2 | gyro increment of sample i of N | -10 | 10 | rad |
    | 7i+3 .. 7i+5 | accelerometer increment of sample i | -1e4 | 1e4 | m/s |
    | 7i+6 | 0 if sample i was lost | 0 | 1 | 1 |
    | 7N | time since the start | 0 | 1e6 | s |
    | then, with GNSS: 1 | 1 if a fix arrived since the last step | 0 | 1 | 1 |
    | 1 | time since the epoch of the latest fix (`fix_age`) | 0 | 1e6 | s |
    | 1 | time from that epoch to its delivery (`fix_delay`) | 0 | 1e6 | s |
    | 3 | antenna from the reference, north, east, down | -1e8 | 1e8 | m |
    | 3 | its standard deviation | 0 | 1e8 | m |
    | 1 | 1 if the fix has a velocity | 0 | 1 | 1 |
    | 3 | velocity of the antenna | -1e5 | 1e5 | m/s |
    | 3 | its standard deviation | 0 | 1e5 | m/s |
    | then: 32 | initial knowledge: the rows `known_...` of `env.unwrapped.layout` | | | SI |

    The reference of positions is the reported start (`known_latitude`, `known_longitude`, `known_height`).

    With `observation="compact"` twelve numbers of order one replace all that: the share of the time used; ln(1 + time / 5
    s) / 4; the mean direction of gravity in the frame that the gyros keep frozen, turned by the held attitude, minus the
    expected one, north and east, on a logarithmic scale and in rad; the same for the slope of that direction, logarithmic
    and in 6.3e-5 rad/s; the reported standard deviations. With `action="correction"` the action has four components: a
    rotation vector in n by which the held attitude is turned, on a logarithmic scale (1 is 0.8, 0.8 and pi rad; the scale
    begins at 1e-5, 1e-5 and 5.8e-4 rad), and the declaration, above 0.9. The held attitude starts as reported; the gyros
    and the Earth's rotation carry it on to the present (`insenv.envs.gravity`).

    ## Rewards
    Let e be the error (the rotation vector from truth to estimate, in n), s the limit (`info["limit"]`: the smallest
    standard deviation that any method can have at the end of the time, docs/limits.md), m = `ln(1 + sqrt(mean((e /
    s)^2)))`, at most 20 (`info["measure"]`), T the number of steps and w = `time_weight`. The score of an episode is

        -(m of the last estimate) - w * (share of the time used)

    - `reward="final"`, the default: the return is the score. A step pays `-w / T`, and the last one `-(m of the last
      estimate)` too, so that no reward says anything about the error before the end.
    - `reward="dense"`, for training: a step pays `(m of the estimate before) - (m of this estimate) - w / T`, where the
      first estimate before is the reported attitude. The return is the score plus m of the reported attitude. These rewards
      reveal the error: a policy that sees them can align without looking at a sample.
    - A function `(info) -> float`: a step pays what it returns, and reveals what it uses.

    An invalid estimate (a zero quaternion, or a number that is not finite) ends the episode as if m were 20 and all the
    time were used. An episode that a wrapper cuts before its end, such as TimeLimit, lacks the last payment: `duration_s`
    shortens an episode.

    ## Starting State
    That of the scenario, with a seed from the environment's generator. By default heading, phases of the sway, mounting
    and the errors of the reported attitude are drawn, so that no constant attitude is an estimate.

    ## Episode End
    Terminated when the agent declares itself aligned or gives an invalid estimate. Truncated at the end of the time.

    ## Arguments
    - `scenario`: name, path, mapping or `insenv.scenario.Scenario`. `vehicle`: required kind of vehicle; empty: any.
    - `duration_s`: length of an episode, s; None: that of the scenario. `samples_per_step`: inertial samples per step.
    - `imu`: a grade of `insenv list`, or "random" for a draw at each reset of one of 64 units between two grades, whose
      figures are independent: `imu_range`, the better grade first; None: marine to tactical. `imu_sheet`: what the agent is
      known of a random unit: "drawn", its own data sheet, or "middle", that of the unit halfway between the grades.
    - `heading_deg`: range of the start heading, deg. `sea_state`: range of a factor on the amplitudes of waves, sway,
      engine and gusts. `initial_error`: standard deviations (tilt, heading) of the reported attitude, deg.
      `sway_phases`: whether the phases of sway, waves and engine are drawn. `mounting_deg`: roll and pitch of the mounted
      unit are drawn within plus and minus this angle, deg. None (False for the phases) keeps the scenario's value.
    - `vary`: distributions by key of the scenario, from which each episode draws values: a pair (low, high), a list of
      choices, or a text such as "lognormal(3, 0.5)" (docs/campaigns.md). `known`: which of these keys the reported knowledge
      follows: False, True or a sequence of keys.
    - `gnss_outages_s`: pairs (begin, end) of outages, s, instead of those of the scenario. `reward`, `time_weight`: see
      Rewards.
    - `observation`: "samples" or "compact". `action`: "attitude" or "correction".
    - `dtype`: "float64" or "float32", of observations and actions; the model computes with float64.
    - `backend`: "native", "interpreter" or None (native if there is a compiler). `render_mode`: "rgb_array", "ansi".

    `reset(options=...)` takes imu, heading_deg, sea_state, initial_error, sway_phases, mounting_deg, gnss_outages_s, vary
    and known for the episodes that it starts, and `run_seed`: the seed of the `insenv run` that produces the same samples;
    nothing is drawn then that the other options do not name. `env.unwrapped.set_ranges(...)` changes these arguments for all
    episodes that follow.

    ## Vectorized environment
    `gymnasium.make_vec` makes `AlignmentVectorEnv`, one batch: row i is bit-identical to the single environment reset
    with seed + i. `autoreset_mode` is NEXT_STEP, SAME_STEP or DISABLED; `threads` is the number of worker threads.

    ## Version History
    - v0: first version.
    """


@dataclass(kw_only=True, repr=False, eq=False)
class NavigationEnv(Navigation, InertialEnv):
    """
    ## Description
    A vehicle moves. The errors of its inertial unit and of its GNSS receiver are those of grades, and GNSS has outages.
    The agent estimates attitude, velocity and position. Ids: `insenv/ShipNavigation-v0`, `insenv/VehicleNavigation-v0`,
    `insenv/AircraftNavigation-v0`.

    ## Action Space
    `Box(-1, 1, (10,), float64)`: the estimate at the time of the latest observation.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-3 | quaternion `q_nb` (b to n, scalar first), any norm but 0 | -1 | 1 | 1 |
    | 4-6 | velocity, north, east, down | -1 | 1 | 1000 m/s |
    | 7-9 | position from the reference, north, east, down | -1 | 1 | 1e6 m |

    ## Observation Space
    That of `AlignmentEnv`, always with GNSS.

    ## Rewards
    Let e be the error with its nine components, s the limit (`info["limit"]`: the smallest standard deviation that any
    method can have, docs/limits.md, as root mean square over the episode, up to 600 s), m = `ln(1 + sqrt(mean((e /
    s)^2)))`, at most 20, and T the number of steps. The return of an episode is minus the mean of m over its steps. With
    `reward="final"`, the default, the last step pays all of it; with `reward="dense"` every step pays `-m / T`, which reveals
    the error of its estimate; a function of the info as for `AlignmentEnv`. An invalid estimate (a zero quaternion, or a
    number that is not finite) ends the episode and costs `20 * (share of the time left)`. Velocity and position are clipped
    to the space.

    ## Starting State
    That of the scenario, with a seed from the environment's generator; the arguments add further random draws.

    ## Episode End
    Terminated when the agent gives an invalid estimate. Truncated at the end of the time.

    ## Arguments
    Those of `AlignmentEnv` except `sway_phases`, `mounting_deg`, `observation`, `action` and `time_weight`. `heading_deg`
    and `initial_error` are None by default: those of the scenario.

    ## Vectorized environment
    `gymnasium.make_vec` makes `NavigationVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """


@dataclass(kw_only=True, repr=False, eq=False)
class AlignmentVectorEnv(Alignment, InertialVectorEnv):
    """Many `AlignmentEnv` in one batch; takes the arguments of `AlignmentEnv` and of `InertialVectorEnv`."""


@dataclass(kw_only=True, repr=False, eq=False)
class NavigationVectorEnv(Navigation, InertialVectorEnv):
    """Many `NavigationEnv` in one batch; takes the arguments of `NavigationEnv` and of `InertialVectorEnv`."""
