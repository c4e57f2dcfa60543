"""Normalised innovations squared (NIS) of one instrument over a run: mean, bounds, share refused, verdict.

The NIS of a component of a measurement is its squared test ratio: innovation over the standard deviation that the filter
states for it, of estimate and measurement together.  For a consistent filter it has the mean 1.

Bounds: the sum over n independent components is chi-square with n degrees of freedom.  Slow errors of an instrument and slow
errors of the filter make innovations dependent, and n too large.  So the run is cut into `BLOCKS` blocks with equal numbers
of measurements.  With S_j the sum of a block, n_j its components and m the mean NIS, the variance of the sums is compared with
that of independent components:

    D = max(1, sum (S_j - m n_j)^2 / (BLOCKS - 1) / (2 m^2 mean n_j)),     degrees of freedom n / D

This needs no model of the dependence.  It does not see one that is longer than a block.

The rule, `judged`, takes numbers or symbols: Python evaluates it after a run, and a live page runs it compiled (`equation`).

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), section 5.4.2;
blocks: batch means, Law and Kelton, "Simulation Modeling and Analysis", section 9.5.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache, reduce
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv.core.elementary import maximum, polynomial, select
from insenv.evaluation.chi_square import bound_polynomial, quantile

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
REFUSED_OVERCONFIDENT = 0.1
"""Share of refused measurements that is not explained by occasional outliers."""
REFUSED_DIVERGED = 0.5
"""Share of refused measurements from which filter and instrument have parted."""
APART = 5.0
"""RMS of the test ratios used, of a group of components, from which filter and instrument have parted.

By default a single ratio of this size is refused.
"""
LAST = 0.75
"""Diverged is a filter that has parted from its measurements over the whole run, or over those after this share of them."""
FEWEST = 8
"""Measurements below which no filter is called diverged for the last of them."""
_POSITIVE = 1e-300
"""Smallest divisor: a value divided by it is not used."""


@dataclass(frozen=True)
class Sums:
    """What a filter reports of one instrument, numbers or symbols: sums over all measurements up to one record or to several.

    count, refused (records,): measurements, and those of which the gate refused a component.
    used, used_number, left, left_number (records, groups): squared test ratios of the components used and of those refused, and
    the numbers of these components.
    """

    count: Any
    refused: Any
    used: Any
    used_number: Any
    left: Any
    left_number: Any

    @classmethod
    def of(cls, rows: Mapping[str, Array], names: tuple[str, ...]) -> Sums:
        """From recorded rows by name; names: in the order of the fields."""
        values = [np.asarray(rows[name], dtype=np.float64).reshape(len(rows[name]), -1) for name in names]
        return cls(values[0][:, 0], values[1][:, 0], *values[2:])

    def at(self, records: Any) -> Sums:
        """Those at some records, or at one."""
        return Sums(*(getattr(self, each.name)[records] for each in fields(self)))

    @property
    def groups(self) -> int:
        """Number of groups of components."""
        return int(self.used.shape[-1])


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
    def below(self) -> bool:
        """Whether it shows innovations that are notably smaller than stated."""
        return bool(self.mean < min(self.low, NOTABLE**-2))

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {"nis": self.mean, "nis_bounds": [self.low, self.high]}


NO_NIS = Nis(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True)
class Judgement:
    """How a filter and an instrument agree.

    verdict: its place in `VERDICTS`.  factor: RMS of the test ratios, refused components included, of the group with the
    largest.  nis: of all components used.  groups: of each group of components.
    """

    verdict: Any
    factor: Any
    nis: Nis
    groups: tuple[Nis, ...]


def judged(ends: Sums, late: Sums, blocks: Any, bounds: Callable[[Any], tuple[Any, Any]]) -> Judgement:
    """The judgement from sums at the ends of the blocks, the last of which is the end of the run, and at one record before.

    late: at the record after which the last part of the measurements comes.  blocks: number of blocks that hold measurements.
    bounds: of degrees of freedom, the bounds of the mean NIS.
    """
    groups = range(ends.groups)
    nis = _nis(_sum(ends.used), _sum(ends.used_number), blocks, bounds)
    each = tuple(_nis(ends.used[:, k], ends.used_number[:, k], blocks, bounds) for k in groups)
    count, refused = ends.count[-1], ends.refused[-1]
    used, used_number, left, left_number = (
        [_number(values[-1, k]) for k in groups] for values in (ends.used, ends.used_number, ends.left, ends.left_number)
    )
    of_late, refused_late = count - late.count, refused - late.refused
    parted = [used[k] - late.used[k] > APART**2 * maximum(used_number[k] - late.used_number[k], 1.0) for k in groups]
    diverged = _any(
        refused > REFUSED_DIVERGED * count,
        (of_late >= FEWEST) * _any(refused_late > REFUSED_DIVERGED * of_late, *parted),
    )
    overconfident = _any(refused > REFUSED_OVERCONFIDENT * count, nis.above, *(one.above for one in each))
    tested = _any(*(used_number[k] + left_number[k] > 0 for k in groups))
    squares = [(used[k] + left[k]) / maximum(used_number[k] + left_number[k], 1.0) for k in groups]
    return Judgement(
        verdict=select(tested, select(diverged, 3, select(overconfident, 2, 1)), 0),
        factor=ca.sqrt(reduce(maximum, squares)),
        nis=nis,
        groups=each,
    )


def _nis(squares: Any, numbers: Any, blocks: Any, bounds: Callable[[Any], tuple[Any, Any]]) -> Nis:
    """Of the sums of squared test ratios and of components (blocks,) up to the end of each block."""
    square, number = _number(squares[-1]), _number(numbers[-1])
    if isinstance(number, float) and number == 0.0:
        return NO_NIS
    mean = square / number
    off = _steps(squares) - mean * _steps(numbers)
    white = 2 * mean**2 * (number / blocks)
    spread = _total(off**2) / maximum(blocks - 1, 1) / maximum(white, _POSITIVE)
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


def of_records(sums: Sums) -> Judgement:
    """The judgement of a run, from its records."""
    count = sums.count
    edges = np.array([len(count) - 1])
    if count[-1] >= 2 * BLOCKS:  # the first record with each multiple of 1 / `BLOCKS` of the measurements
        edges = np.unique(np.searchsorted(count, np.arange(1, BLOCKS + 1) * (count[-1] / BLOCKS), side="left"))
    late = int(np.searchsorted(count, LAST * count[-1], side="left"))
    return judged(sums.at(edges), sums.at(late), len(edges), _bounds)


def _bounds(degrees: float) -> tuple[float, float]:
    low, high = (float(bound) / degrees for bound in quantile(PROBABILITIES, degrees))
    return low, high


@lru_cache
def equation(groups: int) -> ca.Function:
    """`judged` for a live page: (sums at the ends of `BLOCKS` blocks, sums late) -> numbers.

    Sums: one record after another, each in the order of `Sums` (2 + 4 groups).  A run with fewer blocks repeats its last one.
    Numbers: verdict, factor, then mean, low and high of all components and of each group.
    """
    width = 2 + 4 * groups
    ends, late = ca.SX.sym("e", BLOCKS * width), ca.SX.sym("l", width)
    rows = _columns(ca.reshape(ends, width, BLOCKS).T, groups)
    blocks = ca.sum1(_steps(rows.count) > 0)
    polynomials = [bound_polynomial(probability) for probability in PROBABILITIES]

    def bounds(degrees: Any) -> tuple[Any, Any]:
        low, high = (polynomial(1.0 / ca.sqrt(degrees), one) ** 3 for one in polynomials)
        return low, high

    judgement = judged(rows, _columns(late.T, groups), blocks, bounds)
    numbers = [number for one in (judgement.nis, *judgement.groups) for number in (one.mean, one.low, one.high)]
    return ca.Function("judge", [ends, late], [ca.vertcat(judgement.verdict, judgement.factor, *numbers)], {"cse": True})


def _columns(rows: Any, groups: int) -> Sums:
    """Sums from rows of numbers (records, 2 + 4 groups)."""
    parts = [rows[:, 2 + k * groups : 2 + (k + 1) * groups] for k in range(4)]
    return Sums(rows[:, 0], rows[:, 1], *parts)
