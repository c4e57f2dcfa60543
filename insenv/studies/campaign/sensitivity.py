"""Sensitivity of the errors to the varied keys: rank correlation, and first-order and total Sobol indices.

The quantity is the rms error of a run.  Spearman's rank correlation says whether it rises or falls with a key; the first-order
index is the share of its variance that a key explains alone, the total index the share that it takes part in (Saltelli et al.
2008, chapter 4).  The remainder to 1 is due to the noise of the runs, and for first-order indices also to interactions.
First-order indices come from any design (random balance, SALib's `rbd_fast`), total ones from a saltelli design.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.installing import advice, is_installed
from insenv.base.remarks import remark
from insenv.core.tables import Array
from insenv.studies.campaign.plan import Plan

LEAST_RUNS = 32
"""Least number of runs of which indices are computed."""
HARMONICS, RUNS_PER_HARMONIC = (2, 10), 32
"""Harmonics of the random-balance method (SALib's M): each more raises the noise of the index, so that few runs have few."""
RESAMPLES = 50
"""Bootstrap samples of the intervals."""


@dataclass(frozen=True)
class Index:
    """An index, and half the width of its 95 % interval."""

    value: float
    reach: float

    def as_json(self) -> dict[str, float]:
        """The documented JSON form."""
        return {"value": self.value, "low": self.value - self.reach, "high": self.value + self.reach}


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of the rms of one channel to one key.

    correlation: Spearman's rank correlation, None for a choice of names; chance: probability of one so large without any
    dependence.  first, total: Sobol indices, None where they cannot be computed.
    """

    key: str
    channel: str
    correlation: float | None
    chance: float | None
    first: Index | None
    total: Index | None

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "key": self.key,
            "channel": self.channel,
            "rank_correlation": self.correlation,
            "chance": self.chance,
            "first_order": None if self.first is None else self.first.as_json(),
            "total": None if self.total is None else self.total.as_json(),
        }


def sensitivities(
    plan: Plan, channels: tuple[str, ...], values: Array, rms: Array, whole: NDArray[np.bool_]
) -> tuple[Sensitivity, ...]:
    """By channel and key, from the values (runs, keys) and the rms (runs, channels) of the runs that are `whole`."""
    if not plan.variations or int(whole.sum()) < LEAST_RUNS:
        return ()
    rows = []
    for place, channel in enumerate(channels):
        firsts, totals = _indices(plan, values, rms[:, place], whole)
        for k, variation in enumerate(plan.variations):
            correlation, chance = None, None
            if variation.distribution.is_of_numbers:
                correlation, chance = _rank(plan, values[whole, k], rms[whole, place])
            rows.append(Sensitivity(variation.key, channel, correlation, chance, firsts[k], totals[k]))
    return tuple(rows)


@remark("no-sobol-indices", "no Sobol indices: SALib is not installed: {advice}")
def no_indices(plan: Plan) -> dict[str, str] | None:
    """Keys are varied, and the package that computes the indices is missing."""
    if not plan.variations or is_installed("SALib"):
        return None
    return {"advice": advice("SALib", "workbench")}


def _rank(plan: Plan, values: Array, rms: Array) -> tuple[float, float | None]:
    from scipy.stats import spearmanr

    result = spearmanr(values, rms)
    # runs of a saltelli design are not independent
    return float(result.statistic), None if plan.design == "saltelli" else float(result.pvalue)


def _indices(plan: Plan, values: Array, rms: Array, whole: NDArray[np.bool_]) -> tuple[list[Index | None], list[Index | None]]:
    """First-order and total indices of all keys."""
    count = len(plan.variations)
    nothing: list[Index | None] = [None] * count
    if not is_installed("SALib") or not np.ptp(rms[whole]) > 0.0:
        return nothing, nothing
    problem = {"num_vars": count, "names": [v.key for v in plan.variations], "bounds": [[0.0, 1.0]] * count}
    if plan.design == "saltelli":
        if not whole.all():  # a group with a run that diverged gives no index
            groups = whole.reshape(-1, count + 2).all(axis=1)
            rms = rms[np.repeat(groups, count + 2)]
        if len(rms) < LEAST_RUNS:
            return nothing, nothing
        from SALib.analyze import sobol

        got = sobol.analyze(problem, rms, calc_second_order=False, num_resamples=RESAMPLES, seed=plan.first_seed % 2**32)
        return _pairs(got, "S1"), _pairs(got, "ST")
    from SALib.analyze import rbd_fast

    harmonics = min(max(int(whole.sum()) // RUNS_PER_HARMONIC, HARMONICS[0]), HARMONICS[1])
    got = rbd_fast.analyze(
        problem, values[whole], rms[whole], M=harmonics, num_resamples=RESAMPLES, seed=plan.first_seed % 2**32
    )
    return _pairs(got, "S1"), nothing


def _pairs(got: Any, name: str) -> list[Index | None]:
    return [Index(float(value), float(reach)) for value, reach in zip(got[name], got[f"{name}_conf"], strict=True)]
