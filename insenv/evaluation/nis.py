"""Normalised innovations squared (NIS) of one instrument over a run: mean, bounds, share refused, verdict.

The NIS of a component of a measurement is its squared test ratio: innovation over the standard deviation that the filter
states for it, of estimate and measurement together.  For a consistent filter it has the mean 1.

Bounds: the sum over n independent components is chi-square with n degrees of freedom.  Slow errors of an instrument and slow
errors of the filter make innovations dependent, and n too large.  So the run is cut into `BLOCKS` blocks with equal numbers
of measurements.  With S_j the sum of a block, n_j its components and m the mean NIS, the variance of the sums is compared with
that of independent components:

    D = max(1, sum (S_j - m n_j)^2 / (BLOCKS - 1) / (2 m^2 mean n_j)),     degrees of freedom n / D

This needs no model of the dependence.  It does not see one that is longer than a block.

The rule, `judged`, takes numbers or symbols: Python evaluates it after a run, and a live page runs it compiled (`flat`).

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), section 5.4.2;
blocks: batch means, Law and Kelton, "Simulation Modeling and Analysis", section 9.5.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np

from insenv.core.elementary import maximum, minimum, polynomial, select
from insenv.core.tables import Array
from insenv.evaluation.chi_square import bound_polynomial, quantile

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
REFUSED_OVERCONFIDENT = 0.1
"""Share of refused measurements that is not explained by occasional outliers."""
REFUSED_DIVERGED = 0.5
"""Share of refused measurements from which filter and instrument have parted."""
APART = 5.0
"""RMS of the test ratios used, of a group of components, from which filter and instrument have parted.

By default a single ratio of this size is refused.
"""
LATE_SHARE = 0.75
"""Diverged is a filter that has parted from its measurements over the whole run, or over those after this share of them."""
FEWEST = 8
"""Measurements below which the NIS calls no filter overconfident, and the last ones none diverged: a short rest has one."""
_SMALLEST_DIVISOR = 1e-300
"""Smallest divisor: a value divided by it is not used."""


@dataclass(frozen=True)
class Nis:
    """Mean NIS of the components used, and its 95 % bounds for a consistent filter; NaN where there is none."""

    mean: Any
    low: Any
    high: Any

    @property
    def above(self) -> Any:
        """Whether it shows innovations that are notably larger than stated."""
        return self.mean > maximum(self.high, NOTABLE**2)

    @property
    def below(self) -> Any:
        """Whether it shows innovations that are notably smaller than stated."""
        return self.mean < minimum(self.low, NOTABLE**-2)

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {"nis": self.mean, "nis_bounds": [self.low, self.high]}


NO_NIS = Nis(float("nan"), float("nan"), float("nan"))
Judgement = tuple[Any, Any, list[Nis]]
"""Place of the verdict in `VERDICTS`; RMS of the test ratios, refused components included, of the group with the largest; NIS
of all components used and of each group."""
Bounds = Callable[[Any], tuple[Any, Any]]
"""Of degrees of freedom, the bounds of the mean NIS."""

# Sums of an instrument, a row for each record: number of measurements so far, of those of which the gate refused a component;
# then, each with a column for every group of components, squared test ratios of the components used, their number, and the same
# two of those refused.


def sums_of(rows: Mapping[str, Array], names: tuple[str, ...]) -> Array:
    """Sums (records, 2 + 4 groups) from recorded rows by name; names: ordered as `insenv.estimators.parts.rows.COUNTED`."""
    return np.hstack([np.asarray(rows[name], dtype=np.float64).reshape(len(rows[name]), -1) for name in names])


def judged(ends: Any, late: Any, blocks: Any, bounds: Bounds) -> Judgement:
    """The judgement from sums at the ends of the blocks, the last of which is the end of the run, and at one record before.

    late: at the record after which the last part of the measurements comes.  blocks: number of blocks that hold measurements.
    """
    width = (ends.shape[1] - 2) // 4
    groups, last = range(width), [_number(ends[-1, k]) for k in range(ends.shape[1])]
    squares, numbers = ends[:, 2 : 2 + width], ends[:, 2 + width : 2 + 2 * width]
    nis = [_nis(_sum(squares), _sum(numbers), blocks, bounds)]
    nis += [_nis(squares[:, k], numbers[:, k], blocks, bounds) for k in groups]
    count, refused, used, used_number, left, left_number = _parts(last)
    count_late, refused_late, used_late, used_number_late, *_ = _parts([sum - late[k] for k, sum in enumerate(last)])
    parted = [used_late[k] > APART**2 * maximum(used_number_late[k], 1.0) for k in groups]
    diverged = _any(
        refused > REFUSED_DIVERGED * count,
        (count_late >= FEWEST) * _any(refused_late > REFUSED_DIVERGED * count_late, *parted),
    )
    above = [(count >= FEWEST) * one.above for one in nis]
    overconfident = _any(refused > REFUSED_OVERCONFIDENT * count, *above)
    tested = _any(*(used_number[k] + left_number[k] > 0 for k in groups))
    mean_squares = [(used[k] + left[k]) / maximum(used_number[k] + left_number[k], 1.0) for k in groups]
    verdict = select(tested, select(diverged, 3, select(overconfident, 2, 1)), 0)
    return verdict, ca.sqrt(reduce(maximum, mean_squares)), nis


def _parts(sums: list[Any]) -> list[Any]:
    """The sums of one row: two numbers, and four lists of a number for each group."""
    width = (len(sums) - 2) // 4
    return [*sums[:2], *(sums[2 + k * width : 2 + (k + 1) * width] for k in range(4))]


def _nis(squares: Any, numbers: Any, blocks: Any, bounds: Bounds) -> Nis:
    """Of the sums of squared test ratios and of components (blocks,) up to the end of each block."""
    square, number = _number(squares[-1]), _number(numbers[-1])
    if isinstance(number, float) and number == 0.0:
        return NO_NIS
    mean = square / number
    off = _steps(squares) - mean * _steps(numbers)
    white = 2 * mean**2 * (number / blocks)
    spread = _total(off**2) / maximum(blocks - 1, 1) / maximum(white, _SMALLEST_DIVISOR)
    degrees = number / select((blocks > 1) * (mean > 0), maximum(spread, 1.0), 1.0)
    return Nis(mean, *bounds(degrees))


def _number(value: Any) -> Any:
    return value if isinstance(value, ca.SX) else float(value)


def _sum(values: Any) -> Any:
    """Over the groups."""
    return ca.sum2(values) if isinstance(values, ca.SX) else values.sum(axis=-1)


def _steps(sums: Any) -> Any:
    return sums - ca.vertcat(0.0, sums[:-1]) if isinstance(sums, ca.SX) else np.diff(sums, prepend=0.0)


def _total(values: Any) -> Any:
    return ca.sum1(values) if isinstance(values, ca.SX) else float(np.sum(values))


def _any(*conditions: Any) -> Any:
    return sum(conditions) > 0


def of_records(sums: Array) -> Judgement:
    """The judgement of a run, from its records."""
    count = sums[:, 0]
    edges = np.array([len(count) - 1])
    if count[-1] >= 2 * BLOCKS:  # the first record with each multiple of 1 / `BLOCKS` of the measurements
        edges = np.unique(np.searchsorted(count, np.arange(1, BLOCKS + 1) * (count[-1] / BLOCKS), side="left"))
    late = int(np.searchsorted(count, LATE_SHARE * count[-1], side="left"))
    return judged(sums[edges], sums[late], len(edges), _bounds)


def _bounds(degrees: float) -> tuple[float, float]:
    low, high = (float(bound) / degrees for bound in quantile(PROBABILITIES, degrees))
    return low, high


def flat(ends: Any, late: Any) -> Judgement:
    """`judged` of symbols, as a live page has them: sums at the ends of `BLOCKS` blocks, one row after another, and late.

    A run with fewer blocks repeats its last row.
    """
    rows = ca.reshape(ends, late.numel(), BLOCKS).T
    return judged(rows, late, ca.sum1(_steps(rows[:, 0]) > 0), _polynomial_bounds)


def _polynomial_bounds(degrees: Any) -> tuple[Any, Any]:
    low, high = (polynomial(1.0 / ca.sqrt(degrees), one) ** 3 for one in map(bound_polynomial, PROBABILITIES))
    return low, high
