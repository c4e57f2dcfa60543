"""The limit of a campaign: one for all its runs, or, where the scenario varies, those of some of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv.base.remarks import Remark, declared
from insenv.core.runner import Progress
from insenv.core.tables import Array
from insenv.evaluation.errors import STEEP_LIMIT
from insenv.scenario import limit_of, no_limit
from insenv.studies.campaign.plan import Plan

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
