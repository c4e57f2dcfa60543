"""A receiver's values that a logger repeats in every row until the next ones arrive: each counts as one fix.

If they counted as fixes of their own, each would be used a hundred times, late, with the same error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.logs.units import Array

FEWEST = 3
"""Different fixes from which the receiver's interval is known."""
ASSUMED_S = 1.0
"""The receiver's interval where there are fewer: its values never change."""
FAST_S = 0.05
"""Rows farther apart are a receiver's own: a receiver at rest may state the same place again and again."""


@dataclass(frozen=True)
class Repeats:
    """Rows (k,) that are fixes of their own, and the number of rows that each stands for, in the median."""

    rows: np.ndarray
    each: int


def repeats(time: Array, values: Array) -> Repeats | None:
    """The rows that hold new values; None if the rows are not repetitions.

    time (n,) s; values (n, k): position and, where the receiver has it, velocity. A value that stays longer than usual, as that
    of a receiver at rest may, counts again after each usual interval.
    """
    if len(time) < 2:
        return None
    new = np.concatenate([[True], (np.diff(values, axis=0) != 0.0).any(axis=1)])
    first = np.flatnonzero(new)
    length = np.diff(np.append(first, len(time)))
    known = len(first) >= FEWEST
    each = int(np.median(length[:-1])) if known else len(time)
    step = float(np.median(np.diff(time)))
    if each < 2 or (not known and step > FAST_S):
        return None
    interval = float(np.median(np.diff(time[first]))) if known else ASSUMED_S
    rows: list[int] = []
    for begin, count in zip(first, length, strict=True):
        last = float(time[begin + count - 1])
        again = np.arange(float(time[begin]), last - 0.5 * interval, interval)[1:]
        rows += [int(begin), *np.searchsorted(time, again - 1e-9).tolist()]
    return Repeats(np.array(rows, dtype=np.int64), max(round(len(time) / len(rows)), 1))
