"""The score of a filter inside an environment: its error and its NEES, evaluated between two decisions.

Every `score_samples` samples the filter's error and NEES are added to sums, which a decision clears.  The score is that of the
samples after the action.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from insenv.base.errors import InputError
from insenv.core.elementary import log, minimum, select
from insenv.core.model import Step
from insenv.core.tables import Array, Row, Table
from insenv.envs.checks import check_number, check_type, check_whole
from insenv.envs.embedded_filter import COMMON, ERROR, Inner, empty_window
from insenv.envs.setup import Arguments
from insenv.envs.starts import InnerStarts
from insenv.envs.task import DECISIONS, INVALID, NEVER, TRUTH, truth
from insenv.scenario import Scenario, ScenarioLike, prior_of

DIVERGED = 1e4
"""Root mean square of the error components, in limits, above which the filter has diverged."""
WORST_CONSISTENCY = 10.0
"""Upper bound of |ln(NEES / degrees of freedom)| in the reward."""

PARAMETERS = COMMON + Table((
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n", 1.0, lower=1e-15, upper=1e9),
    Row("consistency_weight", "Weight of the consistency in the reward", start=0.5, lower=0.0, upper=1e3),
    Row("score_samples", "Samples between evaluations of the error", start=1.0, lower=1.0, upper=1e9),
))  # fmt: skip
STATE = Table((
    NEVER,
    DECISIONS,
    INVALID,
    Row("score_count", "Samples since the last evaluation of the error"),
    Row("score_due", "1 on a sample after which the error is evaluated"),
    Row("scores", "Evaluations since the last action"),
    Row("error_square", "Sum of their squared errors", "1", (9,), "n"),
    Row("nees_sum", "Sum of their normalised estimation errors squared"),
    Row("owed", "What the steps before the last action have lost"),
))  # fmt: skip
INFO = Table((
    *TRUTH,
    ERROR,
    Row("error_rms", "Root mean square of the error since the last action", "1", (9,), "n"),
    Row("limit", "1-sigma limit of each component of the error", "1", (9,), "n"),
    Row("measure", "ln(1 + root mean square of error over limit), since the last action"),
    Row("nees", "Mean since the last action of the normalised estimation error squared"),
    Row("degrees", "Expected value of the NEES of a consistent filter: the number of components"),
    Row("consistency", "|ln(nees / degrees)|"),
    Row("diverged", "1 if the filter has diverged"),
))  # fmt: skip


def scoring_steps(inner: Inner) -> dict[str, Step]:
    """Return the steps that evaluate the filter's error between decisions."""
    return {"score_count": Step(_count), "score": Step(lambda p, x, u: _evaluate(inner, p, x), when="score_due")}


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
        "diverged": ca.logic_not(sound),
    }


LEAST_LIMIT_S = 60.0
"""A shorter episode has the limit of so long a one, s: while a vehicle stands, the limit of its velocity is some 1e-5 m/s."""
START_LIMITS = DIVERGED / 3.0
"""Root mean square of the standard deviations of the reported start, in limits, above which an episode can begin diverged."""
SCORE_INTERVAL = 1.0
"""Time between evaluations of the error, s; a shorter step is evaluated once."""


class ScoredStarts(InnerStarts):
    """`InnerStarts` of a task that is scored here.

    Raises `InputError` for a unit so good that an error of the reported start counts as a divergence.
    """

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.limit_s = max(self.duration, LEAST_LIMIT_S)

    def _limit(self, unit: Array) -> Array:
        limit, prior = super()._limit(unit), prior_of(self._section)
        start = np.concatenate([prior.attitude, prior.velocity, prior.position])
        if np.sqrt(np.mean((start / limit) ** 2)) > START_LIMITS:
            raise InputError(
                f"the inertial unit is too good for a filter that is scored by the limit: roll could be known to "
                f"{np.degrees(limit[0]):.2g} deg, and the start is reported with {np.degrees(start[0]):.2g} deg, more than "
                f"{START_LIMITS:.0f} times as much; allowed is a unit with larger errors, or a start that is better known"
            )
        return limit


@dataclass(kw_only=True, repr=False, eq=False)
class FilterInside(Arguments):
    """The arguments of all environments with a filter inside."""

    needs_gnss: ClassVar[bool] = True
    scenario: ScenarioLike = field(default="car-city-drive", kw_only=False)
    estimator: str = "loosely-coupled"
    consistency_weight: float = 0.5

    def _constants(self, scenario: Scenario) -> Mapping[str, float]:
        samples = check_whole("samples_per_step", self.samples_per_step)
        check_type("estimator", self.estimator, str, "the id of an estimator")
        return {
            "consistency_weight": check_number("consistency_weight", self.consistency_weight, 0.0, 1e3),
            "score_samples": float(max(1, min(samples, round(SCORE_INTERVAL * scenario.rate_hz)))),
        }
