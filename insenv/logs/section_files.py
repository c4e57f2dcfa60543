"""The files of a section of a description, whatever their format: their columns, and the keys that their format fixes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.logs.files import Faults, all_of, read_bytes
from insenv.logs.formats import SECTION_FORMATS
from insenv.logs.formats.contract import FileColumns, Format, SectionKeys
from insenv.logs.formats.csv_table import Column, TextTable, check_delimiter, column_names, read_table

_CSV = "csv"
_LAYOUT = ("delimiter", "header_rows", "comment")
"""Keys that say how a text table is written."""


@dataclass(frozen=True)
class SectionFile:
    """A file of a section: label and raw bytes, section (its name) and format; layout: of a text table, as its keys say."""

    label: str
    raw: bytes
    section: str
    form: Format
    layout: Mapping[str, Any] = field(default_factory=dict)

    def names(self) -> tuple[Column, ...]:
        """The names of its columns; numbers, where it has no names.  Raises `InputError` if it cannot be read."""
        if self.columns is not None:
            return tuple(self.columns.columns)
        names = column_names(self.label, self.raw, **self.layout)
        if names or not self.form.keys:
            return names
        return tuple(range(read_table(self.label, self.raw, [0], **self.layout).fields))

    def fixed_keys(self) -> SectionKeys:
        """The keys of the section that the format fixes for this file.  Raises `InputError`: not of this section."""
        if not self.form.keys:
            return {}
        if self.section not in self.form.keys:
            raise InputError(
                f"{self.label}: format {self.form.name!r} has no columns for [{self.section}]: allowed in "
                f"{', '.join(f'[{name}]' for name in self.form.keys)}"
            )
        keys, names = dict(self.form.keys[self.section]), set(self.names())
        for group in self.form.further_keys.get(self.section, ()):
            if _columns_of(group) <= names:
                keys |= group
        return keys

    def table(self, columns: Sequence[Column], *, skip_empty: bool = False, optional: Sequence[Column] = ()) -> TextTable:
        """These columns of the file, of one length.

        skip_empty, optional: see `read_table`.  Raises `InputError`: unreadable, no such column, columns of other lengths.
        """
        if self.columns is not None:
            return _table_of(self.label, self.raw, self.columns, columns, skip_empty, optional)
        return read_table(
            self.label,
            self.raw,
            columns,
            skip_empty=skip_empty,
            optional=optional,
            expected_fields=_numbers_of_fields(self.form, self.section) or None,
            **self.layout,
        )

    @property
    def columns(self) -> FileColumns | None:
        """All its columns; None for a text table.  Raises `InputError` if it cannot be read."""
        return None if self.form.read_columns is None else _read(self.form.name, self.label, self.raw, self.section)


@lru_cache(maxsize=4)
def _read(form: str, label: str, raw: bytes, section: str) -> FileColumns:
    """The columns of a file: read for its keys and for its values, decoded once."""
    read_columns = SECTION_FORMATS[form].read_columns
    assert read_columns is not None
    try:
        return read_columns(label, raw, section)
    except InputError:
        raise
    except Exception as error:  # the parsers of a damaged file raise anything
        raise InputError(f"{label}: the file is damaged, or no {form!r}: {type(error).__name__}: {error}") from None


def _columns_of(keys: SectionKeys) -> set[Column]:
    """The columns that the keys of a format name: all its lists, and what is not a unit."""
    values = [each for value in keys.values() for each in (value if isinstance(value, (list, tuple)) else [value])]
    return set(values)


def _numbers_of_fields(form: Format, section: str) -> list[int]:
    """Allowed numbers of fields on a line of a format whose columns have numbers; none: any."""
    if section not in form.keys:
        return []
    groups = [form.keys[section]]
    groups += [{**form.keys[section], **group} for group in form.further_keys.get(section, ())]
    return [1 + max(each for each in _columns_of(group) if isinstance(each, int)) for group in groups]


def _table_of(
    label: str, raw: bytes, file: FileColumns, columns: Sequence[Column], skip_empty: bool, optional: Sequence[Column]
) -> TextTable:
    """The columns as a table.  Its rows are numbered from 1, unless they have lines in the file."""
    missing = [name for name in columns if name not in file.columns]
    if missing:
        known = list(map(str, file.columns))
        raise InputError("\n".join(f"{label}: no column {name!r}{nearest(str(name), known)}" for name in missing))
    lengths = {name: len(file.columns[name]) for name in columns}
    first = columns[0]
    other = next((name for name in columns if lengths[name] != lengths[first]), None)
    if other is not None:
        raise InputError(
            f"{label}: column {other!r} has {lengths[other]} rows and {first!r} has {lengths[first]}: the columns of a section "
            "must have the same length"
        )
    values = np.column_stack([np.asarray(file.columns[name], dtype=np.float64) for name in columns])
    lined = file.lines is not None and len(file.lines) == len(values)
    lines = file.lines if lined and file.lines is not None else np.arange(1, len(values) + 1)
    table = TextTable(
        label,
        tuple(columns),
        values,
        lines,
        len(file.columns),
        sha256(raw).hexdigest(),
        file.notes,
        "line" if lined else "row",
    )
    if skip_empty:
        needed = [place for place, name in enumerate(columns) if name not in optional]
        table = table.select(np.asarray(~np.isnan(values[:, needed]).any(axis=1)))
    if not len(table.lines):
        raise InputError(f"{label}: no row in which all of {', '.join(map(repr, columns))} are filled")
    return table


def form_of(section: str, values: Mapping[str, Any]) -> Format:
    """The format of the files of a section: the one that it names, or by the end of the name of the first.

    values: its keys, checked or not.  Raises `InputError` for an unknown one.
    """
    name, files = values.get("format"), _files(values)
    if name is None:
        return next((form for form in SECTION_FORMATS.values() if files and form.named_like(files[0])), SECTION_FORMATS[_CSV])
    if name not in SECTION_FORMATS:
        raise InputError(f"{section}.format = {name!r}: must be one of {', '.join(map(repr, SECTION_FORMATS))}")
    return SECTION_FORMATS[name]


def _files(values: Mapping[str, Any]) -> Sequence[str]:
    """The key `file` as a list; empty if it is wrong."""
    named = values.get("file")
    files = [named] if isinstance(named, str) else named
    right = isinstance(files, (list, tuple)) and all(isinstance(file, str) and file for file in files)
    return files if right and files else ()


def open_files(section: str, values: Mapping[str, Any], folder: Path) -> list[SectionFile]:
    """The files of a section.  values: its keys, checked or not; folder: where relative paths start.

    Raises one `InputError` for all files that cannot be read.
    """
    form, layout = form_of(section, values), {key: values[key] for key in _LAYOUT if key in values}
    loaded = all_of(lambda file: read_bytes(file, folder), _files(values))
    return [SectionFile(label, raw, section, form, layout) for label, raw in loaded]


def completed(data: Mapping[str, Any], folder: Path, faults: Faults) -> dict[str, Any]:
    """The values of a description, with the keys that the formats of its files fix; those that it has itself win.

    A constant X_sigma_m or X_sigma_mps replaces the columns X_sigma.  Faults of the files are kept in `faults`.
    """
    done = dict(data)
    for name, section in data.items():
        if not isinstance(section, dict) or not _files(section):
            continue
        form = faults.attempt(lambda name=name, section=section: form_of(name, section))  # type: ignore[misc]
        if form is None or form.name == _CSV:
            done[name] = {**section, "format": _CSV}
            continue
        fixed = faults.attempt(lambda name=name, section=section: open_files(name, section, folder)[0].fixed_keys())  # type: ignore[misc]
        fixed = form.keys.get(name, {}) if fixed is None else fixed
        keys = {key: value for key, value in fixed.items() if not any(f"{key}_{unit}" in section for unit in ("m", "mps"))}
        done[name] = {**keys, **section, "format": form.name}
    return done


# Which file has a column, and under which name.


def located(section: str, files: Sequence[SectionFile], columns: Sequence[Column]) -> list[dict[Column, Column]]:
    """For each file the columns that are read from it, by their name in the description: their name in the file.

    A column that several files have is named with the name of its file, "gyro.csv:x".  Raises `InputError` for a number, and
    one for all columns that no file has, or several.
    """
    if any(isinstance(column, int) for column in columns):
        raise InputError(f"{section}.file: with several files the columns must be given by name, not by number")
    headers = [file.names() for file in files]
    places: list[dict[Column, Column]] = [{} for _ in files]
    labels = ", ".join(file.label for file in files)
    messages = []
    for column in columns:
        owners = [(place, column) for place, header in enumerate(headers) if column in header]
        owners = owners or _by_file(files, headers, str(column))
        if len(owners) > 1:
            named = " or ".join(repr(f"{_tail(files, place)}:{name}") for place, name in owners)
            messages.append(f"{section}: several files have the column {column!r}: allowed is a name with its file, {named}")
        elif not owners:
            known = list(dict.fromkeys(str(each) for header in headers for each in header))
            if len(known) == len(files):
                check_delimiter(files[0].label, known)
            messages.append(f"{labels}: no column {column!r}{nearest(str(column), known)}")
        else:
            places[owners[0][0]][column] = owners[0][1]
    if messages:
        raise InputError("\n".join(messages))
    return places


def _by_file(files: Sequence[SectionFile], headers: Sequence[Sequence[Column]], column: str) -> list[tuple[int, Column]]:
    """The files, by number, and the names in them, that a column means that is named with its file, or the end of its path."""
    return [
        (place, name)
        for place, (file, header) in enumerate(zip(files, headers, strict=True))
        for name in header
        if column.endswith(f":{name}") and _path(file).endswith(f"/{column.removesuffix(f':{name}')}")
    ]


def _path(file: SectionFile) -> str:
    return f"/{file.label}".replace("\\", "/")


def _tail(files: Sequence[SectionFile], place: int) -> str:
    """The shortest end of the path of a file that no other has."""
    parts = _path(files[place]).split("/")
    others = [_path(file) for k, file in enumerate(files) if k != place]
    tails = ("/".join(parts[-length:]) for length in range(1, len(parts)))
    return next((tail for tail in tails if not any(other.endswith(f"/{tail}") for other in others)), files[place].label)
