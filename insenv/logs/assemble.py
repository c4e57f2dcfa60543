"""From a section of the description to checked columns: files joined, rows chosen, times in seconds and
increasing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insenv.errors import InputError, nearest
from insenv.logs.description import GnssSection, ImuSection, ReferenceSection
from insenv.logs.readers import Column, TextTable, check_finite, column_names, read_table
from insenv.logs.resources import read_bytes
from insenv.logs.units import ANGLE_UNITS, TIME_UNITS, Array

Section = ImuSection | GnssSection | ReferenceSection


@dataclass(frozen=True)
class Source:
    """A file that was read: the section it served, its name, rows read, rows used (after keep_where), SHA-256
    of its text."""

    section: str
    file: str
    rows_read: int
    rows_used: int
    sha256: str


def read_section(
    name: str,
    section: Section,
    columns: Sequence[Column],
    folder: Path,
    sources: list[Source],
    notes: list[str],
    expected_fields: Sequence[int] | None = None,
    more: Mapping[int, Mapping[str, tuple[Column, ...]]] | None = None,
) -> tuple[TextTable, Array]:
    """The section's columns and its time stamps [s], strictly increasing.

    more: fields per line -> further columns to read where a file has that many (the variants of a fixed
    format). Appends to `sources` and `notes`. Raises InputError.
    """
    keep = {int(k) if k.isdigit() else k: v for k, v in section.keep_where.items()}
    wanted = list(dict.fromkeys((section.time, *columns, *keep)))
    layout: dict[str, Any] = {
        "delimiter": section.delimiter,
        "header_rows": section.header_rows,
        "comment": section.comment,
    }
    options = {**layout, "skip_empty": section.skip_empty}
    loaded = [read_bytes(file, folder) for file in section.file]
    if len(loaded) == 1:
        label, raw = loaded[0]
        allowed = None if expected_fields is None else (*expected_fields, *(more or {}))
        table = read_table(label, raw, wanted, **options, expected_fields=allowed)
        for group in (more or {}).get(table.fields, {}).values():
            wanted += group
        if len(wanted) > len(table.names):
            table = read_table(label, raw, wanted, **options, expected_fields=allowed)
        tables = [table]
    else:
        tables = _read_side_by_side(name, loaded, section.time, wanted, layout, options)
        table = _join(tables)
    chosen = np.ones(table.values.shape[0], bool)
    for column_name, value in keep.items():
        chosen &= np.isin(table.column(column_name), np.atleast_1d(value))
    if not chosen.any():
        raise InputError(f"{table.label}: no row is left by {name}.keep_where = {section.keep_where}")
    table = table.select(chosen)
    check_finite(table)
    for part in tables:
        sources.append(Source(name, part.label, part.values.shape[0], table.values.shape[0], part.sha256))
        notes += part.notes
    time = table.column(section.time) * (TIME_UNITS[section.time_unit] * section.time_scale) + section.time_offset_s
    _check_increasing(table, time)
    return table, time


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
    for missing in (c for c in left if c not in every):
        files = ", ".join(label for label, _ in loaded)
        raise InputError(f"{files}: no column {missing!r}{nearest(str(missing), every)}")
    for (label, raw), header in zip(loaded, headers, strict=True):
        here = [c for c in left if c in header]
        left = [c for c in left if c not in here]
        tables.append(read_table(label, raw, [time, *here], **options))
    return tables


def _join(tables: Sequence[TextTable]) -> TextTable:
    """Columns of several files with the same rows side by side; the first column of each is the time."""
    first = tables[0]
    for other in tables[1:]:
        if other.values.shape[0] != first.values.shape[0]:
            raise InputError(
                f"{other.label}: {other.values.shape[0]} rows, but {first.label} has {first.values.shape[0]}:"
                " files that are joined must have the same rows"
            )
        differ = np.flatnonzero(other.values[:, 0] != first.values[:, 0])
        if differ.size:
            row = differ[0]
            raise InputError(
                f"{other.where(row)}: time {float(other.values[row, 0])!r} differs from "
                f"{float(first.values[row, 0])!r}"
                f" in {first.where(row)}: files that are joined must have the same rows"
            )
    names = (*first.names, *(n for t in tables[1:] for n in t.names[1:]))
    values = np.hstack([first.values, *(t.values[:, 1:] for t in tables[1:])])
    return TextTable(first.label, names, values, first.lines, first.fields, first.sha256)


def _check_increasing(table: TextTable, time: Array) -> None:
    bad = np.flatnonzero(np.diff(time) <= 0)
    if not bad.size:
        return
    row = int(bad[0])
    before, after = float(time[row]), float(time[row + 1])
    if after == before:
        raise InputError(f"{table.where(row + 1)}: time {after!r} s twice (also line {table.lines[row]}); times must increase")
    week = "; a GNSS week roll-over? give a running time" if 604000 < before - after < 605600 else ""
    raise InputError(
        f"{table.where(row + 1)}: time goes backwards from {before!r} s (line {table.lines[row]}) to {after!r} s{week}"
    )


def within(name: str, time: Array, table: TextTable, window: tuple[float | None, float | None]) -> tuple[Array, TextTable]:
    """The rows from start_s to stop_s. Raises InputError when none is left."""
    low = -math.inf if window[0] is None else window[0]
    high = math.inf if window[1] is None else window[1]
    inside = (time >= low) & (time <= high)
    if not inside.any():
        raise InputError(
            f"{table.label}: no {name} rows between start_s = {window[0]} s and stop_s = {window[1]} s:"
            f" its times are {time[0]:.3f} to {time[-1]:.3f} s"
        )
    return time[inside], table.select(inside)


def column(table: TextTable, name: Column) -> Array:
    """One column (rows,)."""
    return table.column(name)


def columns3(table: TextTable, names: Sequence[Column]) -> Array:
    """Three columns (rows, 3)."""
    return np.column_stack([table.column(name) for name in names])


def checked_position(
    name: str, section: GnssSection | ReferenceSection, table: TextTable, notes: list[str]
) -> tuple[Array, Array]:
    """Latitude and longitude [rad]. Raises InputError when out of range; notes when degrees look like
    radians."""
    factor = ANGLE_UNITS[section.position_unit]
    result = []
    limits = (("latitude", section.latitude, 90.0), ("longitude", section.longitude, 360.0))
    for what, column_name, limit in limits:
        values = table.column(column_name)
        bad = np.flatnonzero(np.abs(values * factor) > math.radians(limit) * (1 + 1e-12))
        if bad.size:
            hint = (
                "; is position_unit = 'deg' right?" if section.position_unit == "deg" else "; is position_unit = 'rad' right?"
            )
            raise InputError(
                f"{table.where(bad[0])}, column {column_name!r}: {what} is {values[bad[0]]:.10g} "
                f"{section.position_unit},"
                f" allowed {-limit:g} to {limit:g} deg{hint}"
            )
        result.append(np.clip(values * factor, -math.radians(limit), math.radians(limit)))
    latitude, longitude = result
    if (
        section.position_unit == "deg"
        and np.all(np.abs(latitude) < factor * 1.5708)
        and np.all(np.abs(longitude) < factor * 3.1416)
    ):
        notes.append(f"{name}: latitude and longitude in degrees lie within +-1.57 and +-3.14: are they radians?")
    return latitude, longitude
