"""`AlignmentEnv` and `NavigationEnv`: the action is the agent's estimate; and their vector faces."""

from __future__ import annotations

from gymnasium.vector import AutoresetMode

from insenv.envs.checks import check_number
from insenv.envs.estimation_task import estimation_task
from insenv.envs.setup import ScenarioLike, Setup, chosen_scenario, make_setup
from insenv.envs.single import InertialEnv
from insenv.envs.starts import IMU_RANGE, Range, Ranges
from insenv.envs.vector import InertialVectorEnv
from insenv.errors import InputError
from insenv.scenario import plant_of


def _setup(
    navigates: bool, scenario: ScenarioLike, vehicle: str, ranges: Ranges, samples_per_step: int, duration_s: float | None,
    time_weight: float = 1.0,
) -> Setup:  # fmt: skip
    """Return the setup for the arguments of the classes below."""
    found = chosen_scenario(scenario, vehicle)
    if not navigates and not found.vehicle.in_place:
        raise InputError(f"an alignment environment needs a vehicle in place: that of {found.name or found.title!r} moves")
    constants = {"time_weight": check_number("time_weight", time_weight, 0.0, 1e6)}
    return make_setup(found, estimation_task(plant_of(found)[0], navigates), ranges, samples_per_step, duration_s, constants)


class AlignmentEnv(InertialEnv):
    """
    ## Description
    A vehicle stays in place, sways, shakes, or is loaded; its inertial unit has the errors of its grade. The agent
    finds the attitude `q_nb` from the inertial samples, and says when it is aligned. Ids: `insenv/ShipAlignment-v0`,
    `insenv/VehicleAlignment-v0`, `insenv/AircraftAlignment-v0`.

    ## Action Space
    `Box(-1, 1, (5,), float64)`: the estimate at the time of the observation just seen.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-3 | quaternion `q_nb` (b to n, scalar first), of any length but 0 | -1 | 1 | 1 |
    | 4 | above 0: aligned, end the episode | -1 | 1 | 1 |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` gives it by name. N is `samples_per_step`.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 7i .. 7i+2 | gyro increment of sample i of N | -10 | 10 | rad |
    | 7i+3 .. 7i+5 | accelerometer increment of sample i | -1e4 | 1e4 | m/s |
    | 7i+6 | 0 if sample i was lost | 0 | 1 | 1 |
    | 7N | time since the start | 0 | 1e6 | s |
    | then, with GNSS: 1 | a fix came since the last step | 0 | 1 | 1 |
    | 1 | time since the epoch of the latest fix (`fix_age`) | 0 | 1e6 | s |
    | 1 | time from that epoch to its delivery (`fix_delay`) | 0 | 1e6 | s |
    | 3 | antenna from the reference, north, east, down | -1e8 | 1e8 | m |
    | 3 | its standard deviation | 0 | 1e8 | m |
    | 1 | the fix has a velocity | 0 | 1 | 1 |
    | 3 | velocity of the antenna | -1e5 | 1e5 | m/s |
    | 3 | its standard deviation | 0 | 1e5 | m/s |
    | then: 32 | what is told of the start and of the sensors: the rows `known_...` of `env.unwrapped.layout` | | | SI |

    The reference of positions is the start as told (`known_latitude`, `known_longitude`, `known_height`).

    ## Rewards
    With error e (the rotation vector from truth to estimate, in n), limit s (`info["limit"]`: what biases and white
    noise leave at the end of the time, 1 sigma), `m = ln(1 + sqrt(mean((e / s)^2)))`, at most 20, and T the number of
    steps: every step gives `-(time_weight + m) / T`, and the step that ends the episode `-m` more. Garbage (no
    quaternion, or outside the space) ends it with the worst of all: `-20 - (time_weight + 20) * (share of the time
    left)`.

    ## Starting State
    The scenario's, with a seed of its own drawn from the environment's generator; other draws as the arguments say.

    ## Episode End
    Terminated when the agent declares itself aligned, or has diverged (garbage). Truncated at the end of the time.

    ## Arguments
    - `scenario`: name, path, `insenv.scenario.Scenario` or mapping. `duration_s`: instead of the scenario's.
    - `samples_per_step`: inertial samples in a step.
    - `imu`: a grade of `insenv list`, or "random": between the two grades `imu_range`, drawn at each reset.
    - `heading_deg`: range of the start heading, deg. `sea_state`: range of a factor on the amplitudes of waves, sway, engine
      and gusts. `initial_error`: standard deviations (tilt, heading) of what is told, deg. `gnss_outages_s`: windows,
      s.
    - `time_weight`: see Rewards.
    - `backend`: "native", "interpreter" or None (native if there is a compiler). `render_mode`: "rgb_array", "ansi".

    `reset(options=...)` takes imu, heading_deg, sea_state, initial_error, gnss_outages_s for one episode, and
    `run_seed`: the seed of `insenv run`, which then makes the same samples. `gymnasium.make(..., max_episode_steps=)`
    truncates earlier, without the last step's part of the reward.

    ## Vectorized environment
    `gymnasium.make_vec` makes `AlignmentVectorEnv`, one batch: row i is the single environment reset with seed + i, to
    the bit.  `autoreset_mode` NEXT_STEP or DISABLED; `threads`.

    ## Version History
    - v0: first version.
    """

    def __init__(
        self, scenario: ScenarioLike = "ship-swaying", *, vehicle: str = "", samples_per_step: int = 100,
        duration_s: float | None = None, imu: str | None = None, imu_range: tuple[str, str] = IMU_RANGE,
        heading_deg: Range | None = None, sea_state: Range | None = None, initial_error: Range | None = None,
        gnss_outages_s: tuple[Range, ...] | None = None, time_weight: float = 1.0, backend: str | None = None,
        render_mode: str | None = None,
    ) -> None:  # fmt: skip
        """Make the environment; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(False, scenario, vehicle, ranges, samples_per_step, duration_s, time_weight)
        super().__init__(setup, backend=backend, render_mode=render_mode)


class NavigationEnv(InertialEnv):
    """
    ## Description
    A vehicle moves; its inertial unit and its GNSS receiver have the errors of their grades, fixes fail in outages. The
    agent tracks attitude, velocity and position. Ids: `insenv/ShipNavigation-v0`, `insenv/VehicleNavigation-v0`,
    `insenv/AircraftNavigation-v0`.

    ## Action Space
    `Box(-1, 1, (10,), float64)`: the estimate at the time of the observation just seen.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-3 | quaternion `q_nb` (b to n, scalar first), of any length but 0 | -1 | 1 | 1 |
    | 4-6 | velocity, north, east, down | -1 | 1 | 1000 m/s |
    | 7-9 | position from the reference, north, east, down | -1 | 1 | 1e6 m |

    ## Observation Space
    That of `AlignmentEnv`, always with GNSS.

    ## Rewards
    With error e of the nine components, limit s (`info["limit"]`: root mean square of what the covariance of the
    15-state filter says over the scenario, and for position the part of the fixes' error that cannot be averaged), `m =
    ln(1 + sqrt(mean((e / s)^2)))`, at most 20, and T the number of steps: every step gives `-m / T`. Garbage ends the
    episode with -20 for all the time left.

    ## Starting State
    The scenario's, with a seed of its own drawn from the environment's generator; other draws as the arguments say.

    ## Episode End
    Terminated when the agent has diverged (garbage). Truncated at the end of the time.

    ## Arguments
    Those of `AlignmentEnv` but `time_weight`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `NavigationVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """

    def __init__(
        self, scenario: ScenarioLike = "car-city-drive", *, vehicle: str = "", samples_per_step: int = 100,
        duration_s: float | None = None, imu: str | None = None, imu_range: tuple[str, str] = IMU_RANGE,
        heading_deg: Range | None = None, sea_state: Range | None = None, initial_error: Range | None = None,
        gnss_outages_s: tuple[Range, ...] | None = None, backend: str | None = None, render_mode: str | None = None,
    ) -> None:  # fmt: skip
        """Make the environment; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(True, scenario, vehicle, ranges, samples_per_step, duration_s)
        super().__init__(setup, backend=backend, render_mode=render_mode)


class AlignmentVectorEnv(InertialVectorEnv):
    """Many `AlignmentEnv` in one batch; takes the arguments of `AlignmentEnv` and of `InertialVectorEnv`."""

    def __init__(
        self, num_envs: int = 1, scenario: ScenarioLike = "ship-swaying", *, vehicle: str = "",
        samples_per_step: int = 100, duration_s: float | None = None, imu: str | None = None,
        imu_range: tuple[str, str] = IMU_RANGE, heading_deg: Range | None = None, sea_state: Range | None = None,
        initial_error: Range | None = None, gnss_outages_s: tuple[Range, ...] | None = None, time_weight: float = 1.0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, threads: int = 1, backend: str | None = None,
        render_mode: str | None = None, max_episode_steps: int | None = None,
    ) -> None:  # fmt: skip
        """Make the environments; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(False, scenario, vehicle, ranges, samples_per_step, duration_s, time_weight)
        super().__init__(
            setup, num_envs, autoreset_mode=autoreset_mode, threads=threads, backend=backend, render_mode=render_mode,
            max_episode_steps=max_episode_steps,
        )  # fmt: skip


class NavigationVectorEnv(InertialVectorEnv):
    """Many `NavigationEnv` in one batch; takes the arguments of `NavigationEnv` and of `InertialVectorEnv`."""

    def __init__(
        self, num_envs: int = 1, scenario: ScenarioLike = "car-city-drive", *, vehicle: str = "",
        samples_per_step: int = 100, duration_s: float | None = None, imu: str | None = None,
        imu_range: tuple[str, str] = IMU_RANGE, heading_deg: Range | None = None, sea_state: Range | None = None,
        initial_error: Range | None = None, gnss_outages_s: tuple[Range, ...] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, threads: int = 1, backend: str | None = None,
        render_mode: str | None = None, max_episode_steps: int | None = None,
    ) -> None:  # fmt: skip
        """Make the environments; see the class for the arguments.  Raises `InputError` for one that is not allowed."""
        ranges = Ranges(imu, imu_range, heading_deg, sea_state, initial_error, gnss_outages_s)
        setup = _setup(True, scenario, vehicle, ranges, samples_per_step, duration_s)
        super().__init__(
            setup, num_envs, autoreset_mode=autoreset_mode, threads=threads, backend=backend, render_mode=render_mode,
            max_episode_steps=max_episode_steps,
        )  # fmt: skip
