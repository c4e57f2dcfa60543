"""The task of tuning a filter as it runs: the action is the logarithm of factors on its noises.

A round is: the step ``act``, which sets the factors and begins new sums, then the samples, behind which error and NEES
of the filter are taken every `score_samples` samples.  The score is that of the samples that the action acted on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

from insenv.core.compose import Part, as_part, merge
from insenv.core.elementary import clamp, log, minimum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.envs.filter_inside import COMMON, ERROR, SCALED, Inner, inner_loop, log10, power10, within
from insenv.envs.task import CLOCK, DECISIONS, NEVER, RESULT, TRUTH, Task, truth
from insenv.envs.window import SHOWN, begun, shown, window_part

TUNED = (
    "angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma", "gnss_position_sigma",
    "gnss_velocity_sigma",
)  # fmt: skip
"""What an action scales: parameters and inputs of the filter, in its order."""
DIVERGED = 1e4
"""Limits, root mean square of the error's components, beyond which the filter has diverged."""
WORST_CONSISTENCY = 10.0
"""Largest value of |ln(NEES / degrees of freedom)| that counts."""

ACTION = Row("log_scale", f"Logarithm of the factors on {', '.join(TUNED)}, in `decades`", "1", (6,), lower=-1.0, upper=1.0)
_PARAMETERS = COMMON + Table((
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n", 1.0, lower=1e-15, upper=1e9),
    Row("decades", "Decimal logarithm of the factor that an action of 1 is", start=2.0, lower=0.0, upper=4.0),
    Row("mistuning", "Decimal logarithm of the factors that an action of 0 is", "1", (6,), lower=-4.0, upper=4.0),
    Row("consistency_weight", "Weight of the consistency in the reward", start=0.5, lower=0.0, upper=1e3),
    Row("score_samples", "Samples from one look at the error to the next", start=1.0, lower=1.0, upper=1e9),
))  # fmt: skip
_STATE = Table((
    NEVER,
    DECISIONS,
    Row("log_scale_now", "The action in force", "1", (6,)),
    Row("score_count", "Samples since the last look at the error"),
    Row("score_due", "1 on a sample after which the error is looked at"),
    Row("scores", "Looks since the last action"),
    Row("error_square", "Sum of their squared errors", "1", (9,), "n"),
    Row("nees_sum", "Sum of their normalised estimation errors squared"),
))  # fmt: skip
_GNSS_LEVEL = Row("gnss_level", "Decimal logarithm of the standard deviations that the receiver reports: position (m), velocity"
                  " (m/s)", "1", (6,), "n", lower=-16.0, upper=16.0)  # fmt: skip
_INFO = Table((
    *TRUTH,
    ERROR,
    Row("error_rms", "Root mean square of the error since the last action", "1", (9,), "n"),
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n"),
    Row("measure", "ln(1 + root mean square of error over limit), since the last action"),
    Row("nees", "Mean since the last action of the normalised estimation error squared"),
    Row("degrees", "Its expectation if the filter is consistent: the components compared"),
    Row("consistency", "|ln(nees / degrees)|"),
    Row("scale", f"Factors in force on {', '.join(TUNED)}", "1", (6,)),
    Row("diverged", "1 if the filter has diverged"),
))  # fmt: skip


@lru_cache(maxsize=16)
def tuning_task(plant: Model, estimator: str) -> Task:
    """The task of tuning the filter `estimator` behind a plant.  Raises `InputError` for one that cannot be tuned."""
    inner = inner_loop(plant, estimator, TUNED)
    sigma = Row("sigma_level", "Decimal logarithm of the filter's standard deviations, in the order of its states", "1",
                (inner.states,), lower=-16.0, upper=16.0)  # fmt: skip
    action = Row("log_scale_now", "The action in force", "1", (6,), lower=-1.0, upper=1.0)
    observation = Table((CLOCK,)) + SHOWN + Table((_GNSS_LEVEL, sigma, action))
    score = Part(
        parameters=_PARAMETERS,
        state=_STATE,
        inputs=Table((ACTION,)),
        steps={
            "score_count": Step(_count),
            "score": Step(lambda p, x, u: _look(inner, p, x), when="score_due"),
            "act": Step(_act, when="never"),
        },
    )

    def output(p: Any, x: Any) -> dict[str, Any]:
        reported = ca.vertcat(x.gnss_position_sigma, x.gnss_velocity_sigma)
        seen = {
            "time": x.time,
            **shown(p, x),
            "gnss_level": log10(reported),
            "sigma_level": log10(inner.sigma(x)),
            "log_scale_now": x.log_scale_now,
        }
        return within(observation, seen) | _scored(inner, p, x)

    title = f"{inner.model.title}: tuning"
    model = merge(
        f"{inner.model.id}-tuning", title, [as_part(inner.model), window_part(), score], observation + RESULT + _INFO, output
    )
    return Task(model, Table((ACTION,)), Table(), observation, _INFO, judge="act", starts_from_knowledge=True)


def _act(p: Any, x: Any, u: Any) -> dict[str, Any]:
    action = clamp(u.log_scale, -1.0, 1.0)
    return {
        SCALED: power10(p.decades * action + p.mistuning),
        "log_scale_now": action,
        "decisions": x.decisions + 1.0,
        "score_count": 0.0,
        "scores": 0.0,
        "error_square": ca.SX.zeros(9),
        "nees_sum": 0.0,
        **begun(),
    }


def _count(p: Any, x: Any, u: Any) -> dict[str, Any]:
    count = x.score_count + 1.0
    due = count >= p.score_samples
    return {"score_count": select(due, 0.0, count), "score_due": due}


def _look(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    error = inner.error(p, x)
    return {
        "scores": x.scores + 1.0,
        "error_square": x.error_square + error * error,
        "nees_sum": x.nees_sum + inner.nees(p, x)[0],
    }


def _scored(inner: Inner, p: Any, x: Any) -> dict[str, Any]:
    """Reward, ends, and the rows of the info."""
    looks = select(x.scores > 0.0, x.scores, 1.0)
    square = x.error_square / looks
    ratio = ca.sumsqr(ca.sqrt(square) / p.limit) / 9.0
    sound = ca.logic_and(ratio >= 0.0, ratio <= DIVERGED**2)  # neither holds of what is no number
    measure = log(1.0 + ca.sqrt(select(sound, ratio, DIVERGED**2)))
    degrees = float(inner.nees(p, x)[1])
    nees = x.nees_sum / looks
    share = nees / degrees
    decent = ca.logic_and(share > 1e-12, share < 1e12)
    consistency = select(decent, minimum(ca.fabs(log(select(decent, share, 1.0))), WORST_CONSISTENCY), WORST_CONSISTENCY)

    each = 1.0 / p.decision_limit
    left = 1.0 - (x.decisions - 1.0) * each  # share of the time left, this decision included
    worst = log(1.0 + DIVERGED) + p.consistency_weight * WORST_CONSISTENCY
    paid = each * (measure + p.consistency_weight * consistency)
    last = x.decisions >= p.decision_limit
    error = inner.error(p, x)
    fine = ca.sumsqr(error) <= 1e30
    return {
        "reward": -select(sound, paid, left * worst),
        "terminated": ca.logic_not(sound),
        "truncated": ca.logic_and(last, sound),
        **truth(p, x),
        "error": select(fine, error, 0.0),
        "error_rms": select(sound, ca.sqrt(square), DIVERGED * p.limit),
        "limit": p.limit,
        "measure": measure,
        "nees": select(decent, nees, 0.0),
        "degrees": degrees,
        "consistency": consistency,
        "scale": getattr(x, SCALED),
        "diverged": ca.logic_not(sound),
    }
