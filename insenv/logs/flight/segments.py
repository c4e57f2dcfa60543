"""Time in a flight log: restarts of the clock, gaps, samples twice or out of order."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from insenv.logs.flight.series import AnySeries, ImuSeries
from insenv.logs.units import Array

RESTART_S = 1.0
"""A clock that goes back by more has restarted; by less, samples are out of order."""


def restarts(time: Array) -> np.ndarray:
    """Number of restarts of the clock before each row: (n,) integers."""
    return np.concatenate([[0], np.cumsum(np.diff(time) < -RESTART_S)]).astype(np.int64)


def rows_of(series: AnySeries, rows: np.ndarray) -> AnySeries:
    """The series with only these rows, in this order."""
    length = series.time.size
    picked: dict[str, Any] = {}
    for each in fields(series):
        value = getattr(series, each.name)
        if isinstance(value, np.ndarray) and value.shape[:1] == (length,):
            picked[each.name] = value[rows]
    return replace(series, **picked)


def ordered(series: AnySeries) -> tuple[AnySeries, int]:
    """The series in order of time, each time once; number of rows removed or moved."""
    steps = np.diff(series.time)
    wrong = int(np.count_nonzero(steps <= 0.0))
    if not wrong:
        return series, 0
    _, first = np.unique(series.time, return_index=True)
    return rows_of(series, first), wrong


def longest(imu: ImuSeries, inside: np.ndarray, max_gap_s: float, notes: list[str]) -> tuple[ImuSeries, int]:
    """The samples `inside` of the longest segment without a restart or a gap longer than `max_gap_s`, in order of time.

    Returns them and the number of restarts before them. Appends to `notes`.
    """
    part = restarts(imu.time)
    nominal = 1.0 / imu.rate_hz
    best: tuple[float, ImuSeries, int] | None = None
    count, moved = 0, 0
    for number in np.unique(part[inside]):
        piece, wrong = ordered(rows_of(imu, np.flatnonzero(inside & (part == number))))
        moved += wrong
        edges = np.flatnonzero(np.diff(piece.time) > max_gap_s + nominal)
        for begin, end in zip([0, *(edges + 1)], [*(edges + 1), piece.time.size], strict=True):
            count += 1
            duration = float(piece.time[end - 1] - piece.time[begin])
            if best is None or duration > best[0]:
                best = duration, rows_of(piece, np.arange(begin, end)), int(number)
    assert best is not None  # `inside` is not empty
    _, chosen, number = best
    if moved:
        notes.append(f"{moved} samples twice or out of order: sorted, each time once")
    if count > 1:
        notes.append(
            f"{count} segments between restarts and gaps longer than {max_gap_s:g} s: the longest is used,"
            f" {chosen.time[0]:.3f} to {chosen.time[-1]:.3f} s (start_s and stop_s select another one)"
        )
    return chosen, number


def only(series: AnySeries, part: int, what: str, notes: list[str]) -> AnySeries | None:
    """The rows after `part` restarts, in order; None, with a note, if the series has fewer restarts."""
    of = restarts(series.time)
    if part > of[-1]:
        notes.append(f"{what}: {series.name} lacks a restart of the clock that the inertial unit has: not used")
        return None
    return ordered(rows_of(series, np.flatnonzero(of == part)))[0]
