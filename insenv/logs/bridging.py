"""Holes in the time stamps of an inertial sensor: found, bridged by linear interpolation of the rates,
counted.

The rule.  With T the nominal sample interval, a step s_i between two stamps is late when s_i > 1.5 T.  A late
stamp that is followed or preceded by early ones is jitter: what the two steps on either side fall short of T
is taken off.  What remains, divided by T and rounded, less one, is the number of missing samples.  The
missing stamps are put at equal distances between the two that are there, and their rates on the straight line
between the rates on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.errors import InputError
from insenv.logs.units import Array

LATE = 1.5
"""A step longer than this many nominal intervals may be a hole."""

NEIGHBOURS = 2
"""Steps on either side that may show a late stamp to be jitter."""


@dataclass(frozen=True)
class Gaps:
    """Holes that were bridged: count, samples put in, the longest [s], and (start, end) of each [s]."""

    count: int = 0
    samples: int = 0
    longest_s: float = 0.0
    intervals: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Bridged:
    """Samples without holes: time (n,) [s], rates (n, k), original (n,) whether the row was in the log,
    gaps."""

    time: Array
    rates: Array
    original: np.ndarray
    gaps: Gaps


def nominal_interval(time: Array, rate_hz: float | None, label: str = "imu") -> float:
    """Nominal sample interval [s]: of the stated rate, which the median step must meet within 5 %, or the
    median step."""
    if time.size < 3:
        raise InputError(f"{label}: {time.size} samples in the window, at least 3 are needed")
    median = float(np.median(np.diff(time)))
    if rate_hz is None:
        return median
    if abs(median * rate_hz - 1.0) > 0.05:
        raise InputError(
            f"{label}: imu.rate_hz = {rate_hz:g} Hz, but the median step of the time stamps is {median:.6g} s"
            f" ({1.0 / median:.6g} Hz): they must agree within 5 %; check time_unit and time_scale"
        )
    return 1.0 / rate_hz


def missing_samples(time: Array, interval: float) -> np.ndarray:
    """Number of samples missing after each stamp: (n - 1,) integers, by the rule at the top of this
    module."""
    steps = np.diff(time)
    short = np.minimum(steps - interval, 0.0)
    padded = np.concatenate((np.zeros(NEIGHBOURS), short, np.zeros(NEIGHBOURS)))
    size = steps.size
    around = np.zeros(size)
    for k in range(1, NEIGHBOURS + 1):
        around += padded[NEIGHBOURS - k : NEIGHBOURS - k + size] + padded[NEIGHBOURS + k : NEIGHBOURS + k + size]
    missing = np.rint((steps + around) / interval).astype(np.int64) - 1
    return np.where(steps > LATE * interval, np.maximum(missing, 0), 0)


def bridge(time: Array, rates: Array, interval: float, max_gap_s: float, label: str = "imu") -> Bridged:
    """Put in the missing samples.

    time (n,) [s] strictly increasing; rates (n, k) any unit per second; interval: nominal [s]; max_gap_s: the
    longest time without samples (step less one interval) that is bridged. Raises InputError where a hole is
    longer.
    """
    missing = missing_samples(time, interval)
    at = np.flatnonzero(missing)
    if not at.size:
        return Bridged(time, rates, np.ones(time.size, bool), Gaps())
    lengths = time[at + 1] - time[at] - interval
    long = np.flatnonzero(lengths > max_gap_s + 1e-9)
    if long.size:
        i = at[long[0]]
        raise InputError(
            f"{label}: no samples between {time[i]:.6f} s and {time[i + 1]:.6f} s: a gap of "
            f"{lengths[long[0]]:.6g} s,"
            f" allowed imu.max_gap_s = {max_gap_s:g} s ({long.size} such gap{'s' if long.size > 1 else ''} "
            f"in the log)"
        )
    total = time.size + int(missing.sum())
    place = np.arange(time.size)
    place[1:] += np.cumsum(missing)
    original = np.zeros(total, bool)
    original[place] = True
    position = np.arange(total)
    full_time = np.interp(position, place, time)
    full = np.column_stack([np.interp(full_time, time, column) for column in rates.T])
    full_time[place] = time
    full[place] = rates
    intervals = tuple((float(time[i]), float(time[i + 1])) for i in at)
    return Bridged(full_time, full, original, Gaps(len(at), int(missing.sum()), float(lengths.max()), intervals))
