"""From a section of a log description to checked columns: files joined, rows selected, times in seconds and increasing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.logs.columns import FileSection, MeasurementSection, window_words
from insenv.logs.description import PositionSection
from insenv.logs.files import all_of, read_bytes
from insenv.logs.formats.csv_table import Column, TextTable, check_finite, column_names, read_table
from insenv.logs.joining import join
from insenv.logs.recorded import Source
from insenv.logs.units import ANGLE_UNITS, TIME_UNITS, Array

_NEWEST = -1.0
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
        columns: Sequence[Column],
        expected_fields: Sequence[int] | None = None,
        variants: Mapping[int, Sequence[Column]] | None = None,
        optional: Sequence[Column] = (),
        between: bool = False,
    ) -> tuple[TextTable, Array]:
        """The section's columns from start_s to stop_s, and their time stamps [s], strictly increasing.

        expected_fields: allowed numbers of fields per line; None: any. variants: further columns to read, by the number of
        fields of a file that has them. optional: columns that may hold no value: NaN. between: whether columns of files with
        other times may be interpolated. Raises InputError.
        """
        table, tables = self._tables(name, section, columns, expected_fields, variants or {}, optional, between)
        keep = _kept_columns(section)
        chosen = np.ones(table.values.shape[0], bool)
        for column_name, value in keep.items():
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
        bad = np.flatnonzero((age < _NEWEST) | (age > oldest))
        if bad.size:
            raise InputError(
                f"{table.where(bad[0])}, column {section.age!r}: age is {age[bad[0]]:g} s, allowed {_NEWEST:g} to {oldest:g} s"
            )
        time = stamp - age
        _check_increasing(table, time)
        return time, stamp, age

    def _tables(
        self,
        name: str,
        section: FileSection,
        columns: Sequence[Column],
        expected_fields: Sequence[int] | None,
        variants: Mapping[int, Sequence[Column]],
        optional: Sequence[Column],
        between: bool,
    ) -> tuple[TextTable, list[TextTable]]:
        """The table of all files of the section, and that of each file."""
        wanted = list(dict.fromkeys((section.time, *columns, *_kept_columns(section))))
        layout: dict[str, Any] = {
            "delimiter": section.delimiter,
            "header_rows": section.header_rows,
            "comment": section.comment,
        }
        options = {**layout, "skip_empty": section.skip_empty, "optional": optional}
        loaded = all_of(lambda file: read_bytes(file, self.folder), section.file)
        if len(loaded) > 1:
            tables = _read_side_by_side(name, loaded, section.time, wanted, layout, options)
            return join(name, tables, between, self.notes), tables
        options["expected_fields"] = None if expected_fields is None else (*expected_fields, *variants)
        table = read_table(*loaded[0], wanted, **options)
        if table.fields in variants:
            table = read_table(*loaded[0], [*wanted, *variants[table.fields]], **options)
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


def check_columns(section: Mapping[str, Any], keys: Sequence[str], folder: Path) -> None:
    """Raise one `InputError` for all columns named in a section that its files do not have, whatever else is wrong with it.

    section: its TOML values, unchecked; keys: those that name columns.
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
    wanted = [one for key in keys for one in (section[key] if isinstance(section.get(key), list) else [section.get(key)])]
    missing = [name for name in wanted if isinstance(name, str) and name not in known]
    if known and missing:
        labels = ", ".join(label for label, _ in loaded)
        raise InputError("\n".join(f"{labels}: no column {name!r}{nearest(name, known)}" for name in missing))


def checked_position(name: str, section: PositionSection, table: TextTable, notes: list[str]) -> tuple[Array, Array]:
    """Latitude and longitude [rad]. Raises InputError if out of range; adds a note if degrees look like radians."""
    unit = section.position_unit
    assert unit is not None and section.latitude is not None and section.longitude is not None
    factor = ANGLE_UNITS[unit]
    result = []
    for what, column_name, limit in (("latitude", section.latitude, 90.0), ("longitude", section.longitude, 360.0)):
        values = table.column(column_name)
        bad = np.flatnonzero(np.abs(values * factor) > math.radians(limit) * (1 + 1e-12))
        if bad.size:
            reach = math.radians(limit) / factor
            raise InputError(
                f"{table.where(bad[0])}, column {column_name!r}: {what} is {values[bad[0]]:.10g} {unit},"
                f" allowed {-reach:.6g} to {reach:.6g} {unit}; is position_unit = {unit!r} right?"
            )
        result.append(np.clip(values * factor, -math.radians(limit), math.radians(limit)))
    latitude, longitude = result
    if unit == "deg" and np.all(np.abs(latitude) < factor * 1.5708) and np.all(np.abs(longitude) < factor * 3.1416):
        notes.append(f"{name}: latitude and longitude in degrees lie within +-1.57 and +-3.14: are they radians?")
    return latitude, longitude


def _kept_columns(section: FileSection) -> dict[Column, Any]:
    """keep_where of a section by column; TOML writes column numbers as text."""
    return {int(k) if k.isdigit() else k: v for k, v in section.keep_where.items()}


def _read_side_by_side(
    name: str,
    loaded: Sequence[tuple[str, bytes]],
    time: Column,
    wanted: Sequence[Column],
    layout: Mapping[str, Any],
    options: Mapping[str, Any],
) -> list[TextTable]:
    if not all(isinstance(c, str) for c in wanted):
        raise InputError(f"{name}.file: with several files the columns must be given by name, not by number")
    headers = [column_names(label, raw, **layout) for label, raw in loaded]
    every = list(dict.fromkeys(h for header in headers for h in header))
    left = [c for c in wanted if c != time]
    tables = []
    files = ", ".join(label for label, _ in loaded)
    missing = [f"{files}: no column {c!r}{nearest(str(c), every)}" for c in left if c not in every]
    if missing:
        raise InputError("\n".join(missing))
    for (label, raw), header in zip(loaded, headers, strict=True):
        here = [c for c in left if c in header]
        left = [c for c in left if c not in here]
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
