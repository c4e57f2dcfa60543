"""`CorrectionEnv`: the action takes errors out of the estimate of a filter while its instruments fail.

The score is that of `insenv.envs.filter_score`, the plant that of `insenv.envs.faults`.  An action of 0 changes no bit of the
filter; its covariance is never changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs import fault_tuning, filter_score
from insenv.envs.checks import check_number
from insenv.envs.embedded_filter import LARGEST_RATIO, Inner, inner_loop, log10, window_part, within
from insenv.envs.faults import FAULTS, Faulty
from insenv.envs.filter_score import next_decision, scored, scoring_steps
from insenv.envs.single import InertialEnv
from insenv.envs.task import RESULT, Task, finite_action
from insenv.envs.vector import InertialVectorEnv
from insenv.scenario import Scenario

SPEED = 30.0
"""m/s for an observed velocity of 1."""

ACTION = Row("correction", "Error taken out of the estimate, in `reach` times the filter's sigma: rotation vector, velocity,"
             " position", "1", (9,), "n", lower=-1.0, upper=1.0)  # fmt: skip
_REACH = Row("reach", "Standard deviations of the filter for an action of 1", start=3.0, lower=0.0, upper=1e3)
_DRIFT = Row("ratio_drift", "Running mean of the test ratios", "1", (6,), "n")
OBSERVED = Table((
    *(fault_tuning.OBSERVED[name] for name in ("fixes", "age_level", "ratio")),
    Row("drift", "The same of the running mean over about 20 fixes", "1", (6,), "n", lower=-1.0, upper=1.0),
    *(fault_tuning.OBSERVED[name] for name in ("trend_level", "sigma_level", "attitude_level", "gyro_level", "accel_level")),
    Row("velocity", f"Estimated velocity in {SPEED:g} m/s", "1", (3,), "n", lower=-100.0, upper=100.0),
))  # fmt: skip
_INFO = Table((
    *filter_score.INFO,
    Row("sigma", "Standard deviations of the filter's error, in its order", "1", (9,), "n"),
    Row("fault_now", f"1 in the window of {', '.join(FAULTS)}", "1", (5,)),
))  # fmt: skip


@lru_cache(maxsize=16)
def correction_task(plant: Model, estimator: str) -> Task:
    """Return the task of correcting a filter of a faulty plant.  Raises `InputError` for a filter that takes no correction."""
    inner = inner_loop(plant, estimator, correctable=True)
    steps = {
        "trend": Step(fault_tuning.trend, when="gnss_valid"),
        "ratio_drift": Step(_drift, when="gnss_valid"),
        **scoring_steps(inner),
        "act": Step(lambda p, x, u: _act(inner, p, x, u), when="never"),
    }
    state = filter_score.STATE + Table((fault_tuning.TREND, _DRIFT))
    score = Part(filter_score.PARAMETERS + Table((_REACH,)), state, Table((ACTION,)), steps)

    def output(p: Any, x: Any) -> dict[str, Any]:
        info = {"sigma": _sigma(inner, p, x), "fault_now": x.fault_now}
        return within(OBSERVED, _observed(inner, p, x)) | scored(inner, p, x) | info

    parts = [as_part(inner.model), window_part(), score]
    model = merge(f"{inner.model.id}-correction", f"{inner.model.title}: correction", parts, OBSERVED + RESULT + _INFO, output)
    return Task(model, Table((ACTION,)), Table(), OBSERVED, _INFO, judge="act")


def _sigma(inner: Inner, p: Any, x: Any) -> Any:
    """Return the standard deviations of `ERROR` that the filter states."""
    stated = inner.outputs(p, x)
    return ca.vertcat(stated.attitude_sigma, stated.velocity_sigma, stated.position_sigma)


def _act(inner: Inner, p: Any, x: Any, u: Any) -> dict[str, Any]:
    finite, values = finite_action(u.correction)
    action = clamp(values, -1.0, 1.0)
    corrected = inner.without(p, x, p.reach * action * _sigma(inner, p, x))
    some = ca.sumsqr(action) > 0.0  # taking out nothing would round
    rows = {name: select(some, value, getattr(x, name)) for name, value in corrected.items()}
    return {"invalid": ca.logic_not(finite), **rows, **next_decision(inner, p, x)}


def _drift(p: Any, x: Any, u: Any) -> dict[str, Any]:
    ratio = clamp(x.estimator_test_ratio, -LARGEST_RATIO, LARGEST_RATIO)
    return {"ratio_drift": x.ratio_drift + fault_tuning.FORGETTING * (ratio - x.ratio_drift)}


def _observed(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    sigma, reported = _sigma(inner, p, x), ca.vertcat(x.gnss_position_sigma, x.gnss_velocity_sigma)
    return fault_tuning.observed(inner, p, x) | {
        "drift": x.ratio_drift / (1.0 + ca.fabs(x.ratio_drift)),
        "sigma_level": log10(ca.vertcat(sigma[6:9], sigma[3:6]) / reported),
        "attitude_level": log10(sigma[:3] * 1e3),
        "velocity": inner.outputs(p, x).velocity_n / SPEED,
    }


@dataclass(kw_only=True, repr=False, eq=False)
class Correction(Faulty):
    """The arguments and the task of `CorrectionEnv` and `CorrectionVectorEnv`."""

    consistency_weight: float = 0.0
    reach: float = 3.0

    def _task(self, scenario: Scenario) -> Task:
        return correction_task(self._plant(scenario), self.estimator)

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        return {"reach": check_number("reach", self.reach, 0.0, 1e3), **super()._constants(scenario)}


@dataclass(kw_only=True, repr=False, eq=False)
class CorrectionEnv(Correction, InertialEnv):
    """
    ## Description
    A vehicle moves and a built-in filter navigates it with GNSS, with the instruments of `FaultTuningEnv`: worse than their
    data sheets, and failing for a while. At each step (a second at 200 samples/s) the agent observes what the filter holds,
    and takes errors out of its estimate. What it takes out is gone for good: the filter goes on from there. Id:
    `insenv/Correction-v0`.

    ## Action Space
    `Box(-1, 1, (9,), float64)`: the error of the estimate (estimate minus truth, in n) that is taken out, in units of `reach`
    times the standard deviation that the filter states for it now. 0 is the filter of `insenv run`, to the bit; actions outside
    the space are clipped to it; one that is not finite ends the episode as a divergence. The covariance of the filter is not
    changed.

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0-2 | attitude, rotation vector about north, east, down | -1 | 1 | `reach` sigma |
    | 3-5 | velocity, north, east, down | -1 | 1 | `reach` sigma |
    | 6-8 | position, north, east, down | -1 | 1 | `reach` sigma |

    ## Observation Space
    `Box(float64)`, flat, of order one; `env.unwrapped.named(observation)` returns it by name. "Level" is a decimal
    logarithm. The window is the time since the last step. Rows of six are position, then velocity, each north, east, down:
    the order of a fix, and not that of the action.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | fixes in the window | 0 | 10 | 1 |
    | 1 | level of 1 s plus the time since the epoch of the latest fix | 0 | 6 | 1 |
    | 2-7 | mean test ratio r (innovation over its standard deviation), as r / (1 + abs(r)) | -1 | 1 | 1 |
    | 8-13 | the same of a running mean over about 20 fixes | -1 | 1 | 1 |
    | 14-19 | level of the rms test ratio over about 20 fixes; 0 for a consistent filter | -3 | 3 | 1 |
    | 20-25 | level of the filter's standard deviation over the reported one | -3 | 3 | 1 |
    | 26-28 | level of the filter's standard deviation of the attitude in mrad | -3 | 4 | 1 |
    | 29-31 | level of the scatter of the gyros over the white noise of the data sheet | -3 | 3 | 1 |
    | 32-34 | the same of the accelerometers | -3 | 3 | 1 |
    | 35-37 | estimated velocity, north, east, down | -100 | 100 | 30 m/s |

    ## Rewards
    Those of `TuningEnv`, with a `consistency_weight` of 0 by default: minus the mean of m. `info["error"]` is the error of the
    estimate now and `info["sigma"]` what the filter states for it, both in the order of the action; `info["fault_now"]` says
    which faults hold (street, jamming, drag, vibration, stuck axis). No fault begins in the first 20 s.

    ## Starting State
    That of `FaultTuningEnv`. With the option `run_seed` instruments are those of the scenario, without faults.

    ## Episode End
    That of `TuningEnv`.

    ## Arguments
    - `reach`: standard deviations of the filter for an action of 1. A filter with fixes of centimetres states so little that a
      drag is thousands of its standard deviations: a larger reach is needed there. `estimator`: "loosely-coupled".
    - `spread_decades`, `faults`, `duration_s`: as for `FaultTuningEnv`. All others, and the options of `reset`: as for
      `TuningEnv`, without `decades` and `mistuning_decades`.

    ## Vectorized environment
    `gymnasium.make_vec` makes `CorrectionVectorEnv`, as for `AlignmentEnv`.

    ## Version History
    - v0: first version.
    """


@dataclass(kw_only=True, repr=False, eq=False)
class CorrectionVectorEnv(Correction, InertialVectorEnv):
    """Many `CorrectionEnv` in one batch; takes the arguments of `CorrectionEnv` and of `InertialVectorEnv`."""
