"""Lines and fields of a text table, found on its raw bytes: rows, comments, header, separator, fields per
line."""

from __future__ import annotations

import numpy as np

from insenv.errors import InputError


def clean_text(label: str, raw: bytes) -> bytes:
    text = raw[3:] if raw.startswith(b"\xef\xbb\xbf") else raw
    text = text.replace(b'"', b"") if b'"' in text else text
    if not text.strip():
        raise InputError(f"{label}: the file is empty")
    if b"\0" in text:
        raise InputError(f"{label}: not a text file (it holds NUL bytes: binary, or UTF-16; save it as UTF-8)")
    return text


def scan_lines(buffer: np.ndarray, comment: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start offset of every line; whether it is a row (neither blank nor comment); whether it is a
    comment."""
    ends = np.flatnonzero(buffer == 10) + 1
    starts = np.concatenate(([0], ends))
    if starts[-1] == buffer.size:
        starts = starts[:-1]
    filled = np.logical_or.reduceat(buffer > 32, starts)
    is_comment = filled & (buffer[starts] == ord(comment)) if comment else np.zeros(starts.size, bool)
    return starts, filled & ~is_comment, is_comment


def line_text(text: bytes, starts: np.ndarray, number: int) -> str:
    end = starts[number + 1] if number + 1 < starts.size else len(text)
    return text[starts[number] : end].decode("utf-8", errors="replace").strip("\r\n")


def split_header(
    text: bytes,
    starts: np.ndarray,
    rows: np.ndarray,
    is_comment: np.ndarray,
    header_rows: int | None,
    delimiter: str,
) -> tuple[str, np.ndarray]:
    """The header line ("" if none) and the numbers of the lines that hold data."""
    if header_rows is not None:
        heading = line_text(text, starts, header_rows - 1) if 0 < header_rows <= starts.size else ""
        return heading, rows[rows >= header_rows]
    if rows.size:
        first = line_text(text, starts, rows[0])
        if not any(is_number(field) for field in first.split(separator_of(first, delimiter))):
            return first, rows[1:]
    before = np.flatnonzero(is_comment[: rows[0]]) if rows.size else np.zeros(0, int)
    return (line_text(text, starts, before[-1]) if before.size else ""), rows


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def separator_of(line: str, delimiter: str) -> str | None:
    """The separating character, None for blanks."""
    if delimiter != "auto":
        return {"tab": "\t", "space": None}.get(delimiter, delimiter)
    return next((d for d in (",", ";", "\t") if d in line.strip()), None)


def count_fields(buffer: np.ndarray, starts: np.ndarray, separator: str | None) -> np.ndarray:
    """Fields on every line."""
    if separator is None:
        solid = buffer > 32
        marks = np.flatnonzero(solid & ~np.concatenate(([False], solid[:-1])))
        extra = 0
    else:
        marks, extra = np.flatnonzero(buffer == ord(separator)), 1
    return np.diff(np.searchsorted(marks, np.append(starts, buffer.size))) + extra


def header_names(heading: str, separator: str | None, fields: int, comment: str) -> tuple[str, ...]:
    """Names of the columns; a commented line counts only when it has as many fields as the rows."""
    commented = bool(comment) and heading.startswith(comment)
    line = heading.lstrip(comment).strip() if commented else heading
    if not line:
        return ()
    names = tuple(name.strip() for name in line.split(separator))
    return () if commented and len(names) != fields else names
