"""Fast reading of text tables (CSV, blank-separated, KF-GINS) with errors that name file, line and column.

The numbers are parsed by numpy's C tokenizer; before that the fields of every line are counted on the raw
bytes, so that a row cut short is found even when the columns asked for are all there.
"""

from __future__ import annotations

import difflib
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from insenv.errors import InputError
from insenv.logs.scan import (
    clean_text,
    count_fields,
    header_names,
    is_number,
    line_text,
    scan_lines,
    separator_of,
    split_header,
)
from insenv.logs.units import Array

Column = str | int

KF_GINS_IMU = {"time": 0, "gyro": (1, 2, 3), "accel": (4, 5, 6)}
"""time [s], delta angle x y z [rad], delta velocity x y z [m/s], body FRD, the increment over the interval
that ends at the time."""

KF_GINS_GNSS = {"time": 0, "latitude": 1, "longitude": 2, "height": 3, "position_sigma": (4, 5, 6)}
"""time [s], latitude, longitude [deg], height [m], std N E D [m]; the variant with velocity adds six
columns."""

KF_GINS_GNSS_VELOCITY = {"velocity": (7, 8, 9), "velocity_sigma": (10, 11, 12)}
"""velocity N E D [m/s], its std N E D [m/s] (13 columns in all)."""

KF_GINS_NAV = {
    "time": 1,
    "latitude": 2,
    "longitude": 3,
    "height": 4,
    "velocity": (5, 6, 7),
    "roll": 8,
    "pitch": 9,
    "heading": 10,
}
"""GNSS week, time of week [s], latitude, longitude [deg], height [m], velocity N E D [m/s], roll, pitch, yaw
[deg]."""


@dataclass(frozen=True)
class TextTable:
    """Columns read from a text file.

    label: the file's name in messages; names: as in the description, one per column of `values`; values:
    (rows, columns); lines: (rows,) line numbers in the file, counted from 1; fields: fields per line in the
    file; sha256 of the unpacked bytes; notes: remarks for the user (a last line without a line end).
    """

    label: str
    names: tuple[Column, ...]
    values: Array
    lines: np.ndarray
    fields: int
    sha256: str
    notes: tuple[str, ...] = ()

    def column(self, name: Column) -> Array:
        """One column (rows,). The name must be one of `names`."""
        return self.values[:, self.names.index(name)]

    def select(self, rows: np.ndarray) -> TextTable:
        """The table with only the rows of a boolean or index array."""
        return TextTable(self.label, self.names, self.values[rows], self.lines[rows], self.fields, self.sha256, self.notes)

    def where(self, row: int) -> str:
        """'file: line N' of a row, for messages."""
        return f"{self.label}: line {self.lines[row]}"


def read_table(
    label: str,
    raw: bytes,
    columns: Sequence[Column],
    *,
    delimiter: str = "auto",
    header_rows: int | None = None,
    comment: str = "#",
    skip_empty: bool = False,
    expected_fields: Sequence[int] | None = None,
) -> TextTable:
    """Read the named columns of a text table.

    columns: names in the header line or 0-based numbers. delimiter: "auto", ",", ";", "tab" or "space"
    (blanks and tabs). header_rows: lines before the first row, the last of them holding the names; None finds
    out whether there is one. skip_empty: leave out rows in which one of the columns is empty.
    expected_fields: the numbers of fields per line that the format knows, any when None. Values may be NaN or
    infinite: see `check_finite`. Raises InputError: empty, binary, no such column, a line with another number
    of fields, text, missing value.
    """
    text = clean_text(label, raw)
    buffer = np.frombuffer(text, dtype=np.uint8)
    starts, is_row, is_comment = scan_lines(buffer, comment)
    rows = np.flatnonzero(is_row)
    heading, rows = split_header(text, starts, rows, is_comment, header_rows, delimiter)
    if not rows.size:
        raise InputError(f"{label}: no data rows (only a header or comments)")
    separator = separator_of(line_text(text, starts, int(rows[0])), delimiter)
    counts = count_fields(buffer, starts, separator)[rows]
    names = header_names(heading, separator, int(counts[0]), comment)
    fields = len(names) if names else int(counts[0])
    _check_counts(label, rows, counts, fields, expected_fields, from_header=bool(names))
    use = [_column_index(label, column, names, fields) for column in columns]
    data = text[starts[rows[0]] :]
    source: io.BytesIO | list[str] = io.BytesIO(data)
    if skip_empty:
        split = [(int(n), line_text(text, starts, int(n))) for n in rows]
        full = [(n, line) for n, line in split if all(line.split(separator)[i].strip() for i in use)]
        if not full:
            raise InputError(f"{label}: no row in which all of {', '.join(map(_show, columns))} are filled")
        rows, source = np.array([n for n, _ in full]), [line for _, line in full]
    values = _parse(label, source, text, starts, rows, columns, use, separator, comment)
    lines = rows + 1
    sha = hashlib.sha256(raw).hexdigest()
    return TextTable(label, tuple(columns), values, lines, fields, sha, _cut_short(label, text, starts, rows, separator))


def _cut_short(label: str, text: bytes, starts: np.ndarray, rows: np.ndarray, separator: str | None) -> tuple[str, ...]:
    """A note when the last line has no line end and its last field is shorter than those before it."""
    if text.endswith((b"\n", b"\r")) or rows.size < 2:
        return ()
    sizes = [len(line_text(text, starts, int(n)).split(separator)[-1].strip()) for n in rows[-50:]]
    if sizes[-1] >= min(sizes[:-1]):
        return ()
    return (f"{label}: the last line has no line end and its last value is short: is the file cut off?",)


def check_finite(table: TextTable) -> None:
    """Raises InputError that names file, line and column of the first NaN or infinite value."""
    bad = np.argwhere(~np.isfinite(table.values))
    if bad.size:
        row, col = bad[0]
        raise InputError(
            f"{table.where(row)}, column {_show(table.names[col])}: value is {table.values[row, col]},"
            f" must be a finite number ({len(bad)} such values in the file)"
        )


def column_names(
    label: str, raw: bytes, *, delimiter: str = "auto", header_rows: int | None = None, comment: str = "#"
) -> tuple[str, ...]:
    """Names in the header of a text table, empty if it has none. Raises InputError: empty, binary, only a
    header."""
    text = clean_text(label, raw)
    starts, is_row, is_comment = scan_lines(np.frombuffer(text, dtype=np.uint8), comment)
    heading, rows = split_header(text, starts, np.flatnonzero(is_row), is_comment, header_rows, delimiter)
    if not rows.size:
        raise InputError(f"{label}: no data rows (only a header or comments)")
    first = line_text(text, starts, rows[0])
    separator = separator_of(first, delimiter)
    return header_names(heading, separator, len(first.split(separator)), comment)


def _check_counts(
    label: str,
    rows: np.ndarray,
    counts: np.ndarray,
    fields: int,
    expected: Sequence[int] | None,
    *,
    from_header: bool,
) -> None:
    if expected is not None and counts[0] not in expected:
        allowed = " or ".join(str(e) for e in expected)
        raise InputError(f"{label}: line {rows[0] + 1} has {counts[0]} columns, this format has {allowed}")
    wrong = np.flatnonzero(counts != fields)
    if not wrong.size:
        return
    row = wrong[0]
    source = "the header" if from_header else f"line {rows[0] + 1}"
    cut = "; the file is cut off in mid-row" if row == rows.size - 1 and counts[row] < fields else ""
    raise InputError(f"{label}: line {rows[row] + 1} has {counts[row]} fields, expected {fields} as in {source}{cut}")


def _column_index(label: str, column: Column, names: Sequence[str], fields: int) -> int:
    if isinstance(column, int):
        if column < fields:
            return column
        raise InputError(f"{label}: no column {column}: the file has {fields} columns, numbered 0 to {fields - 1}")
    if column in names:
        return list(names).index(column)
    if not names:
        raise InputError(f"{label}: no column {column!r}: the file has no header; give column numbers 0 to {fields - 1}")
    near = difflib.get_close_matches(column, names, n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise InputError(f"{label}: no column {column!r}{hint}; the file has: {', '.join(names)}")


def _show(column: Column) -> str:
    return repr(column) if isinstance(column, str) else str(column)


def _parse(
    label: str,
    source: io.BytesIO | list[str],
    text: bytes,
    starts: np.ndarray,
    rows: np.ndarray,
    columns: Sequence[Column],
    use: list[int],
    separator: str | None,
    comment: str,
) -> Array:
    try:
        return np.loadtxt(source, delimiter=separator, comments=comment or None, usecols=use, ndmin=2, encoding="latin1")
    except ValueError as error:
        for number in rows:
            line = line_text(text, starts, number).split(comment)[0] if comment else line_text(text, starts, number)
            parts = line.split(separator)
            for column, index in zip(columns, use, strict=True):
                part = parts[index].strip() if index < len(parts) else ""
                if not is_number(part):
                    what = f"{part[:40]!r} is not a number" if part else "the value is missing"
                    raise InputError(f"{label}: line {number + 1}, column {_show(column)}: {what}") from None
        raise InputError(f"{label}: cannot be parsed: {error}") from None
