"""Sampled inputs and outputs of an FMU, as arrays and as CSV: a column ``time``, s, and one for each element of each variable.

The elements of an array have the columns ``name[1]``, ``name[2]``, ... (of a matrix ``"name[1,1]"``, ...), the same for FMI 2
and 3.  One column of the array's name with blanks between the elements, as FMPy writes them for FMI 3, can be read too.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import atomic
from insenv.fmu.reading import Array, element_names
from insenv.logs.readers import check_finite, read_table

_ELEMENT = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]")


@dataclass(frozen=True)
class Series:
    """Values at times.

    time: (rows,) s.  names: of the elements.  values: (rows, elements).
    """

    time: Array
    names: tuple[str, ...]
    values: Array

    def columns(self) -> dict[str, Array]:
        """(rows,) by element name."""
        return dict(zip(self.names, self.values.T, strict=True))

    def named(self) -> dict[str, Array]:
        """Arrays by variable name: (rows,), (rows, n) or (rows, r, c)."""
        elements: dict[str, list[Array]] = {}
        shapes: dict[str, tuple[int, ...]] = {}  # the place of the last element
        for name, column in self.columns().items():
            match = _ELEMENT.fullmatch(name)
            variable = match[1] if match else name
            elements.setdefault(variable, []).append(column)
            shapes[variable] = tuple(map(int, match[2].split(","))) if match else ()
        return {name: np.stack(columns, axis=1).reshape(-1, *shapes[name]) for name, columns in elements.items()}


def flattened(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Columns (rows,) by element name, from arrays by variable or element name: (rows,), (rows, n) or (rows, r, c)."""
    flat: dict[str, Array] = {}
    for name, value in inputs.items():
        array = np.asarray(value, dtype=np.float64)
        array = array.reshape(1) if array.ndim == 0 else array
        names = element_names(name, array.shape[1:])
        flat |= zip(names, array.reshape(len(array), -1).T, strict=True)
    return flat


def read_csv(path: str | Path, switched: Collection[str] = ()) -> Series:
    """Read a CSV file.

    switched: columns that may hold NaN: inputs that a flag switches off (`insenv.fmu.reading.switched_inputs`).
    Raises `InputError`, with file, line and column, if it cannot be read, if ``time`` is missing, or if a value is missing,
    not a number or not finite.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    heading, _, body = raw.removeprefix(b"\xef\xbb\xbf").partition(b"\n")
    names = [name.strip() for name in next(csv.reader([heading.decode("utf-8", "replace").strip()]), [])]
    if "time" not in names:
        raise InputError(f"{path}: no column 'time' in its first line: {', '.join(names)[:200] or 'empty'}")
    first = body.partition(b"\n")[0].decode("utf-8", "replace").split(",")
    widths = [len(cell.split()) for cell in first] + [1] * (len(names) - len(first))
    if max(widths) > 1:  # arrays with blanks between the elements
        names = [e for name, n in zip(names, widths, strict=False) for e in element_names(name, (n,) if n > 1 else ())]
        body = re.sub(rb"[ \t]*,[ \t]*", b",", body).replace(b" ", b",")
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise InputError(f"{path}: repeated columns: {', '.join(sorted(repeated))}")
    # the table reader does not accept the commas of quoted names: it gets placeholders
    plain = [f"column{place + 1}" for place in range(len(names))]
    try:
        table = read_table(str(path), ",".join(plain).encode() + b"\n" + body, plain, delimiter=",", header_rows=1)
        check_finite(table, [plain[names.index(name)] for name in switched if name in names])
    except InputError as error:
        message = re.sub(r"'column(\d+)'", lambda match: repr(names[int(match[1]) - 1]), str(error))
        raise InputError(message.partition("; skip_empty")[0]) from None  # a key of the description of a log
    place = names.index("time")
    rest = [i for i in range(len(names)) if i != place]
    return Series(table.values[:, place], tuple(names[i] for i in rest), table.values[:, rest])


def write_csv(path: str | Path, series: Series) -> None:
    """Write a CSV file under a temporary name, then rename it; every number reads back to the same double.

    Raises `InsenvError` if it cannot be written.
    """
    path = Path(path)
    quoted = [f'"{name}"' if "," in name else name for name in series.names]
    try:
        with atomic(path) as stream:
            stream.write(f"{','.join(['time', *quoted])}\n".encode("ascii"))
            for time, row in zip(series.time.tolist(), series.values.tolist(), strict=True):
                stream.write(f"{','.join(map(repr, [time, *row]))}\n".encode("ascii"))
    except OSError as error:
        raise InsenvError(f"cannot write {path}: {error.strerror or error}") from None
