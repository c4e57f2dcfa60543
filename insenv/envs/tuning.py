"""`TuningEnv`: the action scales the noises of a filter while it runs.

One decision consists of the step ``act``, which sets the factors and clears the sums, and then of the inertial
samples.  Every `score_samples` samples the filter's error and NEES are added to the sums.  The score is that of the
samples after the action.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import casadi as ca

from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, minimum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs.checks import check_number, check_type, check_whole
from insenv.envs.embedded_filter import (
    COMMON,
    ERROR,
    SCALED,
    STATISTICS,
    Inner,
    empty_window,
    inner_loop,
    log10,
    power10,
    statistics,
    window_part,
    within,
)
from insenv.envs.setup import Arguments
from insenv.envs.single import InertialEnv
from insenv.envs.starts import InnerStarts
from insenv.envs.task import CLOCK, DECISIONS, INVALID, NEVER, RESULT, TRUTH, Task, finite_action, truth
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario, ScenarioLike, plant_of

TUNED = (
    "angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma", "gnss_position_sigma",
    "gnss_velocity_sigma",
)  # fmt: skip
"""Parameters and inputs of the filter that an action scales, in the order of its components."""
DIVERGED = 1e4
"""Root mean square of the error components, in limits, above which the filter has diverged."""
WORST_CONSISTENCY = 10.0
"""Upper bound of |ln(NEES / degrees of freedom)| in the reward."""

ACTION = Row("log_scale", f"Logarithm of the factors on {', '.join(TUNED)}, in `decades`", "1", (6,), lower=-1.0, upper=1.0)
PARAMETERS = COMMON + Table((
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n", 1.0, lower=1e-15, upper=1e9),
    Row("decades", "Decimal logarithm of the factor for an action of 1", start=2.0, lower=0.0, upper=4.0),
    Row("mistuning", "Decimal logarithm of the factors for an action of 0", "1", (6,), lower=-4.0, upper=4.0),
    Row("consistency_weight", "Weight of the consistency in the reward", start=0.5, lower=0.0, upper=1e3),
    Row("score_samples", "Samples between evaluations of the error", start=1.0, lower=1.0, upper=1e9),
))  # fmt: skip
STATE = Table((
    NEVER,
    DECISIONS,
    INVALID,
    Row("log_scale_now", "The action in force", "1", (6,)),
    Row("score_count", "Samples since the last evaluation of the error"),
    Row("score_due", "1 on a sample after which the error is evaluated"),
    Row("scores", "Evaluations since the last action"),
    Row("error_square", "Sum of their squared errors", "1", (9,), "n"),
    Row("nees_sum", "Sum of their normalised estimation errors squared"),
    Row("owed", "What the steps before the last action have lost"),
))  # fmt: skip
_GNSS_LEVEL = Row("gnss_level", "Decimal logarithm of the standard deviations that the receiver reports: position (m), velocity"
                  " (m/s)", "1", (6,), "n", lower=-16.0, upper=16.0)  # fmt: skip
INFO = Table((
    *TRUTH,
    ERROR,
    Row("error_rms", "Root mean square of the error since the last action", "1", (9,), "n"),
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n"),
    Row("measure", "ln(1 + root mean square of error over limit), since the last action"),
    Row("nees", "Mean since the last action of the normalised estimation error squared"),
    Row("degrees", "Expected value of the NEES of a consistent filter: the number of components"),
    Row("consistency", "|ln(nees / degrees)|"),
    Row("scale", f"Factors in force on {', '.join(TUNED)}", "1", (6,)),
    Row("diverged", "1 if the filter has diverged"),
))  # fmt: skip


@lru_cache(maxsize=16)
def tuning_task(plant: Model, estimator: str) -> Task:
    """Return the task of tuning a filter of a plant.  Raises `InputError` for one that cannot be tuned."""
    inner = inner_loop(plant, estimator, TUNED)
    sigma = Row("sigma_level", "Decimal logarithm of the filter's standard deviations, in the order of its states", "1",
                (inner.states,), lower=-16.0, upper=16.0)  # fmt: skip
    action = Row("log_scale_now", "The action in force", "1", (6,), lower=-1.0, upper=1.0)
    observation = Table((CLOCK,)) + STATISTICS + Table((_GNSS_LEVEL, sigma, action))
    act = lambda p, x, u: _act(inner, p, x, u)  # noqa: E731
    score = Part(PARAMETERS, STATE, Table((ACTION,)), {**scoring_steps(inner), "act": Step(act, when="never")})

    def output(p: Any, x: Any) -> dict[str, Any]:
        reported = ca.vertcat(x.gnss_position_sigma, x.gnss_velocity_sigma)
        seen = {
            "time": x.time,
            **statistics(p, x),
            "gnss_level": log10(reported),
            "sigma_level": log10(inner.sigma(x)),
            "log_scale_now": x.log_scale_now,
        }
        return within(observation, seen) | scored(inner, p, x)

    title = f"{inner.model.title}: tuning"
    model = merge(
        f"{inner.model.id}-tuning", title, [as_part(inner.model), window_part(), score], observation + RESULT + INFO, output
    )
    return Task(model, Table((ACTION,)), Table(), observation, INFO, judge="act")


def scoring_steps(inner: Inner) -> dict[str, Step]:
    """Return the steps that evaluate the filter's error between decisions."""
    return {"score_count": Step(_count), "score": Step(lambda p, x, u: _evaluate(inner, p, x), when="score_due")}


def _act(inner: Inner, p: Any, x: Any, u: Any) -> dict[str, Any]:
    finite, values = finite_action(u.log_scale)
    action = clamp(values, -1.0, 1.0)
    factors = power10(p.decades * action + p.mistuning)
    return {"invalid": ca.logic_not(finite), SCALED: factors, "log_scale_now": action, **next_decision(inner, p, x)}


def next_decision(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    """Return the state rows with which the evaluations of a decision begin; what those of the last one have lost is owed."""
    return {
        "decisions": x.decisions + 1.0,
        "score_count": 0.0,
        "scores": 0.0,
        "error_square": ca.SX.zeros(9),
        "nees_sum": 0.0,
        "owed": x.owed + select(x.decisions > 0.0, _window(inner, p, x).lost, 0.0),
        **empty_window(),
    }


def _count(p: Any, x: Any, u: Any) -> dict[str, Any]:
    count = x.score_count + 1.0
    due = count >= p.score_samples
    return {"score_count": select(due, 0.0, count), "score_due": due}


def _evaluate(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    error = inner.error(p, x)
    return {
        "scores": x.scores + 1.0,
        "error_square": x.error_square + error * error,
        "nees_sum": x.nees_sum + inner.nees(p, x)[0],
    }


@dataclass(frozen=True)
class _Window:
    """What the evaluations since the last action say, as expressions; lost: of the reward."""

    sound: Any
    square: Any
    measure: Any
    nees: Any
    consistency: Any
    lost: Any


def _window(inner: Inner, p: Any, x: Any) -> _Window:
    evaluations = select(x.scores > 0.0, x.scores, 1.0)
    square = x.error_square / evaluations
    ratio = ca.sumsqr(ca.sqrt(square) / p.limit) / 9.0
    sound = ca.logic_and(ca.logic_not(x.invalid), ca.logic_and(ratio >= 0.0, ratio <= DIVERGED**2))  # false for NaN
    measure = log(1.0 + ca.sqrt(select(sound, ratio, DIVERGED**2)))
    nees = x.nees_sum / evaluations
    share = nees / float(inner.nees(p, x)[1])
    decent = ca.logic_and(share > 1e-12, share < 1e12)
    consistency = select(decent, minimum(ca.fabs(log(select(decent, share, 1.0))), WORST_CONSISTENCY), WORST_CONSISTENCY)

    each = 1.0 / p.decision_limit
    left = 1.0 - (x.decisions - 1.0) * each  # share of the time left, this decision included
    worst = log(1.0 + DIVERGED) + p.consistency_weight * WORST_CONSISTENCY
    paid = each * (measure + p.consistency_weight * consistency)
    return _Window(sound, square, measure, select(decent, nees, 0.0), consistency, select(sound, paid, left * worst))


def scored(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    """Return the values of `RESULT` and of the info."""
    window, last = _window(inner, p, x), x.decisions >= p.decision_limit
    sound, error = window.sound, inner.error(p, x)
    fine = ca.sumsqr(error) <= 1e30
    over = ca.logic_or(last, ca.logic_not(sound))
    return {
        "reward": -select(p.dense, window.lost, select(over, x.owed + window.lost, 0.0)),
        "terminated": ca.logic_not(sound),
        "truncated": ca.logic_and(last, sound),
        **truth(p, x),
        "error": select(fine, error, 0.0),
        "error_rms": select(sound, ca.sqrt(window.square), DIVERGED * p.limit),
        "limit": p.limit,
        "measure": window.measure,
        "nees": window.nees,
        "degrees": float(inner.nees(p, x)[1]),
        "consistency": window.consistency,
        "scale": getattr(x, SCALED),
        "diverged": ca.logic_not(sound),
    }


SCORE_INTERVAL = 1.0
"""Time between evaluations of the error, s; a shorter step is evaluated once."""


@dataclass(kw_only=True, repr=False, eq=False)
class FilterTuning(Arguments):
    """The arguments of all environments in which an agent tunes a filter."""

    needs_gnss: ClassVar[bool] = True
    scenario: ScenarioLike = field(default="car-city-drive", kw_only=False)
    estimator: str = "loosely-coupled"
    decades: float = 2.0
    consistency_weight: float = 0.5

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        samples = check_whole("samples_per_step", self.samples_per_step)
        check_type("estimator", self.estimator, str, "the id of an estimator")
        return {
            "decades": check_number("decades", self.decades, 0.0, 4.0),
            "consistency_weight": check_number("consistency_weight", self.consistency_weight, 0.0, 1e3),
            "score_samples": float(max(1, min(samples, round(SCORE_INTERVAL * scenario.rate_hz)))),
        }


@dataclass(kw_only=True, repr=False, eq=False)
class Tuning(FilterTuning):
    """The arguments and the task of `TuningEnv` and `TuningVectorEnv`."""

    samples_per_step: int = 2000
    mistuning_decades: float = 1.5

    def _task(self, scenario: Scenario) -> Task:
        check_number("mistuning_decades", self.mistuning_decades, 0.0, 4.0)
        return tuning_task(plant_of(scenario)[0], self.estimator)

    def _starts(self, scenario: Scenario, *rest: Any) -> InnerStarts:
        return InnerStarts(scenario, *rest, estimator=self.estimator, mistuning=float(self.mistuning_decades))


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
    as root mean square over the scenario, up to 600 s), T the number of steps and n = 9 the number of components. Then

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
    - All others, and the options of `reset`: as for `AlignmentEnv`, without `time_weight`, `observation` and `action`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `TuningVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """  # noqa: E501


@dataclass(kw_only=True, repr=False, eq=False)
class TuningVectorEnv(Tuning, InertialVectorEnv):
    """Many `TuningEnv` in one batch; takes the arguments of `TuningEnv` and of `InertialVectorEnv`."""
