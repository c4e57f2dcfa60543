"""Tuning of a filter on a recorded log, by its innovations; no reference is needed.

Before each fix the filter states the standard deviations of its position and velocity.  With those of the receiver they predict
the innovation y_i of every component, with the variance S_i, and the fix shows it.  The objective is the negative mean
logarithm of that predictive density,

    J = mean of  min(y_i^2 / S_i, LARGEST) / 2 + ln(S_i) / 2,

a proper score (Gneiting and Raftery 2007): only the right variances minimise it on average, so that neither overconfidence nor
pessimism pays.  Components are taken one by one, and the lever arm's part in S is left out.  A fix far off counts as one at
LARGEST.  Factors are fitted to the first half of the log and evaluated on the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.remarks import clock, remark
from insenv.core.batch import make_batch
from insenv.core.runner import Progress
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.estimators.settings import Settings
from insenv.evaluation.nis import NOTABLE
from insenv.logs import RecordedLog
from insenv.runs.replayed import Prepared, prepared, replay
from insenv.scenario.inputs import input_rows
from insenv.sensors.gnss import COMMON
from insenv.studies.campaign.running import cores
from insenv.studies.campaign.statistics import Estimate, student
from insenv.studies.tune_result import Channel, Tuning
from insenv.studies.tune_search import FAILED, Parameter, search, tuned_parameters

LARGEST = 25.0
"""Largest y^2 / S that counts: five standard deviations."""
UNSETTLED = 0.1
"""Share of the fixes at the start that do not count: the filter converges."""
LEAST_FIXES = 40
BLOCKS = 10
"""Blocks of the second half whose means are taken as independent."""
SLOW = "fix_wander_sigma"
"""Sigma of the slow part of the error of a fix, which innovations do not show."""
NEEDED = ("innovation", "position_sigma", "velocity_sigma")


@dataclass(frozen=True)
class Fixes:
    """The fixes of a log as a filter with factors on its parameters is given them.

    samples (fixes,): numbers of the samples with which they arrive; sigma (fixes, 6): stated by the receiver, m and m/s; NaN
    for a velocity that is not there.
    """

    ready: Prepared
    parameters: tuple[Parameter, ...]
    samples: NDArray[np.int64]
    sigma: Array

    def scores(self, factors: Array, until: int) -> tuple[Array, Array]:
        """Scores and squares y^2 / S (n, fixes, 6) of the fixes before number `until`, for sets of factors (n, parameters)."""
        estimator, n = self.ready.chosen[0], len(factors)
        table, outputs = estimator.model.parameters, estimator.model.outputs
        start = self.ready.starts[0].knowledge
        rows = np.tile(table.pack(estimator.parameters(start, rows=self.ready.parameter_rows[estimator.id])), (n, 1))
        if COMMON.name in table:  # what fixes have in common with the estimate is not between them
            rows[:, table.slice(COMMON.name)] = 0.0
        for k, parameter in enumerate(self.parameters):
            for row, each in enumerate(factors):
                rows[row, table.slice(parameter.row.name)] = parameter.value(each[k])
        batch = make_batch(estimator.model, n, rows, threads=min(cores(), n))
        position, velocity, innovation = (outputs.slice(name) for name in ("position_sigma", "velocity_sigma", "innovation"))
        predicted, seen, done = np.empty((n, until, 6)), np.empty((n, until, 6)), 0
        for k, sample in enumerate(self.samples[:until].tolist()):
            if sample > done:
                self._advance(batch, done, sample, n)
            before = batch.output()
            predicted[:, k] = np.concatenate([before[:, position], before[:, velocity]], axis=1)
            self._advance(batch, sample, sample + 1, n)
            seen[:, k], done = batch.output()[:, innovation], sample + 1
        variance = predicted**2 + self.sigma[:until] ** 2
        squares = seen**2 / variance
        return 0.5 * np.minimum(squares, LARGEST) + 0.5 * np.log(variance), squares

    def _advance(self, batch: object, first: int, last: int, n: int) -> None:
        model = self.ready.chosen[0].model
        part = {name: column[first:last] for name, column in self.ready.columns.items()}
        rows = input_rows(model, part, last - first)
        batch.run(last - first, np.broadcast_to(rows, (n, *rows.shape)))  # type: ignore[attr-defined]


def tune_log(
    source: object,
    estimator: str | Estimator,
    keys: Sequence[str] | None,
    evaluations: int,
    settings: Settings | None,
    progress: Progress | None,
) -> Tuning:
    """`insenv.studies.tune.tune` on a log."""
    ready = prepared(source, [estimator], settings=settings)  # type: ignore[arg-type]
    chosen = ready.chosen[0]
    lacking = [name for name in NEEDED if name not in chosen.model.outputs]
    if lacking or "gnss_valid" not in ready.columns:
        what = f"{chosen.id!r} has no output {lacking[0]!r}" if lacking else "the log has no fixes"
        raise InputError(f"tuning on a log compares fixes with what the filter predicts: {what}")
    samples = np.flatnonzero(ready.columns["gnss_valid"] != 0.0)
    if len(samples) < LEAST_FIXES:
        raise InputError(f"{len(samples)} fixes: tuning on a log needs at least {LEAST_FIXES}")
    table = chosen.model.parameters
    present = table.unpack(table.pack(chosen.parameters(ready.starts[0].knowledge, rows=ready.parameter_rows[chosen.id])))
    fixes = Fixes(ready, tuned_parameters(chosen, present, keys, but=(SLOW,)), samples, _sigma(ready, samples))
    half, count = len(samples) // 2, len(fixes.parameters)
    first = max(1, round(UNSETTLED * half))

    def means(factors: Array, until: int, since: int) -> tuple[Array, Array]:
        scores, squares = fixes.scores(factors, until)
        with np.errstate(all="ignore"):
            return np.nanmean(scores[:, since:], axis=(1, 2)), np.nanmean(squares[:, since:], axis=(1, 2))

    base = float(means(np.ones((1, count)), half, first)[0][0])
    if not np.isfinite(base):
        raise InputError(f"estimator {chosen.id!r} diverges before tuning: give it parameters with which it runs")

    def objective(logs: Array) -> Array:
        changed = means(np.exp(logs), half, first)[0] - base
        return np.where(np.isfinite(changed), changed, FAILED)

    best = search(objective, count, evaluations, 1, progress)
    scores_of_each, squares_of_each = fixes.scores(np.stack([np.ones(count), best.factors]), len(samples))
    scores, squares = (np.nanmean(values[:, half:], axis=2) for values in (scores_of_each, squares_of_each))
    end = ready.log.imu_time[ready.first + samples]
    result = Tuning(
        source=ready.log.description.title if isinstance(source, RecordedLog) else str(source),
        estimator=chosen.id,
        trained_on=f"fixes up to {clock(end[half - 1])} s",
        judged_on=f"fixes from {clock(end[half])} s on",
        duration_s=float(ready.log.imu_time[-1] - ready.log.imu_time[ready.first]),
        parameters=fixes.parameters,
        factors=best.factors,
        history=best.history,
        start=0.0,
        before=float(scores[0].mean()),
        after=float(scores[1].mean()),
        change=_change(scores[1] - scores[0]),
        channels=(),
        consistency={"before": float(squares[0].mean()), "after": float(squares[1].mean())},
        notes=(*best.notes, *_slow_errors(float(np.nanmean(squares_of_each[0, half:, :3])), present)),
    )
    return _with_errors(result, ready.log, estimator, settings, float(end[half]))


@remark(
    "score-slow-errors",
    "positions scatter less than their sigmas say (mean y^2 / S {mean:.2g}): the sigmas are too large, or part of the error is "
    "slow, and the score then favours a filter that follows the fixes: state fix_wander_sigma_m in that case",
)
def _slow_errors(mean: float, parameters: Mapping[str, Any]) -> dict[str, float] | None:
    """Positions scatter less than stated (mean of y^2 / S) for a filter that models no slow errors of fixes."""
    return {"mean": mean} if mean < NOTABLE**-2 and not np.any(parameters.get(SLOW, 0.0)) else None


def _change(differences: Array) -> Estimate:
    """Mean of the differences of the scores of successive fixes (n,): Student's interval over the means of `BLOCKS` blocks.

    Errors of successive fixes are correlated; means of blocks are hardly.
    """
    means = np.array([part.mean() for part in np.array_split(differences, BLOCKS)])
    reach = student(BLOCKS - 1) * float(np.std(means, ddof=1)) / np.sqrt(BLOCKS)
    value = float(differences.mean())
    return Estimate(value, value - reach, value + reach)


def _sigma(ready: Prepared, samples: NDArray[np.int64]) -> Array:
    """Standard deviations (fixes, 6) that the receiver states; NaN for a velocity that is not there."""
    columns = ready.columns
    position, nothing = columns["gnss_position_sigma"][samples], np.full((len(samples), 3), np.nan)
    if "gnss_velocity_valid" not in columns:
        return np.concatenate([position, nothing], axis=1)
    there = columns["gnss_velocity_valid"][samples, None] != 0.0
    return np.concatenate([position, np.where(there, columns["gnss_velocity_sigma"][samples], np.nan)], axis=1)


def _with_errors(
    tuning: Tuning, log: RecordedLog, estimator: str | Estimator, settings: Settings | None, from_s: float
) -> Tuning:
    """With the errors in the second half before and after, if the log has a reference."""
    if log.reference is None:
        return tuning
    tuned = {**(settings or {}).get(tuning.estimator, {}), **tuning.settings()}
    errors = []
    for tried in (settings or {}, {**(settings or {}), tuning.estimator: tuned}):
        result = replay(log, estimator, settings=tried).results[0]
        late = result.time >= from_s
        errors.append({name: float(np.sqrt(np.mean(v[late] ** 2))) for name, v in result.errors.items() if late.any()})
    before, after = errors
    nothing = float("nan")
    channels = []
    for name, value in before.items():
        # one drive gives no interval
        ratio = Estimate(after[name] / value if value else nothing, nothing, nothing)
        channels.append(Channel(name, value, after[name], ratio, None))
    return replace(tuning, channels=tuple(channels))
