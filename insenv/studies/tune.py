"""Tuning of a filter on a scenario: noises and gates by CMA-ES, evaluated on held-out seeds.

The objective of factors is

    J = mean over channels of ln(rms / rms before)  +  w |ln(mean NEES / degrees of freedom)|,

over the training seeds and the time of the statistics.  The first term is the error, the second the consistency of the
covariance: a filter that is overconfident by a factor f in its standard deviations has |2 ln f|.  One population times the
seeds is one batch of the campaign's model: candidates differ in their parameters, row by row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.remarks import remark
from insenv.core.batch import make_batch
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.estimators.settings import Settings
from insenv.evaluation.errors import statistics_from
from insenv.logs import RecordedLog
from insenv.logs.loading import is_log
from insenv.scenario import ScenarioLike, limit_of, no_limit, with_settings
from insenv.scenario.loop import PREFIX
from insenv.studies.campaign.block import in_pieces
from insenv.studies.campaign.comparison import paired
from insenv.studies.campaign.plan import Plan, make_plan
from insenv.studies.campaign.running import cores
from insenv.studies.campaign.statistics import Estimate, jackknifed
from insenv.studies.tune_log import tune_log
from insenv.studies.tune_result import Channel, Tuning
from insenv.studies.tune_search import FAILED, Parameter, search, tuned_parameters

WEIGHT = 0.5
"""Weight of the consistency, as in the environment `insenv/Tuning-v0`."""
MAX_RUNS = 100_000
RUNS, HELD_OUT = 8, 32
"""Seeds of a scenario on which is sought and judged by default."""


@dataclass(frozen=True)
class Measures:
    """What tuning measures of some runs: mean squares (runs, channels), mean NEES (runs,) or None; NaN where one diverged."""

    squares: Array
    nees: Array | None


@dataclass(frozen=True)
class Seeds:
    """A plan's runs with factors on some parameters of the estimator."""

    plan: Plan
    parameters: tuple[Parameter, ...]

    @cached_property
    def rows(self) -> Array:
        """Parameters (runs, parameters.size) of the model without factors."""
        return self.plan.parameters_of(list(self.plan.plants(range(self.plan.runs))))

    def measures(self, factors: Array) -> list[Measures]:
        """Measures of each set of factors (n, parameters)."""
        model, times = self.plan.measured.model, self.plan.times
        rows = np.tile(self.rows, (len(factors), 1, 1)).reshape(len(factors), self.plan.runs, -1)
        for k, parameter in enumerate(self.parameters):
            part = model.parameters.slice(PREFIX + parameter.row.name)
            for n, each in enumerate(factors):
                rows[n, :, part] = parameter.value(each[k])
        batch = make_batch(model, len(factors) * self.plan.runs, rows.reshape(-1, rows.shape[-1]), threads=cores())
        with np.errstate(all="ignore"):
            shown = model.outputs.unpack(in_pieces(batch, len(times), self.plan.record_samples, lambda done: None))
            late = times >= self.from_s - 1e-9
            squares = shown["mean_square"][:, late].mean(axis=1).reshape(len(factors), self.plan.runs, -1)
            nees = shown["nees"][:, late].mean(axis=1).reshape(len(factors), -1) if self.plan.measured.degrees else None
        return [Measures(squares[n], None if nees is None else nees[n]) for n in range(len(factors))]

    @property
    def from_s(self) -> float:
        """Time from which errors count, as in a campaign."""
        return statistics_from(self.plan.chosen.navigates, float(self.plan.times[-1]))

    def objective(self, measures: Measures, before: Measures) -> float:
        """J; `FAILED` if a run diverged."""
        squares, start = measures.squares.mean(axis=0), before.squares.mean(axis=0)
        moving = start > 0.0
        if not np.isfinite(squares).all() or not moving.any():
            return FAILED
        error = float(np.mean(np.log(squares[moving] / start[moving]))) / 2.0
        return error + WEIGHT * self.consistency(measures)

    def consistency(self, measures: Measures) -> float:
        """|ln(mean NEES / degrees of freedom)|; 0 for an estimator without a covariance."""
        if measures.nees is None:
            return 0.0
        mean = float(np.mean(measures.nees)) / self.plan.measured.degrees
        return abs(float(np.log(mean))) if mean > 0.0 and np.isfinite(mean) else FAILED


def tune(
    source: ScenarioLike | str | Path | RecordedLog,
    estimator: str | Estimator,
    *,
    runs: int | None = None,
    held_out: int | None = None,
    keys: Sequence[str] | None = None,
    evaluations: int = 200,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Tune the noises and gates of a filter on a scenario, or on a recorded log, and judge the result on data it has not seen.

    Parameters
    ----------
    source: a scenario, as of `insenv.run`; or the path of a log, or a loaded one, as of `insenv.replay`.
    estimator: an id or an `Estimator`.
    runs: number of seeds on which factors are sought (None: `RUNS`); held_out: number of further seeds on which they are
        judged (None: `HELD_OUT`).  Of a log its first half and its second serve.
    keys: parameters to tune, by their keys in [estimator.ID]; None: noises and gates that are not 0.
    evaluations: about how many sets of factors are tried.
    seed: first seed; None: the scenario's.
    duration_s: instead of the scenario's, s.  A log allows none of these four.
    settings: parameters by estimator id from which tuning starts, as of `insenv.run`.
    progress: called with the numbers of evaluations done and in all.

    Ctrl-C ends the search; what it has found until then is judged.  Raises `InputError` for what is unknown, wrong or cannot
    run, and if the `cma` package is missing.
    """
    check_progress(progress)
    need("tuning", "cma", extra="workbench")
    _check(evaluations=evaluations)
    if isinstance(source, RecordedLog) or is_log(source):
        for option, value in (("runs", runs), ("held_out", held_out), ("seed", seed), ("duration_s", duration_s)):
            if value is not None:
                raise InputError(
                    f"{option} = {value!r}: allowed with a scenario; a log is used as a whole, its first half for the "
                    "search and its second for judging"
                )
        return tune_log(source, estimator, keys, evaluations, settings, progress)
    runs, held_out = RUNS if runs is None else runs, HELD_OUT if held_out is None else held_out
    _check(runs=runs, held_out=held_out)
    begun = with_settings(source, settings, [estimator])
    plan = make_plan(begun, estimator, runs, first_seed=seed, duration_s=duration_s)
    other = make_plan(begun, estimator, held_out, first_seed=plan.first_seed + plan.runs, duration_s=duration_s)
    table = plan.chosen.model.parameters
    present = table.unpack(table.pack(plan.plant.parameters_of(plan.chosen, offline=False)))
    parameters = tuned_parameters(plan.chosen, present, keys)
    training, judging = Seeds(plan, parameters), Seeds(other, parameters)
    ones = np.ones((1, len(parameters)))
    (before,) = training.measures(ones)
    if not np.isfinite(before.squares).all():
        raise InputError(f"estimator {plan.chosen.id!r} diverges before tuning: give it parameters with which it runs")

    def objective(logs: Array) -> Array:
        return np.array([training.objective(measures, before) for measures in training.measures(np.exp(logs))])

    result = search(objective, len(parameters), evaluations, plan.first_seed, progress)
    first, second = judging.measures(np.stack([ones[0], result.factors]))
    limit: dict[str, float] = {} if no_limit(plan.plant) else limit_of(plan.plant).rms(plan.times, training.from_s)
    return Tuning(
        source=plan.name,
        estimator=plan.chosen.id,
        trained_on=f"seeds {plan.first_seed} to {plan.first_seed + runs - 1}",
        judged_on=f"seeds {other.first_seed} to {other.first_seed + held_out - 1}",
        duration_s=plan.duration_s,
        parameters=parameters,
        factors=result.factors,
        history=result.history,
        start=training.objective(before, before),
        before=judging.objective(first, first),
        after=judging.objective(second, first),
        change=_change(judging, first, second),
        channels=_channels(plan.measured.channels, first, second, limit),
        consistency=_consistency(judging, first, second),
        notes=(*plan.notes, *_diverged(first, second), *result.notes),
    )


def _check(**counts: object) -> None:
    for name, value in counts.items():
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 2 <= value <= MAX_RUNS:
            raise InputError(f"{name} = {value!r}: allowed is a whole number from 2 to {MAX_RUNS}")


def _change(judging: Seeds, first: Measures, second: Measures) -> Estimate:
    """Change of the objective over the runs; a run that diverges counts: there is no interval."""

    def change(runs: NDArray[np.int64]) -> float:
        one, other = (Measures(m.squares[runs], None if m.nees is None else m.nees[runs]) for m in (first, second))
        return judging.objective(other, one) - judging.objective(one, one)

    runs = np.arange(len(first.squares))
    value, finite = change(runs), np.isfinite(first.squares).all() and np.isfinite(second.squares).all()
    return jackknifed(value, np.array([change(np.delete(runs, run)) if finite else np.nan for run in runs]))


def _channels(names: tuple[str, ...], first: Measures, second: Measures, limit: dict[str, float]) -> tuple[Channel, ...]:
    finite = np.isfinite(first.squares).all(axis=1) & np.isfinite(second.squares).all(axis=1)
    channels = []
    for place, name in enumerate(names):
        a, b = first.squares[finite, place], second.squares[finite, place]
        pair = paired(a, b)
        channels.append(Channel(name, float(np.sqrt(a.mean())), float(np.sqrt(b.mean())), pair.ratio, limit.get(name)))
    return tuple(channels)


def _consistency(judging: Seeds, first: Measures, second: Measures) -> dict[str, float] | None:
    """Mean NEES over its degrees of freedom before and after."""
    if first.nees is None or second.nees is None:
        return None
    degrees = judging.plan.measured.degrees
    return {"before": float(np.mean(first.nees)) / degrees, "after": float(np.mean(second.nees)) / degrees}


@remark(
    "tuning-diverges",
    "the estimator diverges in {before} of {runs} held-out runs before and in {after} after: no confidence interval is given",
)
def _diverged(first: Measures, second: Measures) -> dict[str, int] | None:
    """There are no intervals, because the estimator diverges in some of the held-out runs."""
    before, after = (int(np.sum(~np.isfinite(each.squares).all(axis=1))) for each in (first, second))
    return {"before": before, "after": after, "runs": len(first.squares)} if before or after else None
