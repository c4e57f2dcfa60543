"""From a section of a log description to checked columns: files joined, rows selected, times in seconds and increasing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.columns import FileSection, MeasurementSection, before, window_words
from insenv.logs.description import PositionSection
from insenv.logs.formats.csv_table import Column, TextTable, check_finite
from insenv.logs.formats.series import nearest_rows
from insenv.logs.recorded import Source
from insenv.logs.section_files import SectionFile, located, open_files
from insenv.logs.units import ANGLE_UNITS, TIME_UNITS

# Columns of several files side by side: row by row where they have the same times, otherwise by time.


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


_MIN_AGE_S = -1.0
"""Smallest age of a measurement on arrival, s: a delay that a receiver underestimates makes it negative."""
_RADIANS = declared(
    "degrees-or-radians", "{name}: latitude and longitude in degrees lie within +-1.57 and +-3.14: are they radians?"
)


@dataclass
class LogReader:
    """Reads the sections of a description and collects the files read and the notes for the user.

    folder: where relative paths start; start_s, stop_s: the part of the log that is used.  left_out: number of rows before
    start_s, by section.
    """

    folder: Path
    start_s: float | None = None
    stop_s: float | None = None
    sources: list[Source] = field(default_factory=list)
    notes: list[Remark] = field(default_factory=list)
    left_out: dict[str, int] = field(default_factory=dict)

    def read(
        self,
        name: str,
        section: FileSection,
        columns: Sequence[Column] | None = None,
        optional: Sequence[Column] = (),
        between: bool = False,
    ) -> tuple[TextTable, Array]:
        """Columns of a section from start_s to stop_s, and their time stamps [s], strictly increasing.

        columns: None: all that the section names. optional: columns that may hold no value: NaN. between: whether columns of
        files with other times may be interpolated. Raises InputError.
        """
        table, tables = self._tables(name, section, section.named_columns() if columns is None else columns, optional, between)
        check_finite(table, optional)
        for part in tables:
            self.sources.append(Source(name, part.label, part.values.shape[0], table.values.shape[0], part.sha256))
            self.notes += part.notes
        time = table.column(section.time) * (TIME_UNITS[section.time_unit] * section.time_scale) + section.time_offset_s
        _check_increasing(table, time)
        return self._within(name, table, time)

    def validity(
        self, section: MeasurementSection, table: TextTable, stamp: Array, oldest: float = 3600.0
    ) -> tuple[Array, Array | None, Array | None]:
        """Times of validity (m,) s, arrivals and ages: None of both where the stamps are those of validity.

        oldest: largest age that estimators take, s.  Raises `InputError` for another age.
        """
        if section.age is None:
            return stamp, None, None
        age = table.column(section.age)
        bad = (age < _MIN_AGE_S) | (age > oldest)
        table.refuse([section.age], bad, lambda row, _: f"age is {age[row]:g} s, allowed {_MIN_AGE_S:g} to {oldest:g} s")
        time = stamp - age
        _check_increasing(table, time)
        return time, stamp, age

    def _tables(
        self, name: str, section: FileSection, columns: Sequence[Column], optional: Sequence[Column], between: bool
    ) -> tuple[TextTable, list[TextTable]]:
        """The rows that keep_where leaves, of all files of the section together, and the whole table of each file."""
        files = open_files(name, dict(section), self.folder)
        selecting = _selecting(section)
        if len(files) == 1:
            columns = list(dict.fromkeys((section.time, *columns, *selecting)))
            table = files[0].table(columns, skip_empty=section.skip_empty, optional=optional)
            return _selected(name, section, table, _chosen(table, selecting)), [table]
        tables = _side_by_side(name, section, files, list(dict.fromkeys(columns)), optional)
        return join(name, _selected_together(name, section, tables, selecting), between, self.notes), tables

    def _within(self, name: str, table: TextTable, time: Array) -> tuple[TextTable, Array]:
        low = -math.inf if self.start_s is None else self.start_s
        high = math.inf if self.stop_s is None else self.stop_s
        early, late = before(time, low), before(-time, -high)
        self.left_out[name] = int(np.count_nonzero(early))
        inside = ~(early | late)
        if not inside.any():
            raise InputError(
                f"{table.label}: no {name} rows {window_words(self.start_s, self.stop_s)}: its times are {time[0]:.3f} to"
                f" {time[-1]:.3f} s"
            )
        return table.select(inside), time[inside]


def check_columns(name: str, section: Mapping[str, Any], model: type[FileSection], folder: Path) -> None:
    """Raise one `InputError` for the columns named in a section that none of its files has, or several, whatever else is wrong.

    section: its TOML values, unchecked, completed by its format; model: what it should be.
    """
    right = dict(section)
    if not isinstance(right.get("header_rows", 0), int):
        del right["header_rows"]
    if right.get("delimiter") not in (",", ";", "tab", "space"):
        right.pop("delimiter", None)
    if not isinstance(right.get("comment", ""), str):
        del right["comment"]
    files = open_files(name, right, folder)
    if not any(isinstance(column, str) for file in files for column in file.names()):
        return
    values = [section.get(key) for key in model.column_keys()]
    columns = [each for value in values for each in (value if isinstance(value, (list, tuple)) else [value])]
    located(name, files, [column for column in columns if isinstance(column, str) and column != section.get("time")])


def checked_position(name: str, section: PositionSection, table: TextTable, notes: list[Remark]) -> tuple[Array, Array]:
    """Latitude and longitude [rad]. Raises InputError if out of range; adds a note if degrees look like radians."""
    unit = section.position_unit
    assert unit is not None and section.latitude is not None and section.longitude is not None
    factor = ANGLE_UNITS[unit]
    result = []
    for what, column, limit in (("latitude", section.latitude, 90.0), ("longitude", section.longitude, 360.0)):
        values, reach = table.column(column), math.radians(limit) / factor
        bad = np.abs(values * factor) > math.radians(limit) * (1 + 1e-12)
        swap = " Or are latitude and longitude exchanged?" if what == "latitude" else ""
        allowed = f"allowed {-reach:.6g} to {reach:.6g} {unit}; is position_unit = {unit!r} right?{swap}"
        table.refuse([column], bad, lambda row, _: f"{what} is {values[row]:.10g} {unit}, {allowed}")  # noqa: B023
        result.append(np.clip(values * factor, -math.radians(limit), math.radians(limit)))
    latitude, longitude = result
    if unit == "deg" and np.all(np.abs(latitude) < factor * 1.5708) and np.all(np.abs(longitude) < factor * 3.1416):
        notes.append(_RADIANS.filled(name=name))
    return latitude, longitude


def ned_velocity(section: PositionSection, table: TextTable) -> Array | None:
    """The velocity columns (n, 3) m/s with the third one down; None if the section names none."""
    if section.velocity is None:
        return None
    return table.columns(section.velocity) * np.array([1.0, 1.0, -1.0 if section.velocity_vertical == "up" else 1.0])


def _selecting(section: FileSection) -> dict[Column, Any]:
    """keep_where of a section by column; TOML writes column numbers as text."""
    return {int(k) if k.isdigit() else k: v for k, v in section.keep_where.items()}


def _chosen(table: TextTable, selecting: Mapping[Column, Any]) -> np.ndarray:
    """The rows (n,) of bool that keep_where leaves, by those of its columns that the table has."""
    chosen = np.ones(len(table.lines), bool)
    for column, value in selecting.items():
        if column in table.names:
            chosen &= np.isin(table.column(column), np.atleast_1d(value))
    return chosen


def _selected(name: str, section: FileSection, table: TextTable, chosen: np.ndarray) -> TextTable:
    if not chosen.any():
        raise InputError(f"{table.label}: no row is left by {name}.keep_where = {section.keep_where}")
    return table.select(chosen)


def _selected_together(
    name: str, section: FileSection, tables: Sequence[TextTable], selecting: Mapping[Column, Any]
) -> list[TextTable]:
    """The tables before they are joined: of files with the same times a row is kept if it is in all, of others in its own.

    Without the columns of keep_where, but for the others that a key names.
    """
    chosen = [_chosen(table, selecting) for table in tables]
    if all(np.array_equal(table.values[:, 0], tables[0].values[:, 0]) for table in tables[1:]):
        chosen = [np.logical_and.reduce(chosen)] * len(tables)
    selected = [_selected(name, section, table, rows) for table, rows in zip(tables, chosen, strict=True)]
    named = set(section.named_columns())
    return [_only(table, [0, *(k for k, each in enumerate(table.names) if k and each in named)]) for table in selected]


def _only(table: TextTable, places: list[int]) -> TextTable:
    return replace(table, names=tuple(table.names[k] for k in places), values=table.values[:, places])


def _side_by_side(
    name: str, section: FileSection, files: Sequence[SectionFile], columns: Sequence[Column], optional: Sequence[Column]
) -> list[TextTable]:
    """The table of each file: the time, the columns that it has of those named, and all of keep_where that it has."""
    places = located(name, files, [column for column in columns if column != section.time])
    for column in _selecting(section):
        owners = [each for each, file in zip(places, files, strict=True) if column in file.names()]
        if owners:
            for each in owners:
                each.setdefault(column, column)
        else:
            for each, place in zip(places, located(name, files, [column]), strict=True):
                each |= place
    tables = []
    for file, place in zip(files, places, strict=True):
        may_lack = [place[column] for column in optional if column in place]
        table = file.table([section.time, *place.values()], skip_empty=section.skip_empty, optional=may_lack)
        tables.append(replace(table, names=(section.time, *place)))
    return tables


def _check_increasing(table: TextTable, time: Array) -> None:
    bad = np.flatnonzero(np.diff(time) <= 0)
    if not bad.size:
        return
    row = int(bad[0])
    before, after = float(time[row]), float(time[row + 1])
    if after == before:
        raise InputError(
            f"{table.where(row + 1)}: time {after!r} s twice (also {table.row} {table.lines[row]}); times must increase"
        )
    week = "; a GNSS week rollover? use a continuous time" if 604000 < before - after < 605600 else ""
    raise InputError(
        f"{table.where(row + 1)}: time goes backwards from {before!r} s ({table.row} {table.lines[row]}) to {after!r} s{week}"
    )
