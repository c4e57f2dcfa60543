"""A receiver's values that a logger repeats in every row until the next ones arrive: each counts as one fix, at its first row.

Taken for fixes of their own, they would count a hundred times, late, with errors that are the same in all of them. In an outage
the last value is repeated for as long as it lasts, and is wrong by the whole way of the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.logs.units import Array

FEWEST = 3
"""Different fixes from which the receiver's interval is known."""
FAST_S = 0.05
"""Rows farther apart are a receiver's own: a receiver at rest may state the same place again and again."""


@dataclass(frozen=True)
class Repeats:
    """Rows (k,) that are fixes of their own, and the number of rows that each stands for, in the median."""

    rows: np.ndarray
    each: int


def repeats(time: Array, values: Array) -> Repeats | None:
    """The rows that hold new values; None if the rows are not repetitions.

    time (n,) s; values (n, k): position and, where the receiver has it, velocity.
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
    return Repeats(first, each)
