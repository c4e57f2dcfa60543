"""Normalised innovations squared (NIS) of one instrument over a run: mean, bounds, share refused, verdict.

The NIS of a component of a measurement is its squared test ratio: innovation over the standard deviation that the filter
states for it, of estimate and measurement together.  For a consistent filter it has the mean 1.

Bounds: the sum over n independent components is chi-square with n degrees of freedom.  Slow errors of an instrument and slow
errors of the filter make innovations dependent, and n too large.  So the run is cut into `BLOCKS` blocks with equal numbers
of measurements.  With S_j the sum of a block, n_j its components and m the mean NIS, the variance of the sums is compared with
that of independent components:

    D = max(1, sum (S_j - m n_j)^2 / (BLOCKS - 1) / (2 m^2 mean n_j)),     degrees of freedom n / D

This needs no model of the dependence.  It does not see one that is longer than a block.

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

from insenv.evaluation import sentences
from insenv.evaluation.chi_square import quantile

Array = NDArray[np.float64]
Verdict = Literal["untested", "consistent", "overconfident", "diverged"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
"""From nothing known, and from good, to bad."""
WRONG: tuple[Verdict, ...] = ("overconfident", "diverged")
"""Of a filter whose innovations are larger than it states."""

PROBABILITIES = (0.025, 0.975)
BLOCKS = 20
"""Blocks of a run; fewer than two measurements a block leave D = 1."""
NOTABLE = 1.1
"""A factor below it is not called overconfident: data sheets and receivers do not give a sigma to 10 %."""
MANY = 0.1
"""Share of refused measurements that is not explained by occasional outliers."""
MOST = 0.5
"""Share of refused measurements from which filter and instrument have parted."""
APART = 5.0
"""RMS of the test ratios used, of a group of components, from which filter and instrument have parted.

By default a single ratio of this size is refused.
"""
LAST = 0.75
"""Diverged is a filter that has parted from its measurements over the whole run, or over those after this share of them."""
FEWEST = 8
"""Measurements below which no filter is called diverged for the last of them."""


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

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {"nis": self.mean, "nis_bounds": [self.low, self.high]}

    @property
    def text(self) -> str:
        """The mean with its bounds."""
        if not self.mean >= 0:
            return sentences.NONE_USED
        return sentences.NIS.format(mean=figure(self.mean), low=f"{self.low:.3g}", high=f"{self.high:.3g}")

    @property
    def qualified(self) -> str:
        """What the verdict "consistent" means where the mean is outside the bounds; empty inside."""
        if self.mean < self.low:
            return sentences.SMALLER
        return sentences.WITHIN.format(percent=f"{100 * (NOTABLE - 1):.0f}") if self.mean > self.high else ""


@dataclass(frozen=True)
class Counts:
    """What a filter reports of one instrument: sums over all measurements so far, at each record.

    count, refused (records,): measurements, and those of which the gate refused a component.
    used, used_number, left, left_number (records, groups): squared test ratios of the components used and of those refused, and
    the numbers of these components.
    """

    count: Array
    refused: Array
    used: Array
    used_number: Array
    left: Array
    left_number: Array

    @classmethod
    def of(cls, rows: Mapping[str, Array], names: tuple[str, ...]) -> Counts:
        """From recorded rows by name; names: in the order of the fields."""
        count, refused, *sums = (np.asarray(rows[name], dtype=np.float64) for name in names)
        return cls(np.ravel(count), np.ravel(refused), *(one.reshape(len(one), -1) for one in sums))

    def nis(self, group: int | None = None) -> Nis:
        """Of one group of components; None: of all."""
        group_of = slice(None) if group is None else slice(group, group + 1)
        return _nis(self.used[:, group_of].sum(axis=-1), self.used_number[:, group_of].sum(axis=-1), _edges(self.count))

    @property
    def verdict(self) -> Verdict:
        """How filter and instrument agree (`insenv.evaluation.health.Health`)."""
        if not np.any(self.used_number[-1] + self.left_number[-1]):
            return "untested"
        count, refused = self.count[-1], self.refused[-1]
        late = int(np.searchsorted(self.count, LAST * count, side="left"))
        of_late, refused_late, square, number = (
            values[-1] - values[late] for values in (self.count, self.refused, self.used, self.used_number)
        )
        if refused > MOST * count:
            return "diverged"
        if of_late >= FEWEST and (refused_late > MOST * of_late or np.any(square > APART**2 * np.maximum(number, 1.0))):
            return "diverged"
        nis = (self.nis(), *(self.nis(group) for group in range(self.used.shape[1])))
        return "overconfident" if refused > MANY * count or any(one.above for one in nis) else "consistent"

    @property
    def factor(self) -> float:
        """RMS of the test ratios, refused components included, of the group with the largest."""
        square, number = self.used[-1] + self.left[-1], self.used_number[-1] + self.left_number[-1]
        return sqrt(float(np.max(square / np.maximum(number, 1.0))))


def figure(value: float) -> str:
    """Three digits, and no exponent of a large value."""
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _edges(count: Array) -> NDArray[np.intp]:
    """Records that end the blocks: the first with each multiple of 1 / `BLOCKS` of the measurements; one block for few."""
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
