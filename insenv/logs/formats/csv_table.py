"""Text tables (CSV, blank-separated) to arrays and back, with errors that name file, line and column.

NumPy's C tokenizer parses the numbers. The fields of every line are counted first, on the raw bytes: a truncated row is an
error even if it has all requested columns.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.files import all_of
from insenv.logs.formats.contract import Drive, Files, Format

Column = str | int
MISSING = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
"""Fields, in lower case, that hold no value."""
_CUT_OFF = declared("table-cut-off", "{label}: the last line has no line end and its last value is short: is the file cut off?")


def check_delimiter(label: str, names: Sequence[str]) -> None:
    """Raise `InputError` if a header was read as one name because it has another delimiter than the description says."""
    marks = {",": ",", ";": ";", "tab": "\t", "space": " "}
    fits = next((delimiter for delimiter, mark in marks.items() if mark in names[0].strip()), "") if len(names) == 1 else ""
    if fits:
        raise InputError(f"{label}: the header is one column, {names[0][:60]!r}: allowed is delimiter = {fits!r}, or 'auto'")


@dataclass(frozen=True)
class TextTable:
    """Columns read from a file.

    label: the file's name in messages; names: as in the description, one per column of `values`; values (rows, columns);
    lines (rows,): line numbers in the file, counted from 1; fields: number of fields per line in the file; sha256: of the
    unpacked bytes; notes: remarks for the user; row: what messages call a row.
    """

    label: str
    names: tuple[Column, ...]
    values: Array
    lines: np.ndarray
    fields: int
    sha256: str
    notes: tuple[Remark, ...] = ()
    row: str = "line"

    def column(self, name: Column) -> Array:
        """One column (rows,). The name must be one of `names`."""
        return self.values[:, self.names.index(name)]

    def columns(self, names: Sequence[Column]) -> Array:
        """Several columns (rows, columns)."""
        return np.column_stack([self.column(name) for name in names])

    def select(self, rows: np.ndarray) -> TextTable:
        """The table with only the rows of a boolean or index array."""
        return replace(self, values=self.values[rows], lines=self.lines[rows])

    def where(self, row: int) -> str:
        """'file: line N' of a row, for messages."""
        return f"{self.label}: {self.row} {self.lines[row]}"

    def refuse(self, names: Sequence[Column], bad: np.ndarray, message: Callable[[int, int], str], hint: str = "") -> None:
        """Raise InputError for the first value of the columns `names` that is bad, (rows,) or (rows, columns) of bool.

        message: of its row and the place of its column in `names`; hint: follows the number of such values.
        """
        at = np.argwhere(bad.reshape(len(bad), -1))
        if at.size:
            row, place = at[0]
            count = f" ({len(at)} such values{hint})" if hint else ""
            raise InputError(f"{self.where(row)}, column {names[place]!r}: {message(row, place)}{count}")


def read_table(
    label: str,
    raw: bytes,
    columns: Sequence[Column],
    *,
    delimiter: str = "auto",
    header_rows: int | None = None,
    comment: str = "#",
    skip_empty: bool = False,
    optional: Sequence[Column] = (),
    expected_fields: Sequence[int] | None = None,
) -> TextTable:
    """Read the named columns of a text table.

    columns: names in the header line or numbers, counted from 0. delimiter: "auto", ",", ";", "tab" or "space" (blanks and
    tabs). header_rows: lines before the first row, the last of them holding the names; None detects a header. skip_empty:
    skip rows in which one of the columns is missing (`MISSING`). optional: columns that may be missing: NaN. expected_fields:
    allowed numbers of fields per line; None: any. Values may be NaN or infinite: see `check_finite`. Raises InputError: empty,
    binary, no such column, a line with a different number of fields, text, missing value.
    """
    text = _Text(label, raw, delimiter, header_rows, comment)
    fields = text.checked_fields(expected_fields)
    places = all_of(lambda column: text.place(column, fields), columns)
    rows, source, picked = text.rows, None, places
    if skip_empty or optional:
        may_miss = [column in optional for column in columns]
        rows, source = text.filled(places, may_miss, skip_empty)
        if not rows.size:
            needed = [_quoted(column) for column, may in zip(columns, may_miss, strict=True) if not may]
            raise InputError(f"{label}: no row in which all of {', '.join(needed)} are filled")
        picked = list(range(len(places)))
    text.rows = rows
    values = text.parsed(source, columns, places, picked, optional)
    return TextTable(label, tuple(columns), values, rows + 1, fields, hashlib.sha256(raw).hexdigest(), text.notes_on_end())


def column_names(
    label: str, raw: bytes, *, delimiter: str = "auto", header_rows: int | None = None, comment: str = "#"
) -> tuple[str, ...]:
    """Names in the header of a text table, empty if it has none. Raises InputError: empty, binary, only a header."""
    text = _Text(label, raw, delimiter, header_rows, comment)
    return text.names(len(text.line(text.rows[0]).split(text.separator)))


@dataclass(frozen=True)
class AllColumns:
    """All columns of a text table: names, () without a header; values (rows, columns), NaN where no number stands."""

    names: tuple[str, ...]
    values: Array


def all_columns(
    label: str, raw: bytes, delimiter: str = "auto", header_rows: int | None = None, comment: str = "#"
) -> AllColumns:
    """All columns of a text table, whatever they hold.  Arguments and errors: as of `read_table`."""
    text = _Text(label, raw, delimiter, header_rows, comment)
    fields = text.checked_fields(None)
    lines = io.BytesIO(text.text[text.starts[text.rows[0]] :])
    try:
        values = np.loadtxt(lines, delimiter=text.separator, comments=comment or None, ndmin=2, encoding="latin1")
    except ValueError:
        rows = [text.fields_of(int(number)) for number in text.rows]
        values = np.array([[float(part) if is_number(part) else np.nan for part in row] for row in rows])
    return AllColumns(text.names(fields), values)


def check_finite(table: TextTable, optional: Sequence[Column] = ()) -> None:
    """Raise InputError if a value is NaN or infinite; the message names file, line and column of the first one.

    optional: columns that may hold NaN.
    """
    may = np.array([name in optional for name in table.names])
    bad = np.argwhere(~np.isfinite(table.values) & ~(may & np.isnan(table.values)))
    if bad.size:
        row, col = bad[0]
        skip = "; skip_empty = true skips such rows" if np.isnan(table.values[row, col]) else ""
        raise InputError(
            f"{table.where(row)}, column {_quoted(table.names[col])}: value is {table.values[row, col]},"
            f" must be a finite number ({len(bad)} such values in the file){skip}"
        )


class _Text:
    """The lines of a text table.

    starts: offset of every line; rows: numbers, from 0, of the lines with data; heading: the line of the header, "" if there is
    none; separator: character between the fields, None for blanks.  Raises InputError: empty, binary, only a header.
    """

    def __init__(self, label: str, raw: bytes, delimiter: str, header_rows: int | None, comment: str) -> None:
        self.label, self.comment = label, comment
        text = raw[3:] if raw.startswith(b"\xef\xbb\xbf") else raw
        self.text = text.replace(b'"', b"") if b'"' in text else text
        if not self.text.strip():
            raise InputError(f"{label}: the file is empty")
        if b"\0" in self.text:
            raise InputError(f"{label}: not a text file (it holds NUL bytes: binary, or UTF-16; save it as UTF-8)")
        self.buffer = np.frombuffer(self.text, dtype=np.uint8)
        starts = np.concatenate(([0], np.flatnonzero(self.buffer == 10) + 1))
        self.starts = starts[:-1] if starts[-1] == self.buffer.size else starts
        filled = np.logical_or.reduceat(self.buffer > 32, self.starts)
        commented = filled & (self.buffer[self.starts] == ord(comment)) if comment else np.zeros(self.starts.size, bool)
        self.heading, self.rows = self._split(np.flatnonzero(filled & ~commented), commented, header_rows, delimiter)
        if not self.rows.size:
            raise InputError(f"{label}: no data rows (only a header or comments)")
        self.separator = _separator_of(self.line(self.rows[0]), delimiter)

    def _split(
        self, rows: np.ndarray, commented: np.ndarray, header_rows: int | None, delimiter: str
    ) -> tuple[str, np.ndarray]:
        """The header line ("" if none) and the numbers of the lines with data."""
        if header_rows is not None:
            heading = self.line(header_rows - 1) if 0 < header_rows <= self.starts.size else ""
            return heading, rows[rows >= header_rows]
        if rows.size:
            first = self.line(rows[0])
            if not any(is_number(field) for field in first.split(_separator_of(first, delimiter))):
                return first, rows[1:]
        before = np.flatnonzero(commented[: rows[0]]) if rows.size else np.zeros(0, int)
        return (self.line(before[-1]) if before.size else ""), rows

    def line(self, number: int) -> str:
        """A line without its end."""
        end = self.starts[number + 1] if number + 1 < self.starts.size else len(self.text)
        return self.text[self.starts[number] : end].decode("utf-8", errors="replace").strip("\r\n")

    def fields_of(self, number: int) -> list[str]:
        """The fields of a line without its comment."""
        line = self.line(number)
        return [field.strip() for field in (line.split(self.comment)[0] if self.comment else line).split(self.separator)]

    def names(self, fields: int) -> tuple[str, ...]:
        """Names of the columns; a commented line counts only if it has as many fields as the rows."""
        commented = bool(self.comment) and self.heading.startswith(self.comment)
        line = self.heading.lstrip(self.comment).strip() if commented else self.heading
        if not line:
            return ()
        names = tuple(name.strip() for name in line.split(self.separator))
        return () if commented and len(names) != fields else names

    def checked_fields(self, expected: Sequence[int] | None) -> int:
        """Number of fields per line; expected: those that are allowed.  Raises InputError for a line with another number."""
        label, rows = self.label, self.rows
        counts = self._count_fields()[rows]
        names = self.names(int(counts[0]))
        fields = len(names) if names else int(counts[0])
        if expected is not None and counts[0] not in expected:
            allowed = " or ".join(str(e) for e in expected)
            raise InputError(f"{label}: line {rows[0] + 1} has {counts[0]} columns, this format has {allowed}")
        wrong = np.flatnonzero(counts != fields)
        if wrong.size:
            row = wrong[0]
            source = "the header" if names else f"line {rows[0] + 1}"
            cut = "; the file is cut off in mid-row" if row == rows.size - 1 and counts[row] < fields else ""
            raise InputError(f"{label}: line {rows[row] + 1} has {counts[row]} fields, expected {fields} as in {source}{cut}")
        return fields

    def _count_fields(self) -> np.ndarray:
        """Number of fields on every line."""
        if self.separator is None:
            solid = self.buffer > 32
            marks = np.flatnonzero(solid & ~np.concatenate(([False], solid[:-1])))
            extra = 0
        else:
            marks, extra = np.flatnonzero(self.buffer == ord(self.separator)), 1
        return np.diff(np.searchsorted(marks, np.append(self.starts, self.buffer.size))) + extra

    def place(self, column: Column, fields: int) -> int:
        """The number of a column.  Raises InputError: no such column."""
        label, last = self.label, fields - 1
        if isinstance(column, int):
            if column < fields:
                return column
            raise InputError(f"{label}: no column {column}: the file has {fields} columns, numbered 0 to {last}")
        names = self.names(fields)
        if column in names:
            return names.index(column)
        if not names:
            raise InputError(f"{label}: no column {column!r}: the file has no header; give column numbers 0 to {last}")
        check_delimiter(label, names)
        raise InputError(f"{label}: no column {column!r}{nearest(column, names)}")

    def filled(self, places: list[int], may_miss: list[bool], skip_empty: bool) -> tuple[np.ndarray, list[str]]:
        """Numbers of the rows that are used, and the fields `places` of each, with NaN for those that may miss and do."""
        used, lines = [], []
        for number in self.rows:
            parts = self.fields_of(int(number))
            fields = [parts[place] if place < len(parts) else "" for place in places]
            missing = [field.lower() in MISSING for field in fields]
            if skip_empty and any(gone and not may for gone, may in zip(missing, may_miss, strict=True)):
                continue
            used.append(int(number))
            fields = ["nan" if gone and may else field for field, gone, may in zip(fields, missing, may_miss, strict=True)]
            lines.append((self.separator or " ").join(fields))
        return np.array(used, dtype=np.int64), lines

    def parsed(
        self,
        source: list[str] | None,
        columns: Sequence[Column],
        places: list[int],
        picked: list[int],
        optional: Sequence[Column],
    ) -> Array:
        """The fields `picked` of each line of `source` (None: of the file), which are the fields `places` of its rows."""
        lines = io.BytesIO(self.text[self.starts[self.rows[0]] :]) if source is None else source
        comments = self.comment or None
        try:
            return np.loadtxt(lines, delimiter=self.separator, comments=comments, usecols=picked, ndmin=2, encoding="latin1")
        except ValueError as error:
            for number in self.rows:
                parts = self.fields_of(number)
                for column, place in zip(columns, places, strict=True):
                    part = parts[place] if place < len(parts) else ""
                    if not is_number(part) and not (column in optional and part.lower() in MISSING):
                        what = f"{part[:40]!r} is not a number" if part else "the value is missing"
                        what += "; skip_empty = true skips such rows" if part.lower() in MISSING else ""
                        raise InputError(f"{self.label}: line {number + 1}, column {_quoted(column)}: {what}") from None
            raise InputError(f"{self.label}: cannot be parsed: {error}") from None

    def notes_on_end(self) -> tuple[Remark, ...]:
        """A note if the last line has no line end and its last field is shorter than those before it."""
        if self.text.endswith((b"\n", b"\r")) or self.rows.size < 2:
            return ()
        sizes = [len(self.line(int(number)).split(self.separator)[-1].strip()) for number in self.rows[-50:]]
        if sizes[-1] >= min(sizes[:-1]):
            return ()
        return (_CUT_OFF.filled(label=self.label),)


def is_number(text: str) -> bool:
    """Whether a field of a text file is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _separator_of(line: str, delimiter: str) -> str | None:
    """The separating character; None for blanks."""
    if delimiter != "auto":
        return {"tab": "\t", "space": None}.get(delimiter, delimiter)
    return next((d for d in (",", ";", "\t") if d in line.strip()), None)


def _quoted(column: Column) -> str:
    return repr(column) if isinstance(column, str) else str(column)


# Writing.


def csv_text(columns: Mapping[str, Array]) -> str:
    """A header and one line per row; each number in the fewest digits from which it is read back to the bit."""
    rows = zip(*(np.asarray(column, dtype=np.float64).tolist() for column in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def write(drive: Drive) -> Files:
    """NAME-ID.csv: truth, estimate, errors, sigma and limit of each estimator."""
    return {f"{drive.name}-{id}.csv": csv_text(columns) for id, columns in drive.results.items()}


FORMAT = Format(name="csv", write=write, needs_report=True)
