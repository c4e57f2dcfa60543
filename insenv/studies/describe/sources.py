"""The files of a log, of whatever format, as tables of columns (`tables.py`).

A text file has the layout that its lines show.  Other formats are read as the sections of a description read them
(`insenv.logs.section_files`); the keys that a format fixes are known of its columns.  A flight log is read as `insenv replay`
reads it: its axes and units are known.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.logs import load
from insenv.logs.columns import Column
from insenv.logs.files import read_bytes
from insenv.logs.formats import SECTION_FORMATS, Format, is_flight_log, log_tables
from insenv.logs.formats.csv_table import AllColumns, all_columns, is_number
from insenv.logs.section_files import SectionFile, form_of
from insenv.studies.describe.finding import Finding, UnclearError, listed
from insenv.studies.describe.tables import LogTable

SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": None}
"""Separator by its name in a description."""
HEAD_LINES = 400
"""Lines from which the layout is detected."""
NUMBERS_SHARE = 0.5
"""Share of the fields of a line that are numbers or empty, from which it is a row."""


def text_table(label: str, raw: bytes, file: str) -> LogTable:
    """A text file of a log.

    label: its name for messages; raw: its bytes; file: its name in the description.  Raises `InputError`.
    """
    if b"\0" in raw:
        raise InputError(f"{label}: neither a text table nor of a format that its name says")
    head = raw[: 1 << 20].decode("utf-8", errors="replace").splitlines()[:HEAD_LINES]
    head = head[:-1] if len(raw) > 1 << 20 else head
    comment = next((c for c in "#%" if any(line.startswith(c) for line in head)), "#")
    lines = [(number, line) for number, line in enumerate(head) if line.strip() and not line.startswith(comment)]
    name, fields, share = _separator(label, [line for _, line in lines])
    rows = [number for number, line in lines if _is_row(line, SEPARATORS[name], fields)]
    if not rows:
        raise InputError(f"{label}: no line holds numbers in {fields} fields")
    before = [line for number, line in lines if number < rows[0]]
    first = rows[0] if not before else 1 + max(number for number, _ in lines if number < rows[0])
    header_rows = first if before else None
    table = all_columns(label, raw, name, header_rows, comment)
    names, source = _names(table, before, SEPARATORS[name], fields, comment, head[:first])
    refs = _references(names, source == "header")
    head_words = {"header": "the line before them names the columns", "units": "a line of units follows that of the names"}
    evidence = (
        f"{100 * share:.4g} % of the lines have {fields} fields, separated by {name if name.isalpha() else repr(name)};"
        f" {head_words.get(source, 'no line names the columns, which are counted from 0')}"
    )
    layout: dict[str, Any] = {"delimiter": name}
    layout |= {} if header_rows is None else {"header_rows": header_rows}
    layout |= {} if comment == "#" else {"comment": comment}
    return LogTable((file,), names, refs, table.values, layout=layout, said=(Finding("delimiter", name, evidence),))


def _separator(label: str, lines: Sequence[str]) -> tuple[str, int, float]:
    """Name of the separator, number of fields, share of the lines that have it."""
    best: tuple[float, str, int, float] | None = None
    for name, character in SEPARATORS.items():
        if character is not None and not any(character in line for line in lines):
            continue
        counts = Counter(len(line.split(character)) for line in lines)
        fields, count = max(counts.items(), key=lambda item: (item[1], item[0]))
        share = count / len(lines)
        numbers = np.mean([_is_row(line, character, fields) for line in lines])
        score = share * float(numbers)
        if fields >= 2 and (best is None or score > best[0] + 1e-9):
            best = score, name, fields, share
    if best is None or best[0] < NUMBERS_SHARE:
        if all(len(line.split(character)) == 1 for line in lines for character in SEPARATORS.values()):
            raise UnclearError(f"{label}: one column: a log has a time and what was measured then")
        sample = next(iter(lines), "")[:60]
        decimal = (
            ": its numbers have decimal commas, which are not read" if re.search(r"\d,\d+[;\t]", " ".join(lines[-5:])) else ""
        )
        raise UnclearError(f"{label}: no separator parts its lines into numbers{decimal} (a line: {sample!r})")
    return best[1:]


def _is_row(line: str, separator: str | None, fields: int) -> bool:
    parts = [part.strip().strip('"') for part in line.strip("\r\n").split(separator)]
    if len(parts) != fields:
        return False
    filled = [part for part in parts if part]
    return bool(filled) and sum(map(is_number, filled)) >= NUMBERS_SHARE * len(filled)


def _names(
    table: AllColumns, before: Sequence[str], separator: str | None, fields: int, comment: str, head: Sequence[str]
) -> tuple[tuple[str, ...], str]:
    """Names of the columns and where they are from: "header", "units" (a line of units stands below them), or ""."""
    parts = [[part.strip().strip('"') for part in line.split(separator)] for line in before]
    fitting = [each for each in parts if len(each) == fields]
    if not fitting:
        return (table.names or ("",) * fields), "header" if table.names else ""
    if len(fitting) > 1 and all(re.fullmatch(r"[\[(]?[a-zµ/^0-9*.%-]*[\])]?", part) for part in fitting[-1]):
        return tuple(f"{a} [{b}]" if b else a for a, b in zip(fitting[-2], fitting[-1], strict=True)), "units"
    return tuple(fitting[-1]), "header" if len(parts[-1]) == fields else "units"


def _references(names: Sequence[str], usable: bool) -> tuple[Column, ...]:
    """How a description names the columns: by the name if it is the only one of its kind, otherwise by the number."""
    counts = Counter(names)
    return tuple(name if usable and name and counts[name] == 1 else place for place, name in enumerate(names))


# How a text file is written: its separator, its header, the names of its columns.
#
# The separator is the one by which the most lines have one number of fields, most of them numbers.

TEXT_SUFFIXES = (".csv", ".txt", ".dat", ".tsv", ".asc", ".imu", ".log")
"""Ends of the names of text files that are looked at in a folder."""
ARCHIVES = (".gz", ".zip")
LEAST_ROWS, LEAST_COLUMNS = 10, 2
"""Rows and columns from which a table can hold samples or fixes."""
_RATE, _FORCE = ([f"gyro_{axis}_rad_s" for axis in "xyz"], [f"accel_{axis}_mps2" for axis in "xyz"])
_FLIGHT_IMU: dict[str, Any] = {
    "time": "time_s", "gyro": _RATE, "accel": _FORCE, "kind": "rate", "gyro_unit": "rad/s", "accel_unit": "m/s2", "axes": "FRD",
}  # fmt: skip


def files_of(paths: Sequence[Path]) -> list[tuple[Path, bool]]:
    """The files that are named, and those of a folder, each with whether it is one of a folder.  Raises `InputError`."""
    files: list[tuple[Path, bool]] = []
    for path in paths:
        if path.suffix == ".toml":
            raise InputError(f"{path}: a TOML file: allowed are the files of a log")
        if not path.is_dir() or is_flight_log(path):
            files.append((path, False))
            continue
        try:
            inside = sorted(each for each in path.iterdir() if each.is_file() and _may_be_log(each))
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
        if not inside:
            raise InputError(f"{path}: no log in this folder: looked for flight logs, {listed(TEXT_SUFFIXES + _suffixes())}")
        files += [(each, True) for each in inside]
    flight = next((path for path, _ in files if is_flight_log(path)), None)
    if len(files) > 1 and flight is not None:
        raise InputError(f"{flight}: a flight log beside other files: describe it alone, or leave it out")
    return files


def tables_of(path: Path, file: str) -> list[LogTable]:
    """The tables of a file.  file: its name in the description.  Raises `InputError`."""
    if is_flight_log(path):
        return _flight_tables(path, file)
    label, raw = read_bytes(str(path), Path())
    form = form_of("", {"file": file})
    if form.read_columns is None:
        table = text_table(label, raw, file)
        if len(table.values) < LEAST_ROWS:
            raise InputError(f"{label}: rows of numbers = {len(table.values)}: a log has {LEAST_ROWS} or more")
        return [table]
    sections = [name for name in ("imu", "gnss") if name in form.keys] or [""]
    faults: list[str] = []
    tables = []
    for name in sections:
        try:
            tables += _section_tables(label, raw, file, name, form)
        except InputError as error:
            faults.append(str(error))
    if not tables:
        raise InputError("\n".join(faults) or f"{label}: no {LEAST_COLUMNS} columns of {LEAST_ROWS} rows or more")
    return tables


def _section_tables(label: str, raw: bytes, file: str, section: str, form: Format) -> list[LogTable]:
    """The columns of a file for a section, those of one length in one table; section: "" for any."""
    source = SectionFile(label, raw, section, form)
    assert source.columns is not None
    by_length: dict[int, dict[Any, Array]] = {}
    for name, column in source.columns.columns.items():
        by_length.setdefault(len(column), {})[name] = np.asarray(column, dtype=np.float64)
    fixed = source.fixed_keys() if section else {}
    roles = (section,) if section else ("imu", "gnss")
    return [
        _table(file, part, roles, fixed)
        for length, part in by_length.items()
        if length >= LEAST_ROWS and len(part) >= LEAST_COLUMNS
    ]


def _table(
    file: str, columns: Mapping[Any, Array], roles: tuple[str, ...], fixed: Mapping[str, Any], flight: bool = False
) -> LogTable:
    names = tuple("" if isinstance(name, int) else str(name) for name in columns)
    return LogTable((file,), names, tuple(columns), np.column_stack(list(columns.values())), roles, fixed=fixed, flight=flight)


def _flight_tables(path: Path, file: str) -> list[LogTable]:
    """The samples and the fixes of a flight log, in body axes."""
    log = load(path)
    spans = log.dt[:, None]
    samples = {"time_s": log.imu_time}
    for names, values in ((_RATE, log.delta_angle / spans), (_FORCE, log.delta_velocity / spans)):
        samples |= dict(zip(names, values.T, strict=True))
    made = [_table(file, samples, ("imu",), _FLIGHT_IMU, True)]
    if log.gnss is not None:
        made.append(_table(file, log_tables.gnss_columns(log.gnss), ("gnss",), log_tables.gnss_keys(log.gnss), True))
    return made


def _suffixes() -> tuple[str, ...]:
    """Ends of the names of the other formats of sections."""
    return tuple(suffix for form in SECTION_FORMATS.values() for suffix in form.suffixes)


def _may_be_log(path: Path) -> bool:
    name = Path(path.stem if path.suffix.lower() in ARCHIVES else path.name)
    is_text = name.suffix.lower() in TEXT_SUFFIXES
    return is_text or is_flight_log(path) or any(form.named_like(path.name) for form in SECTION_FORMATS.values())
