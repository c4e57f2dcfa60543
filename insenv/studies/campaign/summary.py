"""`Summary`: what a campaign returns; and how it is computed from the blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from insenv.base.remarks import Remark, declared
from insenv.core.runner import Progress
from insenv.core.tables import Array
from insenv.evaluation.chi_square import quantile
from insenv.evaluation.errors import STEEP_LIMIT, statistics_from
from insenv.evaluation.health import Health, health
from insenv.report import Document, FilesWritten, OutputFolder, Shown, write_document
from insenv.report.notebook import data_frame
from insenv.scenario import limit_of, no_limit
from insenv.studies.campaign.model import Measured
from insenv.studies.campaign.plan import Plan
from insenv.studies.campaign.presentation import campaign_document, campaign_facts, campaign_frame, run_columns
from insenv.studies.campaign.run_remarks import of_errors, of_health, of_text
from insenv.studies.campaign.sensitivity import sensitivities
from insenv.studies.campaign.statistics import BOUNDS, FAR_OFF, PERCENTILES, Course, NeesCourse, Statistics

if TYPE_CHECKING:
    from pandas import DataFrame


VARIED_RUNS = 16
"""Number of runs, evenly spaced, whose limits stand for those of all if the scenario varies: each takes about a second."""
_SOME_RUNS = declared("limit-of-some-runs", "limit: the root mean square over {some} of the {runs} runs, evenly spaced")


@dataclass(frozen=True)
class CampaignLimit:
    """Limits of runs.

    runs (k,): numbers of the runs; squares (k, records, channels): mean squares of their limits over the evaluations since
    the previous record, as those of the errors.  same: whether the one limit is that of every run.  notes: what must be said
    of it.
    """

    runs: NDArray[np.int64]
    squares: Array
    same: bool
    notes: tuple[Remark, ...] = ()

    def course(self) -> Array | None:
        """Root mean square over the runs (records, channels); None if there is no limit."""
        return np.sqrt(np.mean(self.squares, axis=0)) if self.runs.size else None

    def of_runs(self, count: int, late: NDArray[np.bool_]) -> Array:
        """Limit of each of `count` runs over the records `late` (count, channels); NaN where it was not computed."""
        limits = np.full((count, self.squares.shape[2]), np.nan)
        if self.runs.size:
            rms = np.sqrt(np.mean(self.squares[:, late], axis=1))
            limits[slice(None) if self.same else self.runs] = rms
        return limits


def campaign_limit(plan: Plan, channels: tuple[str, ...], progress: Progress | None = None) -> CampaignLimit:
    """The limit of a plan's runs in `channels`."""
    refusal = no_limit(plan.plant)
    if refusal:
        return CampaignLimit(np.zeros(0, dtype=np.int64), np.zeros((0, len(plan.times), len(channels))), False, refusal)
    same = not plan.variations
    runs = np.unique(np.linspace(0, plan.runs - 1, 1 if same else VARIED_RUNS).round().astype(np.int64))
    squares, steep = [], False
    for place, run in enumerate(runs):

        def report(done: int, total: int, before: int = place) -> None:
            if progress is not None:
                progress(before * total + done, len(runs) * total)

        plant = plan.plant if same else plan.plant_of(int(run))
        of_run = limit_of(plant, report)
        limit = of_run.at(_evaluations(plan))
        square = np.stack([limit[name] for name in channels], axis=-1) ** 2
        square[:, [name in of_run.unjudged for name in channels]] = np.nan
        steep = steep or bool(of_run.unjudged)
        squares.append(square.reshape(len(plan.times), plan.evaluations, len(channels)).mean(axis=1))
    some = len(runs) < plan.runs and not same
    notes = [_SOME_RUNS.filled(some=len(runs), runs=plan.runs)] if some else []
    return CampaignLimit(runs, np.array(squares), same, (*notes, *([STEEP_LIMIT] if steep else [])))


def _evaluations(plan: Plan) -> Array:
    """Times at which errors are evaluated, s."""
    interval = plan.evaluation_samples * plan.plant.sample_interval
    return np.arange(1.0, len(plan.times) * plan.evaluations + 1.0) * interval


# The limit of a campaign: one for all its runs, or, where the scenario varies, those of some of them.

Columns = Callable[[str], list[Array]]
"""Returns an array of every block, by the array's name."""


class Summary(Statistics, Shown):
    """The result of a campaign: its `Statistics`, to be printed, drawn and saved."""

    def to_dataframe(self) -> DataFrame:
        """The courses as a pandas DataFrame, indexed by time (s).

        Columns: ``mean_CHANNEL``, ``rms_CHANNEL``, ``p2.5_CHANNEL`` to ``p97.5_CHANNEL``, ``limit_CHANNEL`` and
        ``stated_CHANNEL`` where there are any, ``nees``. Raises `InsenvError` if pandas is missing.
        """
        return campaign_frame(self)

    def runs_to_dataframe(self) -> DataFrame:
        """The runs as a pandas DataFrame, indexed by run: seed, varied keys, final error, rms, limit and stated of each
        channel.

        Raises `InsenvError` if pandas is missing.
        """
        columns = run_columns(self)
        return data_frame(columns.pop("run"), columns, "run")

    def save(self, folder: str | Path, figure: bool = True, table: str = "") -> FilesWritten:
        """Write campaign.npz and campaign.json and, if `figure`, the page and (with matplotlib) the figure.

        table: "csv" or "parquet" for a table of the runs as well.

        Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        return write_document(self.document(table), OutputFolder(folder), figure)

    def document(self, table: str = "") -> Document:
        """What is printed and kept of it; table: as of `save`."""
        return campaign_document(self, table)

    def __repr__(self) -> str:
        lines = [f"{name}: rms {row['rms']:.3g}" for name, row in self.figures().items()]
        return f"Campaign of {self.plan.name}: {self.plan.estimator}, {campaign_facts(self)}\n  {', '.join(lines)}"


def summarise(plan: Plan, measured: Measured, columns: Columns, limit: CampaignLimit) -> Summary:
    """Summarise all blocks; sums follow the order of the runs, so that they do not depend on the workers."""
    time = plan.times
    from_s = statistics_from(plan.chosen.navigates, float(time[-1]))
    late = time >= from_s - 1e-9
    seeds, error, square = (np.concatenate(columns(name)) for name in ("seed", "error", "mean_square"))
    limits = limit.course()
    variance = np.full(square.shape, np.nan)
    has_sigma = [measured.channels.index(name) for name in measured.stated]
    if measured.stated:
        variance[:, :, has_sigma] = np.concatenate(columns("mean_variance"))
    finite: NDArray[np.bool_] = np.isfinite(np.concatenate([error, square, variance[:, :, has_sigma]], axis=2)).all(axis=2)

    courses = {}
    for place, name in enumerate(measured.channels):
        stated = variance[:, :, place] if name in measured.stated else None
        limit_of_channel = None if limits is None or np.isnan(limits[:, place]).all() else limits[:, place]
        courses[name] = _course(error[:, :, place], square[:, :, place], limit_of_channel, stated, finite)
    rms = np.sqrt(np.mean(square[:, late], axis=1))
    whole = np.all(finite, axis=1)
    far = whole & (rms > FAR_OFF * np.median(rms[whole], axis=0)).any(axis=1) if whole.any() else whole
    values = np.concatenate(columns("values"))
    healths = _health(columns, plan.chosen.health_rows.names) if plan.chosen.reports_health else ()
    stated = np.sqrt(np.mean(variance[:, late], axis=1))
    said = [of_text(str(text)) for text in np.concatenate(columns("said"))]
    unjudged = ("roll_deg", "heading_deg") if STEEP_LIMIT in limit.notes else ()
    judged = [] if plan.too_short else [(k, name) for k, name in enumerate(measured.channels) if name not in unjudged]
    slow = np.concatenate(columns("models_slow"))
    for run in np.flatnonzero(whole):
        if plan.chosen.reports_health:
            said[run] += of_health(plan.chosen, healths[run], bool(slow[run]))
        known = {name: k for k, name in judged if name in measured.stated}
        said[run] += of_errors(*({name: float(values[run, k]) for name, k in known.items()} for values in (rms, stated)))
    return Summary(
        plan=plan,
        time=time,
        courses=courses,
        nees=_nees(measured, columns),
        from_s=from_s,
        seeds=seeds,
        values=values,
        final=error[:, -1],
        rms=rms,
        stated=stated,
        limit=limit.of_runs(len(seeds), late),
        diverged=tuple(int(seed) for seed in seeds[~whole]),
        far=tuple(int(seed) for seed in seeds[far]),
        limit_notes=limit.notes,
        whole=whole,
        sensitivity=sensitivities(plan, measured.channels, values, rms, whole),
        health=tuple(
            one and one.doubted((*plan.notes, *(said.remark for said in each)))  # what is said of all runs, and of this one
            for one, each in zip(healths, said, strict=True)
        )
        if healths
        else (),
        said=tuple(map(tuple, said)),
    )


def _health(columns: Columns, names: Sequence[str]) -> tuple[Health | None, ...]:
    """The health of every run from the rows `names`; None for one without a measurement or with a number that is not finite."""
    rows = {name: np.concatenate(columns(name)) for name in names}
    runs = range(len(rows[names[0]]))
    finite = [all(np.isfinite(values[run]).all() for values in rows.values()) for run in runs]
    return tuple(health({n: v[run] for n, v in rows.items()}) if finite[run] else None for run in runs)


def _course(error: Array, square: Array, limit: Array | None, stated: Array | None, finite: NDArray[np.bool_]) -> Course:
    """Statistics of one channel over the runs (runs, records), at each time over those that are finite there.

    limit (records,): of the channel, or None.  stated: the variances that the estimator states, as `square`, or None.
    """

    def rms(squares: Array) -> Array:
        return np.sqrt(_mean(squares, finite))

    return Course(
        mean=_mean(error, finite),
        rms=rms(square),
        percentiles=_percentiles(error, finite),
        limit=limit,
        stated=None if stated is None else rms(stated),
    )


def _mean(values: Array, finite: NDArray[np.bool_]) -> Array:
    """Mean over the runs that are finite; NaN where none is."""
    count = finite.sum(axis=0)
    return np.where(count > 0, np.sum(np.where(finite, values, 0.0), axis=0) / np.maximum(count, 1), np.nan)


def _percentiles(error: Array, finite: NDArray[np.bool_]) -> Array:
    if finite.all():
        return np.percentile(error, PERCENTILES, axis=0)
    none = np.full(len(PERCENTILES), np.nan)
    courses = zip(error.T, finite.T, strict=True)
    return np.stack([np.percentile(e[good], PERCENTILES) if good.any() else none for e, good in courses], axis=1)


def _nees(measured: Measured, columns: Columns) -> NeesCourse | None:
    if not measured.degrees:
        return None
    nees = np.concatenate(columns("nees"))
    whole = nees[np.isfinite(nees).all(axis=1)]
    count = max(len(whole), 1)
    low, high = quantile(BOUNDS, measured.degrees * count) / count
    mean = np.mean(whole, axis=0) if len(whole) else np.full(nees.shape[1], np.nan)
    return NeesCourse(mean, measured.degrees, float(low), float(high))
