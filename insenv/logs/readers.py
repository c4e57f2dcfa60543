"""Text tables (CSV, blank-separated) to arrays, with errors that name file, line and column.

NumPy's C tokenizer parses the numbers. The fields of every line are counted first, on the raw bytes: a truncated row is an
error even if it has all requested columns.
"""

from __future__ import annotations

import gzip
import hashlib
import importlib.resources
import io
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TypeVar

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.installing import install_package
from insenv.logs.units import Array

# All faults of a description at once: steps that do not depend on one another are all tried before an error is raised.

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass
class Faults:
    """Messages of the errors so far, each once, in order."""

    messages: list[str] = field(default_factory=list)

    def attempt(self, step: Callable[[], Result]) -> Result | None:
        """What a step returns; None, with its messages kept, if it raises InputError."""
        try:
            return step()
        except InputError as error:
            self.messages += [line for line in str(error).split("\n") if line not in self.messages]
            return None

    def check(self) -> None:
        """Raise one InputError with all messages, if there are any."""
        if self.messages:
            raise InputError("\n".join(self.messages))


def all_of(step: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """The results of a step for all items.  Raises one InputError for all items that have a fault."""
    faults = Faults()
    results = [faults.attempt(lambda item=item: step(item)) for item in items]  # type: ignore[misc]
    faults.check()
    return [result for result in results if result is not None]


Column = str | int
MISSING = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
"""Fields, in lower case, that hold no value."""


@dataclass(frozen=True)
class TextTable:
    """Columns read from a text file.

    label: the file's name in messages; names: as in the description, one per column of `values`; values (rows, columns);
    lines (rows,): line numbers in the file, counted from 1; fields: number of fields per line in the file; sha256: of the
    unpacked bytes; notes: remarks for the user.
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

    def columns(self, names: Sequence[Column]) -> Array:
        """Several columns (rows, columns)."""
        return np.column_stack([self.column(name) for name in names])

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
    text = _clean_text(label, raw)
    buffer = np.frombuffer(text, dtype=np.uint8)
    starts, is_row, is_comment = _scan_lines(buffer, comment)
    rows = np.flatnonzero(is_row)
    heading, rows = _split_header(text, starts, rows, is_comment, header_rows, delimiter)
    if not rows.size:
        raise InputError(f"{label}: no data rows (only a header or comments)")
    separator = _separator_of(_line_text(text, starts, int(rows[0])), delimiter)
    counts = _count_fields(buffer, starts, separator)[rows]
    names = _header_names(heading, separator, int(counts[0]), comment)
    fields = len(names) if names else int(counts[0])
    _check_counts(label, rows, counts, fields, expected_fields, from_header=bool(names))
    use = all_of(lambda column: _column_index(label, column, names, fields), columns)
    data = text[starts[rows[0]] :]
    source: io.BytesIO | list[str] = io.BytesIO(data)
    picked = list(use)
    if skip_empty or optional:
        may_miss = [column in optional for column in columns]
        rows, source = _filled(text, starts, rows, use, may_miss, separator, comment, skip_empty)
        if not rows.size:
            needed = [_show(column) for column, may in zip(columns, may_miss, strict=True) if not may]
            raise InputError(f"{label}: no row in which all of {', '.join(needed)} are filled")
        picked = list(range(len(use)))
    values = _parse(label, source, text, starts, rows, columns, use, picked, optional, separator, comment)
    lines = rows + 1
    sha = hashlib.sha256(raw).hexdigest()
    return TextTable(label, tuple(columns), values, lines, fields, sha, _cut_short(label, text, starts, rows, separator))


def _filled(
    text: bytes,
    starts: np.ndarray,
    rows: np.ndarray,
    use: list[int],
    may_miss: list[bool],
    separator: str | None,
    comment: str,
    skip_empty: bool,
) -> tuple[np.ndarray, list[str]]:
    """Numbers of the rows that are kept, and the fields `use` of each, with NaN for those that may miss and do."""
    kept, lines = [], []
    glue = separator or " "
    for number in rows:
        line = _line_text(text, starts, int(number))
        parts = (line.split(comment)[0] if comment else line).split(separator)
        fields = [parts[index].strip() if index < len(parts) else "" for index in use]
        missing = [field.lower() in MISSING for field in fields]
        if skip_empty and any(gone and not may for gone, may in zip(missing, may_miss, strict=True)):
            continue
        kept.append(int(number))
        fields = ["nan" if gone and may else field for field, gone, may in zip(fields, missing, may_miss, strict=True)]
        lines.append(glue.join(fields))
    return np.array(kept, dtype=np.int64), lines


def _cut_short(label: str, text: bytes, starts: np.ndarray, rows: np.ndarray, separator: str | None) -> tuple[str, ...]:
    """A note if the last line has no line end and its last field is shorter than those before it."""
    if text.endswith((b"\n", b"\r")) or rows.size < 2:
        return ()
    sizes = [len(_line_text(text, starts, int(n)).split(separator)[-1].strip()) for n in rows[-50:]]
    if sizes[-1] >= min(sizes[:-1]):
        return ()
    return (f"{label}: the last line has no line end and its last value is short: is the file cut off?",)


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
            f"{table.where(row)}, column {_show(table.names[col])}: value is {table.values[row, col]},"
            f" must be a finite number ({len(bad)} such values in the file){skip}"
        )


def column_names(
    label: str, raw: bytes, *, delimiter: str = "auto", header_rows: int | None = None, comment: str = "#"
) -> tuple[str, ...]:
    """Names in the header of a text table, empty if it has none. Raises InputError: empty, binary, only a header."""
    text = _clean_text(label, raw)
    starts, is_row, is_comment = _scan_lines(np.frombuffer(text, dtype=np.uint8), comment)
    heading, rows = _split_header(text, starts, np.flatnonzero(is_row), is_comment, header_rows, delimiter)
    if not rows.size:
        raise InputError(f"{label}: no data rows (only a header or comments)")
    first = _line_text(text, starts, rows[0])
    separator = _separator_of(first, delimiter)
    return _header_names(heading, separator, len(first.split(separator)), comment)


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
    raise InputError(f"{label}: no column {column!r}{nearest(column, names)}")


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
    picked: list[int],
    optional: Sequence[Column],
    separator: str | None,
    comment: str,
) -> Array:
    """The fields `picked` of each line of `source`, which are the fields `use` of the rows in the file."""
    try:
        return np.loadtxt(source, delimiter=separator, comments=comment or None, usecols=picked, ndmin=2, encoding="latin1")
    except ValueError as error:
        for number in rows:
            line = _line_text(text, starts, number).split(comment)[0] if comment else _line_text(text, starts, number)
            parts = line.split(separator)
            for column, index in zip(columns, use, strict=True):
                part = parts[index].strip() if index < len(parts) else ""
                if not _is_number(part) and not (column in optional and part.lower() in MISSING):
                    what = f"{part[:40]!r} is not a number" if part else "the value is missing"
                    what += "; skip_empty = true skips such rows" if part.lower() in MISSING else ""
                    raise InputError(f"{label}: line {number + 1}, column {_show(column)}: {what}") from None
        raise InputError(f"{label}: cannot be parsed: {error}") from None


# --- lines and fields ---------------------------------------------------------------------------------


def _clean_text(label: str, raw: bytes) -> bytes:
    text = raw[3:] if raw.startswith(b"\xef\xbb\xbf") else raw
    text = text.replace(b'"', b"") if b'"' in text else text
    if not text.strip():
        raise InputError(f"{label}: the file is empty")
    if b"\0" in text:
        raise InputError(f"{label}: not a text file (it holds NUL bytes: binary, or UTF-16; save it as UTF-8)")
    return text


def _scan_lines(buffer: np.ndarray, comment: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start offset of every line; whether it is a row (neither blank nor comment); whether it is a comment."""
    ends = np.flatnonzero(buffer == 10) + 1
    starts = np.concatenate(([0], ends))
    if starts[-1] == buffer.size:
        starts = starts[:-1]
    filled = np.logical_or.reduceat(buffer > 32, starts)
    is_comment = filled & (buffer[starts] == ord(comment)) if comment else np.zeros(starts.size, bool)
    return starts, filled & ~is_comment, is_comment


def _line_text(text: bytes, starts: np.ndarray, number: int) -> str:
    end = starts[number + 1] if number + 1 < starts.size else len(text)
    return text[starts[number] : end].decode("utf-8", errors="replace").strip("\r\n")


def _split_header(
    text: bytes,
    starts: np.ndarray,
    rows: np.ndarray,
    is_comment: np.ndarray,
    header_rows: int | None,
    delimiter: str,
) -> tuple[str, np.ndarray]:
    """The header line ("" if none) and the numbers of the lines with data."""
    if header_rows is not None:
        heading = _line_text(text, starts, header_rows - 1) if 0 < header_rows <= starts.size else ""
        return heading, rows[rows >= header_rows]
    if rows.size:
        first = _line_text(text, starts, rows[0])
        if not any(_is_number(field) for field in first.split(_separator_of(first, delimiter))):
            return first, rows[1:]
    before = np.flatnonzero(is_comment[: rows[0]]) if rows.size else np.zeros(0, int)
    return (_line_text(text, starts, before[-1]) if before.size else ""), rows


def _is_number(text: str) -> bool:
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


def _count_fields(buffer: np.ndarray, starts: np.ndarray, separator: str | None) -> np.ndarray:
    """Number of fields on every line."""
    if separator is None:
        solid = buffer > 32
        marks = np.flatnonzero(solid & ~np.concatenate(([False], solid[:-1])))
        extra = 0
    else:
        marks, extra = np.flatnonzero(buffer == ord(separator)), 1
    return np.diff(np.searchsorted(marks, np.append(starts, buffer.size))) + extra


def _header_names(heading: str, separator: str | None, fields: int, comment: str) -> tuple[str, ...]:
    """Names of the columns; a commented line counts only if it has as many fields as the rows."""
    commented = bool(comment) and heading.startswith(comment)
    line = heading.lstrip(comment).strip() if commented else heading
    if not line:
        return ()
    names = tuple(name.strip() for name in line.split(separator))
    return () if commented and len(names) != fields else names


# The bytes of a log's files: plain, .gz, .zip with one member, or a file inside an installed Python package.

PACKAGE = "package:"
MAX_BYTES = 4 * 1024**3
"""Largest unpacked file accepted [bytes]."""


def read_bytes(file: str, folder: Path) -> tuple[str, bytes]:
    """Read one file of a log.

    file: a path, relative to `folder` (that of the description) unless absolute, or ``package:NAME/path/inside/the/package``.
    Files that end in .gz or .zip are unpacked (a zip must hold one file); of the folder of a ROS 2 bag a tar archive is made.
    Returns (name for messages, bytes). Raises InputError: not found, unreadable, empty, package not installed.
    """
    if file.startswith(PACKAGE):
        label, raw = file, _from_package(file)
    else:
        path = Path(file).expanduser()
        path = path if path.is_absolute() else folder / path
        label, raw = str(path), _from_path(path)
    data = _unpack(label, raw)
    if not data:
        raise InputError(f"{label}: the file is empty")
    return label, data


def _from_path(path: Path) -> bytes:
    if (path / "metadata.yaml").is_file():
        return _folder(path)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: file not found") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _folder(path: Path) -> bytes:
    """A tar archive of a folder, without times and owners: the same for the same files."""
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for file in sorted(path.iterdir()):
            if file.is_file():
                entry = tarfile.TarInfo(file.name)
                entry.size = file.stat().st_size
                with file.open("rb") as content:
                    archive.addfile(entry, content)
    return stream.getvalue()


def _from_package(file: str) -> bytes:
    name, _, inside = file[len(PACKAGE) :].partition("/")
    parts = PurePosixPath(inside).parts
    if not name.isidentifier() or not parts or ".." in parts or inside.startswith("/"):
        raise InputError(f"{file}: must be package:NAME/path/inside/the/package")
    try:
        root = importlib.resources.files(name)
    except ModuleNotFoundError:
        raise InputError(f"{PACKAGE}{name}: the Python package {name!r} is not installed: {install_package(name)}") from None
    except Exception as error:  # a package whose own import fails: any exception can come out of it
        raise InputError(f"{file}: the Python package {name!r} cannot be imported: {error}") from None
    node = root.joinpath(*parts)
    try:
        return node.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{file}: the installed package {name!r} holds no such file; is it another version?") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None


def _unpack(label: str, raw: bytes) -> bytes:
    lower = label.lower()
    try:
        if lower.endswith(".gz"):
            with gzip.GzipFile(fileobj=io.BytesIO(raw)) as stream:
                data = stream.read(MAX_BYTES + 1)
            if len(data) > MAX_BYTES:
                raise InputError(f"{label}: unpacks to more than {MAX_BYTES} bytes")
            return data
        if lower.endswith(".zip"):
            with zipfile.ZipFile(io.BytesIO(raw)) as archive:
                members = [i for i in archive.infolist() if not i.is_dir() and not i.filename.startswith("__MACOSX/")]
                if len(members) != 1:
                    names = ", ".join(i.filename for i in members[:5]) or "none"
                    raise InputError(f"{label}: the zip must hold exactly one file, it holds {len(members)}: {names}")
                if members[0].file_size > MAX_BYTES:
                    raise InputError(f"{label}: unpacks to {members[0].file_size} bytes, allowed {MAX_BYTES}")
                return archive.read(members[0])
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise InputError(f"{label}: the archive cannot be unpacked: {error}") from None
    return raw
