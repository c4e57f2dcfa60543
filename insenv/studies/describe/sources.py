"""The files of a log, of whatever format, as tables of columns (`tables.py`).

A text file has the layout that `text_layout.py` detects.  Other formats are read as the sections of a description read them
(`insenv.logs.section_files`); the keys that a format fixes are known of its columns.  A flight log is read as `insenv replay`
reads it: its axes and units are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.logs import load
from insenv.logs.files import read_bytes
from insenv.logs.formats import SECTION_FORMATS, Format, is_flight_log, log_tables
from insenv.logs.section_files import SectionFile, form_of
from insenv.studies.describe.finding import listed
from insenv.studies.describe.tables import LogTable
from insenv.studies.describe.text_layout import text_table

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
            raise InputError(f"{label}: {len(table.values)} rows of numbers: a log has {LEAST_ROWS} or more")
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
