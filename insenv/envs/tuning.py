"""`TuningEnv`: the action scales the noises of a filter while it runs.

One decision consists of the step ``act``, which sets the factors, and then of the inertial samples.  The score is that of
`insenv.envs.filter_score`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import casadi as ca

from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs import filter_score
from insenv.envs.checks import check_number
from insenv.envs.embedded_filter import (
    SCALED,
    STATISTICS,
    Inner,
    inner_loop,
    log10,
    power10,
    statistics,
    window_part,
    within,
)
from insenv.envs.filter_score import FilterInside, ScoredStarts, next_decision, scored, scoring_steps
from insenv.envs.single import InertialEnv
from insenv.envs.task import CLOCK, RESULT, Task, finite_action
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario, plant_of

TUNED = (
    "angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma", "gnss_position_sigma",
    "gnss_velocity_sigma",
)  # fmt: skip
"""Parameters and inputs of the filter that an action scales, in the order of its components."""

ACTION = Row("log_scale", f"Logarithm of the factors on {', '.join(TUNED)}, in `decades`", "1", (6,), lower=-1.0, upper=1.0)
SCALING = Table((
    Row("decades", "Decimal logarithm of the factor for an action of 1", start=2.0, lower=0.0, upper=4.0),
))  # fmt: skip
_MISTUNING = Row("mistuning", "Decimal logarithm of the factors for an action of 0", "1", (6,), lower=-4.0, upper=4.0)
_NOW = Row("log_scale_now", "The action in force", "1", (6,))
_GNSS_LEVEL = Row("gnss_level", "Decimal logarithm of the standard deviations that the receiver reports: position (m), velocity"
                  " (m/s)", "1", (6,), "n", lower=-16.0, upper=16.0)  # fmt: skip
INFO = filter_score.INFO + Table((Row("scale", f"Factors in force on {', '.join(TUNED)}", "1", (6,)),))


@lru_cache(maxsize=16)
def tuning_task(plant: Model, estimator: str) -> Task:
    """Return the task of tuning a filter of a plant.  Raises `InputError` for one that cannot be tuned."""
    inner = inner_loop(plant, estimator, TUNED)
    sigma = Row("sigma_level", "Decimal logarithm of the filter's standard deviations, in the order of its states", "1",
                (inner.states,), lower=-16.0, upper=16.0)  # fmt: skip
    action = Row("log_scale_now", "The action in force", "1", (6,), lower=-1.0, upper=1.0)
    observation = Table((CLOCK,)) + STATISTICS + Table((_GNSS_LEVEL, sigma, action))
    act = lambda p, x, u: _act(inner, p, x, u)  # noqa: E731
    parameters, state = filter_score.PARAMETERS + SCALING + Table((_MISTUNING,)), filter_score.STATE + Table((_NOW,))
    score = Part(parameters, state, Table((ACTION,)), {**scoring_steps(inner), "act": Step(act, when="never")})

    def output(p: Any, x: Any) -> dict[str, Any]:
        reported = ca.vertcat(x.gnss_position_sigma, x.gnss_velocity_sigma)
        seen = {
            "time": x.time,
            **statistics(p, x),
            "gnss_level": log10(reported),
            "sigma_level": log10(inner.sigma(x)),
            "log_scale_now": x.log_scale_now,
        }
        return within(observation, seen) | scored(inner, p, x) | {"scale": getattr(x, SCALED)}

    title = f"{inner.model.title}: tuning"
    model = merge(
        f"{inner.model.id}-tuning", title, [as_part(inner.model), window_part(), score], observation + RESULT + INFO, output
    )
    return Task(model, Table((ACTION,)), Table(), observation, INFO, judge="act")


def _act(inner: Inner, p: Any, x: Any, u: Any) -> dict[str, Any]:
    finite, values = finite_action(u.log_scale)
    action = clamp(values, -1.0, 1.0)
    factors = power10(p.decades * action + p.mistuning)
    return {"invalid": ca.logic_not(finite), SCALED: factors, "log_scale_now": action, **next_decision(inner, p, x)}


@dataclass(kw_only=True, repr=False, eq=False)
class FilterTuning(FilterInside):
    """The arguments of all environments in which an agent tunes a filter."""

    decades: float = 2.0

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        return {"decades": check_number("decades", self.decades, 0.0, 4.0), **super()._constants(scenario)}


@dataclass(kw_only=True, repr=False, eq=False)
class Tuning(FilterTuning):
    """The arguments and the task of `TuningEnv` and `TuningVectorEnv`."""

    drawn: ClassVar[tuple[str, ...]] = ("mistuning_decades",)
    samples_per_step: int = 2000
    mistuning_decades: float = 1.5

    def _task(self, scenario: Scenario) -> Task:
        check_number("mistuning_decades", self.mistuning_decades, 0.0, 4.0)
        return tuning_task(plant_of(scenario)[0], self.estimator)

    def _starts(self, scenario: Scenario, *rest: Any) -> ScoredStarts:
        return ScoredStarts(scenario, *rest, estimator=self.estimator, mistuning=float(self.mistuning_decades))


@dataclass(kw_only=True, repr=False, eq=False)
class TuningEnv(Tuning, InertialEnv):
    """
    ## Description
    A vehicle moves and a built-in filter navigates it with GNSS. The filter's noise parameters are those of the data
    sheet. They are not optimal: fix errors are correlated in time, there are outliers, and a unit may be better or
    worse than its data sheet. The agent observes the statistics of the filter and scales its noises while it runs. Id:
    `insenv/Tuning-v0`.

    ## Action Space
    `Box(-1, 1, (6,), float64)`: the decimal logarithms, in units of `decades`, of the factors on the filter's noises
    (standard deviations) until the next step. With the default of 2 decades the factors are from 1/100 to 100; 0 is the
    data sheet, times the factors of the mistuning. Actions outside the space are clipped to it; one that is not finite ends
    the episode as a divergence.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | factor on the gyro white noise (angle random walk) | -1 | 1 | decades |
    | 1 | factor on the accelerometer white noise (velocity random walk) | -1 | 1 | decades |
    | 2 | factor on the driving noise of the gyro biases | -1 | 1 | decades |
    | 3 | factor on the driving noise of the accelerometer biases | -1 | 1 | decades |
    | 4 | factor on the standard deviation of positions that the receiver reports | -1 | 1 | decades |
    | 5 | factor on the standard deviation of velocities that the receiver reports | -1 | 1 | decades |

    ## Observation Space
    `Box(float64)`, flat; `env.unwrapped.named(observation)` returns it by name. "Level" is the decimal logarithm of a
    value in SI units. The window is the time since the last step. S is the number of the filter's error states (15 for
    loosely-coupled).

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | time since the start | 0 | 1e6 | s |
    | 1 | fixes in the window | 0 | 1e6 | 1 |
    | 2 | time since the epoch of the latest fix | 0 | 1e6 | s |
    | 3-5 | root mean square of the position innovations, north, east, down | 0 | 1e6 | m |
    | 6-8 | root mean square of the velocity innovations | 0 | 1e6 | m/s |
    | 9-14 | mean test ratios (innovation over the standard deviation that the filter predicts) | -100 | 100 | 1 |
    | 15-20 | level of the root mean square of the test ratios; 0 for a consistent filter, and without fixes | -6 | 2 | 1 |
    | 21-23 | mean of the gyros in the window, b | -1e3 | 1e3 | rad/s |
    | 24-26 | standard deviation of a gyro sample | 0 | 1e3 | rad/s |
    | 27-29 | mean of the accelerometers | -1e5 | 1e5 | m/s^2 |
    | 30-32 | standard deviation of an accelerometer sample | 0 | 1e5 | m/s^2 |
    | 33-38 | levels of the standard deviations that the receiver reports: position (m), velocity (m/s) | -16 | 16 | 1 |
    | 39 .. 38+S | levels of the filter's standard deviations in the order of its states; loosely-coupled: position (m), velocity (m/s), attitude (rad), gyro bias (rad/s), accelerometer bias (m/s^2) | -16 | 16 | 1 |
    | last 6 | the action in force | -1 | 1 | decades |

    ## Rewards
    The filter's error e (rotation vector, velocity, position, in n) and its normalised estimation error squared (NEES),
    `e^T P^-1 e` of position, velocity and attitude as the filter defines its errors, are evaluated every second of the
    window. Let s be the limit (`info["limit"]`: the smallest standard deviation that any method can have, docs/limits.md,
    as root mean square over the episode, up to 600 s; of an episode below 60 s, over 60 s), T the number of steps and n = 9
    the number of components. Then

        measure = ln(1 + sqrt(mean of (e / s)^2 over components and evaluations))
        consistency = |ln(mean NEES over evaluations / n)|, at most 10
        gain = -(measure + consistency_weight * consistency) / T

    With `reward="final"`, the default, the last step pays the gains of all steps, and the others pay nothing; with
    `reward="dense"`, for training, every step pays its own, which reveals the filter's error and NEES; a function of the info
    as for `AlignmentEnv`.

    The NEES of a consistent filter has a chi-square distribution with mean n. Its consistency measure over a window is
    not 0 because of the scatter of that distribution; it is about 0.4 where the evaluations of a window are fully
    correlated. Divergence ends the episode with the lowest gain for the time left.

    ## Starting State
    That of the scenario, with a seed from the environment's generator; the arguments add further random draws.

    ## Episode End
    Terminated when the filter diverges: errors above 10,000 limits, or NaN. Truncated at the end of the time.

    ## Arguments
    - `scenario`: as for `AlignmentEnv`, with GNSS. `estimator`: "loosely-coupled", "aqe-ekf" or "aqe-sukf".
    - `decades`: decimal logarithm of the factor for an action of 1. `consistency_weight`, `reward`: see
      Rewards.
    - `mistuning_decades`: if above 0, as by default, the filter's noises are wrong by factors 10^u, with u drawn at each
      reset from a uniform distribution between plus and minus that value. With 0 an action of 0 is the data sheet, and there
      is little to learn.
    - All others, and the options of `reset`: as for `AlignmentEnv`, without `sway_phases`, `mounting_deg`, `time_weight`,
      `observation` and `action`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `TuningVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """  # noqa: E501


@dataclass(kw_only=True, repr=False, eq=False)
class TuningVectorEnv(Tuning, InertialVectorEnv):
    """Many `TuningEnv` in one batch; takes the arguments of `TuningEnv` and of `InertialVectorEnv`."""
