"""From a section of a log description to checked columns: files joined, rows selected, times in seconds and increasing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.logs import kf_gins
from insenv.logs.columns import FileSection, MeasurementSection, window_words
from insenv.logs.description import PositionSection
from insenv.logs.files import all_of, read_bytes
from insenv.logs.formats.csv_table import Column, TextTable, check_delimiter, check_finite, column_names, read_table
from insenv.logs.joining import join
from insenv.logs.recorded import Source
from insenv.logs.units import ANGLE_UNITS, TIME_UNITS, Array

_MIN_AGE_S = -1.0
"""Smallest age of a measurement on arrival, s: a delay that a receiver underestimates makes it negative."""


@dataclass
class LogReader:
    """Reads the sections of a description and collects the files read and the notes for the user.

    folder: where relative paths start; start_s, stop_s: the part of the log that is used.
    """

    folder: Path
    start_s: float | None = None
    stop_s: float | None = None
    sources: list[Source] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

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
        chosen = np.ones(table.values.shape[0], bool)
        for column_name, value in _selecting(section).items():
            chosen &= np.isin(table.column(column_name), np.atleast_1d(value))
        if not chosen.any():
            raise InputError(f"{table.label}: no row is left by {name}.keep_where = {section.keep_where}")
        table = table.select(chosen)
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
        """The table of all files of the section, and that of each file."""
        columns = list(dict.fromkeys((section.time, *columns, *_selecting(section))))
        layout: dict[str, Any] = {
            "delimiter": section.delimiter,
            "header_rows": section.header_rows,
            "comment": section.comment,
        }
        options = {**layout, "skip_empty": section.skip_empty, "optional": optional}
        files = all_of(lambda file: read_bytes(file, self.folder), section.file)
        if len(files) > 1:
            tables = _read_side_by_side(name, files, section.time, columns, layout, options)
            return join(name, tables, between, self.notes), tables
        options["expected_fields"] = kf_gins.allowed_fields(name, section)
        table = read_table(*files[0], columns, **options)
        if kf_gins.has_velocity(name, section, table.fields):
            further = [column for group in kf_gins.GNSS_VELOCITY.values() for column in group]
            table = read_table(*files[0], [*columns, *further], **options)
        return table, [table]

    def _within(self, name: str, table: TextTable, time: Array) -> tuple[TextTable, Array]:
        low = -math.inf if self.start_s is None else self.start_s
        high = math.inf if self.stop_s is None else self.stop_s
        inside = (time >= low) & (time <= high)
        if not inside.any():
            raise InputError(
                f"{table.label}: no {name} rows {window_words(self.start_s, self.stop_s)}: its times are {time[0]:.3f} to"
                f" {time[-1]:.3f} s"
            )
        return table.select(inside), time[inside]


def check_columns(section: Mapping[str, Any], model: type[FileSection], folder: Path) -> None:
    """Raise one `InputError` for all columns named in a section that its files do not have, whatever else is wrong with it.

    section: its TOML values, unchecked; model: what it should be.
    """
    files = section.get("file")
    files = [files] if isinstance(files, str) else files
    if section.get("format", "csv") != "csv" or not isinstance(files, list) or not all(isinstance(f, str) and f for f in files):
        return
    layout: dict[str, Any] = {}
    if isinstance(section.get("header_rows"), int):
        layout["header_rows"] = section["header_rows"]
    if section.get("delimiter") in (",", ";", "tab", "space"):
        layout["delimiter"] = section["delimiter"]
    loaded = all_of(lambda file: read_bytes(file, folder), files)
    known = [name for label, raw in loaded for name in column_names(label, raw, **layout)]
    values = [section.get(key) for key in model.column_keys()]
    columns = [each for value in values for each in (value if isinstance(value, list) else [value])]
    if known:
        _check_known([name for name in columns if isinstance(name, str)], known, [label for label, _ in loaded])


def _check_known(columns: Sequence[str], known: Sequence[str], files: Sequence[str]) -> None:
    """Raise one InputError for all columns that the files do not have; known: those that they have."""
    if len(known) == len(files):
        check_delimiter(files[0], known)
    missing = [f"{', '.join(files)}: no column {name!r}{nearest(name, known)}" for name in columns if name not in known]
    if missing:
        raise InputError("\n".join(missing))


def checked_position(name: str, section: PositionSection, table: TextTable, notes: list[str]) -> tuple[Array, Array]:
    """Latitude and longitude [rad]. Raises InputError if out of range; adds a note if degrees look like radians."""
    unit = section.position_unit
    assert unit is not None and section.latitude is not None and section.longitude is not None
    factor = ANGLE_UNITS[unit]
    result = []
    for what, column, limit in (("latitude", section.latitude, 90.0), ("longitude", section.longitude, 360.0)):
        values, reach = table.column(column), math.radians(limit) / factor
        bad = np.abs(values * factor) > math.radians(limit) * (1 + 1e-12)
        allowed = f"allowed {-reach:.6g} to {reach:.6g} {unit}; is position_unit = {unit!r} right?"
        table.refuse([column], bad, lambda row, _: f"{what} is {values[row]:.10g} {unit}, {allowed}")  # noqa: B023
        result.append(np.clip(values * factor, -math.radians(limit), math.radians(limit)))
    latitude, longitude = result
    if unit == "deg" and np.all(np.abs(latitude) < factor * 1.5708) and np.all(np.abs(longitude) < factor * 3.1416):
        notes.append(f"{name}: latitude and longitude in degrees lie within +-1.57 and +-3.14: are they radians?")
    return latitude, longitude


def _selecting(section: FileSection) -> dict[Column, Any]:
    """keep_where of a section by column; TOML writes column numbers as text."""
    return {int(k) if k.isdigit() else k: v for k, v in section.keep_where.items()}


def _read_side_by_side(
    name: str,
    files: Sequence[tuple[str, bytes]],
    time: Column,
    columns: Sequence[Column],
    layout: Mapping[str, Any],
    options: Mapping[str, Any],
) -> list[TextTable]:
    """The table of each file: the time, and those of the columns that it is the first to have."""
    names = [column for column in columns if isinstance(column, str)]
    if len(names) < len(columns):
        raise InputError(f"{name}.file: with several files the columns must be given by name, not by number")
    headers = [column_names(label, raw, **layout) for label, raw in files]
    left = [column for column in names if column != time]
    _check_known(left, list(dict.fromkeys(column for header in headers for column in header)), [label for label, _ in files])
    tables = []
    for (label, raw), header in zip(files, headers, strict=True):
        here = [column for column in left if column in header]
        left = [column for column in left if column not in here]
        tables.append(read_table(label, raw, [time, *here], **options))
    return tables


def _check_increasing(table: TextTable, time: Array) -> None:
    bad = np.flatnonzero(np.diff(time) <= 0)
    if not bad.size:
        return
    row = int(bad[0])
    before, after = float(time[row]), float(time[row + 1])
    if after == before:
        raise InputError(f"{table.where(row + 1)}: time {after!r} s twice (also line {table.lines[row]}); times must increase")
    week = "; a GNSS week rollover? use a continuous time" if 604000 < before - after < 605600 else ""
    raise InputError(
        f"{table.where(row + 1)}: time goes backwards from {before!r} s (line {table.lines[row]}) to {after!r} s{week}"
    )
