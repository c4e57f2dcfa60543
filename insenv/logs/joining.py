"""Columns of several files side by side: row by row where they have the same times, otherwise by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.logs.formats.csv_table import TextTable
from insenv.logs.formats.series import nearest_rows
from insenv.logs.units import Array

SAME_STEP_SHARE = 0.01
"""Times that differ by less than this part of the interval are the same: files round differently."""
GAP_STEPS = 5.0
"""A step of this many median steps is a gap."""
MIN_PARTNERS = 0.5
"""Share of the rows of the shortest file that must have partners in the others, if values between rows are not allowed."""
_JOINED = declared("rows-joined", "{name}: joined by time: {count} rows have the same time in {files}; the others are left out")
_BETWEEN = declared("rows-interpolated", "{name}: joined by time: {files} are interpolated at the {count} times of {first}")


def join(name: str, tables: Sequence[TextTable], between: bool, notes: list[Remark]) -> TextTable:
    """The table of several files; the first column of each is the time, and the first file's times are those of the table.

    Where the rows differ, those with the same time in all files are kept. If they are few and `between` is true, the columns
    of the other files are interpolated linearly at the first file's times. A note says which, and how many rows are left
    out. Raises InputError if the times do not fit.
    """
    first = tables[0]
    if all(np.array_equal(other.values[:, 0], first.values[:, 0]) for other in tables[1:]):
        return _beside(first, [other.values[:, 1:] for other in tables[1:]], tables)
    for table in tables:
        _check_order(table)
    time = first.values[:, 0]
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    partners = [_partners(time, other.values[:, 0], SAME_STEP_SHARE * step) for other in tables[1:]]
    same = np.all([partner >= 0 for partner in partners], axis=0)
    shortest = min(table.values.shape[0] for table in tables)
    files = ", ".join(f"{table.label} ({table.values.shape[0]} rows)" for table in tables)
    if np.count_nonzero(same) >= MIN_PARTNERS * shortest:
        notes.append(_JOINED.filled(name=name, count=np.count_nonzero(same), files=files))
        columns = [t.values[p[same], 1:] for t, p in zip(tables[1:], partners, strict=True)]
        return _beside(first.select(same), columns, tables)
    low, high = max(t.values[0, 0] for t in tables), min(t.values[-1, 0] for t in tables)
    inside = (time >= low) & (time <= high)
    for other in tables[1:]:
        inside &= ~_in_gap(time, other.values[:, 0])
    if not between or not inside.any():
        raise InputError(
            f"{name}: only {np.count_nonzero(same)} rows have the same time in {files}: joined files must have the same"
            f" clock{'' if between else ' and the same times'}"
        )
    notes.append(_BETWEEN.filled(name=name, files=files, count=np.count_nonzero(inside), first=first.label))
    columns = [
        np.column_stack([np.interp(time[inside], t.values[:, 0], column) for column in t.values[:, 1:].T])
        if t.values.shape[1] > 1
        else np.zeros((np.count_nonzero(inside), 0))
        for t in tables[1:]
    ]
    return _beside(first.select(inside), columns, tables)


def _beside(first: TextTable, columns: Sequence[Array], tables: Sequence[TextTable]) -> TextTable:
    names = (*first.names, *(n for t in tables[1:] for n in t.names[1:]))
    return replace(first, names=names, values=np.hstack([first.values, *columns]), notes=())


def _partners(time: Array, other: Array, tolerance: float) -> np.ndarray:
    """Index in `other` of the row with the same time as each in `time`; -1 where there is none."""
    near = nearest_rows(other, time)
    return np.where(np.abs(other[near] - time) <= tolerance, near, -1)


def _in_gap(time: Array, other: Array) -> np.ndarray:
    """Whether each time lies in a gap of the times `other`, over which nothing is to be interpolated."""
    steps = np.diff(other)
    if not steps.size:
        return np.ones(time.size, bool)
    after = np.searchsorted(other, time).clip(1, other.size - 1)
    return np.asarray((steps[after - 1] > GAP_STEPS * np.median(steps)) & (time > other[after - 1]) & (time < other[after]))


def _check_order(table: TextTable) -> None:
    bad = np.flatnonzero(np.diff(table.values[:, 0]) <= 0)
    if bad.size:
        row = int(bad[0]) + 1
        raise InputError(
            f"{table.where(row)}: time {float(table.values[row, 0])!r} does not follow {float(table.values[row - 1, 0])!r}:"
            " files with different rows are joined by time, which must increase"
        )
