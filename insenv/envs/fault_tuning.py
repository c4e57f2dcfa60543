"""`FaultTuningEnv`: instruments are worse than their data sheets and fail for a while; the action sets noises, gate and trust.

The decision is that of `insenv.envs.tuning`, the score that of `insenv.envs.filter_score`; the plant is that of
`insenv.envs.faults`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, maximum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs import filter_score
from insenv.envs.embedded_filter import (
    LARGEST_RATIO,
    SCALE,
    SCALED,
    Inner,
    inner_loop,
    log10,
    power10,
    statistics,
    window_part,
    within,
)
from insenv.envs.faults import FAULTS, NOISES, Faulty
from insenv.envs.filter_score import next_decision, scored, scoring_steps
from insenv.envs.single import InertialEnv
from insenv.envs.task import RESULT, Task, finite_action
from insenv.envs.tuning import SCALING, TUNED, FilterTuning
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario

SET = (*TUNED, "innovation_gate")
"""Parameters and inputs of the filter on which an action sets factors, in the order of its components."""
MISTRUSTED = 1e4
"""Factor on the reported standard deviation of what is not trusted."""
FORGETTING = 0.05
"""Weight of the latest fix in the running mean of the squared test ratios."""

ACTIONS = Table((
    Row("log_scale", f"Logarithm of the factors on {', '.join(SET)}, in `decades`", "1", (7,), lower=-1.0, upper=1.0),
    Row("trust", "Below 0: positions, velocities of fixes are not used", "1", (2,), lower=-1.0, upper=1.0),
))  # fmt: skip
_NOW = Row("action_now", "The action in force", "1", (9,), lower=-1.0, upper=1.0)
TREND = Row("ratio_trend", "Running mean of the squared test ratios", "1", (6,), "n", start=1.0)
OBSERVED = Table((
    Row("fixes", "Fixes since the last step", "1", lower=0.0, upper=10.0),
    Row("age_level", "Decimal logarithm of 1 s plus the time since the epoch of the latest fix", "1", lower=0.0, upper=6.0),
    Row("ratio", "Mean test ratio r as r / (1 + |r|)", "1", (6,), "n", lower=-1.0, upper=1.0),
    Row("ratio_level", "Decimal logarithm of the rms test ratio; 0 without fixes", "1", (6,), "n", lower=-3.0, upper=3.0),
    Row("trend_level", "Decimal logarithm of the rms test ratio over about 20 fixes", "1", (6,), "n", lower=-3.0, upper=3.0),
    Row("innovation_level", "Decimal logarithm of the rms innovation over the reported sigma; 0 without fixes", "1", (6,), "n",
        lower=-3.0, upper=3.0),
    Row("gyro_level", "Decimal logarithm of the scatter of the gyros over the white noise of the data sheet", "1", (3,), "b",
        lower=-3.0, upper=3.0),
    Row("accel_level", "The same of the accelerometers", "1", (3,), "b", lower=-3.0, upper=3.0),
    Row("sigma_level", "Decimal logarithm of the filter's sigma over the reported one: position, velocity", "1", (6,), "n",
        lower=-3.0, upper=3.0),
    Row("attitude_level", "Decimal logarithm of the filter's sigma of the attitude in mrad", "1", (3,), "n",
        lower=-3.0, upper=4.0),
    _NOW,
))  # fmt: skip
_INFO = Table((
    *filter_score.INFO,
    Row("scale", f"Factors in force on {', '.join(SET)}", "1", (7,)),
    Row("true_scale", f"Factors on the true {', '.join(NOISES)}", "1", (4,)),
    Row("fault_now", f"1 in the window of {', '.join(FAULTS)}", "1", (5,)),
))  # fmt: skip


@lru_cache(maxsize=16)
def fault_tuning_task(plant: Model, estimator: str) -> Task:
    """Return the task of tuning a filter of a faulty plant.  Raises `InputError` for a filter that cannot be tuned."""
    inner = inner_loop(plant, estimator, SET)
    steps = {
        "trend": Step(trend, when="gnss_valid"),
        **scoring_steps(inner),
        "act": Step(lambda p, x, u: _act(inner, p, x, u), when="never"),
    }
    score = Part(filter_score.PARAMETERS + SCALING, filter_score.STATE + Table((_NOW, TREND)), ACTIONS, steps)

    def output(p: Any, x: Any) -> dict[str, Any]:
        info = {"scale": getattr(x, SCALED), "true_scale": getattr(x, SCALE), "fault_now": x.fault_now}
        return within(OBSERVED, observed(inner, p, x) | {"action_now": x.action_now}) | scored(inner, p, x) | info

    parts = [as_part(inner.model), window_part(), score]
    model = merge(f"{inner.model.id}-tuning", f"{inner.model.title}: tuning", parts, OBSERVED + RESULT + _INFO, output)
    return Task(model, ACTIONS, Table(), OBSERVED, _INFO, judge="act")


def _act(inner: Inner, p: Any, x: Any, u: Any) -> dict[str, Any]:
    finite, values = finite_action(ca.vertcat(u.log_scale, u.trust))
    action = clamp(values, -1.0, 1.0)
    ignored = select(action[7:] < 0.0, MISTRUSTED, 1.0)
    trust = ca.vertcat(1.0, 1.0, 1.0, 1.0, ignored, 1.0)
    factors = power10(p.decades * action[:7]) * trust
    return {"invalid": ca.logic_not(finite), SCALED: factors, "action_now": action, **next_decision(inner, p, x)}


def trend(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Return the value of `TREND` after a fix."""
    ratio = clamp(x.estimator_test_ratio, -LARGEST_RATIO, LARGEST_RATIO)
    return {"ratio_trend": x.ratio_trend + FORGETTING * (ratio * ratio - x.ratio_trend)}


def observed(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    """Return the values of `OBSERVED` but the action, not yet clipped to their bounds."""
    seen, reported, sigma = statistics(p, x), ca.vertcat(x.gnss_position_sigma, x.gnss_velocity_sigma), inner.sigma(x)
    mean, some, root = seen["test_ratio_mean"], x.window_fixes > 0.0, ca.sqrt(p.sample_interval)
    return {
        "fixes": x.window_fixes,
        "age_level": log10(1.0 + maximum(seen["fix_age"], 0.0)),
        "ratio": mean / (1.0 + ca.fabs(mean)),
        "ratio_level": seen["test_ratio_level"],
        "trend_level": 0.5 * log10(x.ratio_trend),
        "innovation_level": select(some, log10(seen["innovation_rms"] / reported), 0.0),
        "gyro_level": log10(seen["rate_deviation"] * root / p.known_angle_random_walk),
        "accel_level": log10(seen["force_deviation"] * root / p.known_velocity_random_walk),
        "sigma_level": log10(sigma[:6] / reported),
        "attitude_level": log10(sigma[6:9] * 1e3),
    }


@dataclass(kw_only=True, repr=False, eq=False)
class FaultTuning(Faulty, FilterTuning):
    """The arguments and the task of `FaultTuningEnv` and `FaultTuningVectorEnv`."""

    def _task(self, scenario: Scenario) -> Task:
        return fault_tuning_task(self._plant(scenario), self.estimator)


@dataclass(kw_only=True, repr=False, eq=False)
class FaultTuningEnv(FaultTuning, InertialEnv):
    """
    ## Description
    A vehicle moves and a built-in filter navigates it with GNSS. The true noises of its inertial unit and of its receiver are
    not those of their data sheets, and both fail for a while: between houses the noise of the fixes grows, jammed it grows
    much more, a spoofed signal draws the positions away, vibration adds to the noise of the unit, an axis is stuck. The
    receiver reports the standard deviations of its data sheet throughout. Once a second the agent observes innovations, test
    ratios and the scatter of the samples, and sets noises and gate of the filter and whether it uses positions and velocities.
    Id: `insenv/FaultTuning-v0`.

    ## Action Space
    `Box(-1, 1, (9,), float64)`. 0 is the filter of `insenv run`; actions outside the space are clipped to it; one that is not
    finite ends the episode as a divergence.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-5 | logarithms of the factors on the filter's noises, as for `TuningEnv` | -1 | 1 | decades |
    | 6 | logarithm of the factor on the gate of the innovations | -1 | 1 | decades |
    | 7 | below 0: positions of fixes are not used | -1 | 1 | 1 |
    | 8 | below 0: velocities of fixes are not used | -1 | 1 | 1 |

    ## Observation Space
    `Box(float64)`, flat, of order one; `env.unwrapped.named(observation)` returns it by name. "Level" is a decimal
    logarithm. The window is the time since the last step.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | fixes in the window | 0 | 10 | 1 |
    | 1 | level of 1 s plus the time since the epoch of the latest fix | 0 | 6 | 1 |
    | 2-7 | mean test ratio r of positions and velocities, as r / (1 + abs(r)) | -1 | 1 | 1 |
    | 8-13 | level of the rms test ratio; 0 for a consistent filter, and without fixes | -3 | 3 | 1 |
    | 14-19 | the same of a running mean over about 20 fixes | -3 | 3 | 1 |
    | 20-25 | level of the rms innovation over the reported standard deviation; 0 without fixes | -3 | 3 | 1 |
    | 26-28 | level of the scatter of the gyros over the white noise of the data sheet; -3 for an axis without scatter | -3 | 3 | 1 |
    | 29-31 | the same of the accelerometers | -3 | 3 | 1 |
    | 32-37 | level of the filter's standard deviation over the reported one: position, velocity | -3 | 3 | 1 |
    | 38-40 | level of the filter's standard deviation of the attitude in mrad | -3 | 4 | 1 |
    | 41-49 | the action in force | -1 | 1 | 1 |

    ## Rewards
    Those of `TuningEnv`. `info["fault_now"]` says which faults hold (street, jamming, drag, vibration, stuck axis),
    `info["true_scale"]` the factors on the true noises.

    ## Starting State
    That of the scenario, with a seed from the environment's generator. Factors and windows are drawn at each reset
    (`insenv.envs.faults`): after 20 s an episode has three parts of equal length, and in each of them every fault has one window
    with a probability of 0.5. With the option `run_seed` instruments are those of the scenario, without faults.

    ## Episode End
    That of `TuningEnv`.

    ## Arguments
    - `spread_decades`: the true noises and biases are those of the data sheets times 10^u, with u drawn from a uniform
      distribution between plus and minus that value. `faults`: whether instruments fail.
    - `duration_s`: 240 s by default. `decades`, `consistency_weight`, `estimator` ("loosely-coupled"), and all others: as for
      `TuningEnv`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `FaultTuningVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """  # noqa: E501


@dataclass(kw_only=True, repr=False, eq=False)
class FaultTuningVectorEnv(FaultTuning, InertialVectorEnv):
    """Many `FaultTuningEnv` in one batch; takes the arguments of `FaultTuningEnv` and of `InertialVectorEnv`."""
