"""`TuningEnv`: the action tunes a filter as it runs; and its vector face."""

from __future__ import annotations

from functools import partial
from typing import Any

from insenv.envs.estimation import ScenarioLike
from insenv.envs.filter_inside import inner_loop
from insenv.envs.setup import Setup, check_samples, chosen_scenario, make_setup
from insenv.envs.single import InertialEnv
from insenv.envs.starts import IMU_RANGE, InnerStarts, Range, Ranges
from insenv.envs.tuning_task import TUNED, tuning_task
from insenv.envs.vector import FACE, InertialVectorEnv
from insenv.errors import InputError
from insenv.scenario import plant_of

LOOK_INTERVAL = 1.0
"""s from one look at the error to the next, or a step if that is shorter."""


def _setup(
    scenario: ScenarioLike,
    vehicle: str = "",
    estimator: str = "loosely-coupled",
    samples_per_step: int = 2000,
    duration_s: float | None = None,
    imu: str | None = None,
    imu_range: tuple[str, str] = IMU_RANGE,
    heading_deg: Range | None = None,
    sea_state: Range | None = None,
    initial_error: Range | None = None,
    gnss_outages_s: tuple[Range, ...] | None = None,
    decades: float = 2.0,
    mistuning_decades: float = 0.0,
    consistency_weight: float = 0.5,
) -> Setup:
    """The setup that the arguments of both faces ask for; they are explained in the class below."""
    found = chosen_scenario(scenario, vehicle)
    if found.gnss is None:
        raise InputError(f"a tuning environment needs GNSS fixes: scenario {found.name or found.title!r} has no [gnss]")
    check_samples(samples_per_step)
    numbers = (("decades", decades, 4.0), ("mistuning_decades", mistuning_decades, 4.0),
               ("consistency_weight", consistency_weight, 1e3))  # fmt: skip
    for name, value, most in numbers:
        if not 0.0 <= value <= most:
            raise InputError(f"{name} = {value!r}: allowed is a number from 0 to {most:g}")
    ranges = Ranges(imu, tuple(imu_range), heading_deg, sea_state, initial_error, gnss_outages_s)  # type: ignore[arg-type]
    plant = plant_of(found)[0]
    task = tuning_task(plant, estimator)
    constants = {
        "decades": float(decades),
        "consistency_weight": float(consistency_weight),
        "score_samples": float(max(1, min(samples_per_step, round(LOOK_INTERVAL * found.rate_hz)))),
    }
    starts = partial(InnerStarts, inner=inner_loop(plant, estimator, TUNED), mistuning=float(mistuning_decades))
    return make_setup(found, task, ranges, samples_per_step, duration_s, constants, starts)


class TuningEnv(InertialEnv):
    """
    ## Description
    A vehicle moves; a filter with GNSS, built in, navigates it. The filter's noises are those of the data sheet, which
    are not the best ones: errors of fixes wander, outliers come, sensors turn out better or worse than their sheet. The
    agent sees what the filter shows of itself and scales its noises as it runs. Id: `insenv/Tuning-v0`.

    ## Action Space
    `Box(-1, 1, (6,), float64)`: the decimal logarithm, in `decades`, of the factors on the filter's noises (standard
    deviations) from now on; with the 2 decades there are by default, factors from 1/100 to 100. 0 is the data sheet.
    What is outside is taken as the nearest allowed.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | factor on the gyros' white noise (angle random walk) | -1 | 1 | decades |
    | 1 | on the accelerometers' white noise (velocity random walk) | -1 | 1 | decades |
    | 2 | on the drive of the gyro biases | -1 | 1 | decades |
    | 3 | on the drive of the accelerometer biases | -1 | 1 | decades |
    | 4 | on the standard deviation of positions, as the receiver reports it | -1 | 1 | decades |
    | 5 | on that of velocities | -1 | 1 | decades |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` gives it by name. "Level": decimal logarithm of a value in
    SI units. The window is the time since the last step. S is the number of the filter's error states (15 for
    loosely-coupled).

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | time since the start | 0 | 1e6 | s |
    | 1 | fixes in the window | 0 | 1e6 | 1 |
    | 2 | time since the epoch of the latest fix | 0 | 1e6 | s |
    | 3-5 | root mean square of their innovations: position, north, east, down | 0 | 1e6 | m |
    | 6-8 | velocity | 0 | 1e6 | m/s |
    | 9-14 | mean of their test ratios (innovation over its standard deviation as the filter sees it) | -100 | 100 | 1 |
    | 15-20 | level of the root mean square of the test ratios; 0 if the filter is right, or without fixes | -6 | 2 | 1 |
    | 21-23 | mean of the gyros in the window, b | -1e3 | 1e3 | rad/s |
    | 24-26 | standard deviation of a gyro sample | 0 | 1e3 | rad/s |
    | 27-29 | mean of the accelerometers | -1e5 | 1e5 | m/s^2 |
    | 30-32 | standard deviation of an accelerometer sample | 0 | 1e5 | m/s^2 |
    | 33-38 | levels of the standard deviations that the receiver reports: position (m), velocity (m/s) | -16 | 16 | 1 |
    | 39 .. 38+S | levels of the filter's standard deviations, the roots of its covariance's diagonal; loosely-coupled: position (m), velocity (m/s), attitude (rad), gyro bias (rad/s), accelerometer bias (m/s^2) | -16 | 16 | 1 |
    | last 6 | the action in force | -1 | 1 | decades |

    ## Rewards
    The filter's error e (rotation vector, velocity, position, in n) and its normalised estimation error squared, e^T
    P^-1 e of position, velocity and attitude in the filter's own definition, are looked at every second of the window.
    With s the limit (`info["limit"]`: root mean square of what the covariance of the untuned 15-state filter says over
    the scenario, and for position the part of the fixes' error that cannot be averaged), T the number of steps and n
    the components compared (9),

        measure = ln(1 + sqrt(mean of (e / s)^2 over components and looks))
        consistency = |ln(mean of e^T P^-1 e over looks / n)|, at most 10
        reward = -(measure + consistency_weight * consistency) / T

    Of a filter that knows its errors e^T P^-1 e has a chi-square distribution and the mean n; in a window its
    consistency is not 0 but that distribution's scatter, some 0.4 where the looks of the window are correlated
    throughout.  A filter that has diverged ends the episode with the worst of all for the time left.

    ## Starting State
    The scenario's, with a seed of its own drawn from the environment's generator; other draws as the arguments say.

    ## Episode End
    Terminated when the filter has diverged: errors of 10,000 limits, or no numbers. Truncated at the end of the time.

    ## Arguments
    - `scenario`: name, path, `insenv.scenario.Scenario` or mapping, with GNSS. `duration_s`: instead of the scenario's.
    - `estimator`: "loosely-coupled", "aqe-ekf" or "aqe-sukf". `samples_per_step`: inertial samples in a step.
    - `decades`: what an action of 1 is. `mistuning_decades`: if above 0, at each reset what the filter is told of its noises
      is made wrong by factors of 10^u, u uniform within plus and minus that: 0 is then no longer the data sheet.
    - `consistency_weight`: see Rewards.
    - `imu`: a grade of `insenv list`, or "random": between the two grades `imu_range`, drawn at each reset.
    - `heading_deg`: range of the start heading, deg. `sea_state`: range of a factor on the amplitudes of waves, sway, engine
      and gusts. `initial_error`: standard deviations (tilt, heading) of what is told, deg. `gnss_outages_s`: windows,
      s.
    - `backend`: "native", "interpreter" or None (native if there is a compiler). `render_mode`: "rgb_array", "ansi".

    `reset(options=...)` takes imu, heading_deg, sea_state, initial_error, gnss_outages_s for one episode, and
    `run_seed`: the seed of `insenv run`, which then makes the same samples.

    ## Vectorized environment
    `gymnasium.make_vec` makes `TuningVectorEnv`, one batch: row i is the single environment reset with seed + i, to the
    bit.  `autoreset_mode` NEXT_STEP or DISABLED; `threads`.

    ## Version History
    - v0: first version.
    """  # noqa: E501

    def __init__(
        self,
        scenario: ScenarioLike = "car-city-drive",
        *,
        backend: str | None = None,
        render_mode: str | None = None,
        **given: Any,
    ) -> None:
        super().__init__(_setup(scenario, **given), backend, render_mode)


class TuningVectorEnv(InertialVectorEnv):
    """Many `TuningEnv` at once: its arguments, and those of `InertialVectorEnv`."""

    def __init__(self, num_envs: int = 1, scenario: ScenarioLike = "car-city-drive", **given: Any) -> None:
        face = {name: given.pop(name) for name in FACE if name in given}
        super().__init__(_setup(scenario, **given), num_envs, **face)
