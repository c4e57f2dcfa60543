"""Health of a filter with fixes: are its innovations as large as it states, and does it still use the fixes?

The normalised innovation squared (NIS) of a component of a fix is its squared test ratio: innovation over the standard
deviation that the filter states for it, of estimate and fix together.  For a consistent filter it has the mean 1.  A filter
that reports its health sums it over every fix (`insenv.estimators.parts.rows.FIX_HEALTH`), so records may be sparse.

Bounds: the sum over n independent components is chi-square with n degrees of freedom.  Slow errors of a receiver and slow
errors of the filter make innovations dependent, and n too large.  So the run is cut into `BLOCKS` blocks with equal numbers
of fixes.  With S_j the sum of a block, n_j its components and m the mean NIS, the variance of the sums is compared with that
of independent components:

    D = max(1, sum (S_j - m n_j)^2 / (BLOCKS - 1) / (2 m^2 mean n_j)),     degrees of freedom n / D

This needs no model of the dependence.  It does not see one that is longer than a block.

What it cannot see: an innovation is the difference of estimate and fix.  An error of the fixes that is slow enough for the
estimate to follow is in neither, and makes the NIS smaller than 1 (`Health.notes`).

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), section 5.4.2;
blocks: batch means, Law and Kelton, "Simulation Modeling and Analysis", section 9.5.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.chi_square import quantile

Array = NDArray[np.float64]
Verdict = Literal["consistent", "overconfident", "diverged"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

PROBABILITIES = (0.025, 0.975)
BLOCKS = 20
"""Blocks of a run; fewer than two fixes a block leave D = 1."""
NOTABLE = 1.1
"""A factor below it is not called overconfident: data sheets and receivers do not give a sigma to 10 %."""
MANY = 0.1
"""Share of refused fixes that is not explained by occasional outliers."""
MOST = 0.5
"""Share of refused fixes from which filter and fixes have parted."""
APART = 5.0
"""RMS of the test ratios used, of position or of velocity, from which filter and fixes have parted.

By default a single ratio of this size is refused.
"""
LAST = 0.75
"""Diverged is a filter that has parted from its fixes over the whole run, or over those after this share of them."""
FEWEST = 8
"""Fixes below which no filter is called diverged for the last of them."""
GROUPS = ("position", "velocity")


@dataclass(frozen=True)
class Nis:
    """Mean NIS of the components used, and its 95 % bounds for a consistent filter; NaN where there is none."""

    mean: float
    low: float
    high: float

    @property
    def above(self) -> bool:
        """Whether it shows innovations that are notably larger than stated."""
        return self.mean > max(self.high, NOTABLE**2)

    @property
    def below(self) -> bool:
        """Whether it shows innovations that are notably smaller than stated."""
        return self.mean < min(self.low, NOTABLE**-2)


@dataclass(frozen=True)
class Health:
    """The health of a filter over a run.

    fixes, refused: number of fixes, and of those of which the gate refused a component.
    nis: of all components used.  groups: of position and of velocity ("position", "velocity").
    verdict: "diverged": over the run, or over the last quarter of its fixes, most are refused, or over that quarter the
            innovations used are `APART` times as large as stated;
        "overconfident": a NIS above its bounds and a factor of at least `NOTABLE`, or a share above `MANY` refused; else
        "consistent".
    factor: by which the stated standard deviations of innovations must be multiplied; 1 if consistent.  Of the root mean
        squares of the test ratios of position and velocity, refused components included, it is the larger one.
    """

    fixes: int
    refused: int
    nis: Nis
    groups: Mapping[str, Nis]
    verdict: Verdict
    factor: float

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "fixes": self.fixes,
            "refused": self.refused,
            **_as_json(self.nis),
            "verdict": self.verdict,
            "factor": self.factor,
            **{name: _as_json(nis) for name, nis in self.groups.items()},
        }

    @property
    def summary(self) -> str:
        """One line: share refused, NIS with bounds, verdict."""
        share = f"{100 * self.refused / self.fixes:.2g} % of {self.fixes} fixes refused"
        nis = f"NIS {_figure(self.nis.mean)} ({self.nis.low:.3g} to {self.nis.high:.3g})" if self.nis.mean >= 0 else "none used"
        factor = "" if self.verdict == "consistent" else f", factor {_figure(self.factor)}"
        return f"{self.verdict}{factor}: {share}, {nis}"

    def notes(self, models_slow_errors: bool = False) -> tuple[str, ...]:
        """Sentences for the reader; none for a filter whose innovations are as stated.

        models_slow_errors: whether the filter models slow errors of the fixes, which then cause no note.
        """
        if self.verdict != "consistent":
            state = "the filter has diverged from its fixes" if self.verdict == "diverged" else "the filter is overconfident"
            return (
                f"{state}: its innovations are {_figure(self.factor)} times as large as stated, and it refused {self.refused} "
                f"of {self.fixes} fixes. The errors may exceed the stated sigmas by more than that. Look at the grade of the "
                "inertial unit, the lever arm of the antenna, the time offset of the fixes, their stated sigmas and the start",
            )
        position = self.groups["position"]
        if position.below and not models_slow_errors:
            return (
                f"positions scatter less than their sigmas say (mean NIS {position.mean:.2g}): their sigmas are too large, or "
                "part of their error is slow. A slow error does not average out: the position may then be wrong by the whole "
                "sigma of a fix, whatever the filter states",
            )
        return ()


def health(outputs: Mapping[str, Array]) -> Health | None:
    """The health of a run from the recorded rows of `FIX_HEALTH`, (records, ...) by name; None if no fix came."""
    count = outputs["fix_count"]
    fixes, refused = int(count[-1]), int(outputs["fix_refused_count"][-1])
    if not fixes:
        return None
    edges = _edges(count)
    square, used = outputs["nis_used"], outputs["nis_used_count"]
    pooled = _nis(square.sum(axis=-1), used.sum(axis=-1), edges)
    groups = {name: _nis(square[:, place], used[:, place], edges) for place, name in enumerate(GROUPS)}
    verdict = _verdict(outputs, fixes, refused, (pooled, *groups.values()))
    return Health(fixes, refused, pooled, groups, verdict, 1.0 if verdict == "consistent" else _factor(outputs))


def course(outputs: Mapping[str, Array]) -> tuple[Array, Array]:
    """RMS of all test ratios since the previous record, and the fixes refused since then, (records,); NaN without a fix.

    outputs: rows of `FIX_HEALTH` as for `health`.  The first record has no previous one: NaN.
    """
    square = (outputs["nis_used"] + outputs["nis_refused"]).sum(axis=-1)
    number = (outputs["nis_used_count"] + outputs["nis_refused_count"]).sum(axis=-1)
    squares, numbers, refused = (np.diff(total, prepend=np.nan) for total in (square, number, outputs["fix_refused_count"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(numbers > 0, np.sqrt(squares / numbers), np.nan), np.nan_to_num(refused)


def _edges(count: Array) -> NDArray[np.intp]:
    """Records that end the blocks: the first with each multiple of 1 / `BLOCKS` of the fixes; one block for few fixes."""
    if count[-1] < 2 * BLOCKS:
        return np.array([len(count) - 1])
    return np.unique(np.searchsorted(count, np.arange(1, BLOCKS + 1) * (count[-1] / BLOCKS), side="left"))


def _nis(square: Array, number: Array, edges: NDArray[np.intp]) -> Nis:
    """Mean NIS and bounds from the recorded sums of squares and components (records,)."""
    total = float(number[-1])
    if not total:
        return Nis(float("nan"), float("nan"), float("nan"))
    mean = float(square[-1]) / total
    squares, numbers = (np.diff(values[edges], prepend=0.0) for values in (square, number))
    dependence = 1.0
    if len(edges) > 1 and mean > 0:
        white = 2 * mean**2 * float(numbers.mean())
        dependence = max(1.0, float(np.sum((squares - mean * numbers) ** 2)) / (len(edges) - 1) / white)
    degrees = total / dependence
    low, high = (float(bound) / degrees for bound in quantile(PROBABILITIES, degrees))
    return Nis(mean, low, high)


def _verdict(outputs: Mapping[str, Array], fixes: int, refused: int, nis: tuple[Nis, ...]) -> Verdict:
    late = int(np.searchsorted(outputs["fix_count"], LAST * fixes, side="left"))
    of_late, refused_late, square, number = (
        outputs[name][-1] - outputs[name][late] for name in ("fix_count", "fix_refused_count", "nis_used", "nis_used_count")
    )
    if refused > MOST * fixes:
        return "diverged"
    if of_late >= FEWEST and (refused_late > MOST * of_late or np.any(square > APART**2 * number)):
        return "diverged"
    return "overconfident" if refused > MANY * fixes or any(one.above for one in nis) else "consistent"


def _factor(outputs: Mapping[str, Array]) -> float:
    square = outputs["nis_used"][-1] + outputs["nis_refused"][-1]
    number = outputs["nis_used_count"][-1] + outputs["nis_refused_count"][-1]
    return sqrt(float(np.max(square / np.maximum(number, 1.0))))


def _figure(value: float) -> str:
    """Three digits, and no exponent of a large value."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _as_json(nis: Nis) -> dict[str, Any]:
    return {"nis": nis.mean, "nis_bounds": [nis.low, nis.high]}
