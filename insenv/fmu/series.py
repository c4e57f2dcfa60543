"""Sampled inputs and outputs of an FMU as CSV: a column ``time``, s, and one for each element of each variable.

The elements of an array have the columns ``name[1]``, ``name[2]``, ... (of a matrix ``"name[1,1]"``, ...), the same for FMI 2
and 3.  One column of the array's name with blanks between the elements, as FMPy writes them for FMI 3, can be read too.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Mapping, Sequence
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
        found: dict[str, list[tuple[tuple[int, ...], Array]]] = {}
        for name, column in self.columns().items():
            match = _ELEMENT.fullmatch(name)
            place = tuple(map(int, match[2].split(","))) if match else ()
            found.setdefault(match[1] if match else name, []).append((place, column))
        return {
            name: np.stack([column for _, column in parts], axis=1).reshape(-1, *parts[-1][0]) if parts[0][0] else parts[0][1]
            for name, parts in found.items()
        }


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
        shown = re.sub(r"'column(\d+)'", lambda found: repr(names[int(found[1]) - 1]), str(error))
        shown = shown.partition("; skip_empty")[0]  # a key of the description of a log
        raise InputError(shown) from None
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


def uniform(time: Array, step: float, label: str) -> None:
    """Raise `InputError` unless the times are `step` apart: each within a tenth, and on average within a thousandth."""
    gaps = np.diff(time)
    if not len(gaps):
        return
    mean = float(gaps.mean())
    wrong = np.flatnonzero(np.abs(gaps - step) > 0.1 * step)
    if abs(mean - step) > 1e-3 * step and abs(float(np.median(gaps)) - step) > 1e-3 * step:
        raise InputError(f"{label}: rows are {np.median(gaps):.6g} s apart, steps are {step:g} s: set the step with --step")
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"{label}: time = {time[k + 1]:.9g} s in row {k + 2} follows {time[k]:.9g} s: allowed is a step of {step:g} s "
            f"within a tenth; fill gaps first ({wrong.size} such row{'s' if wrong.size > 1 else ''})"
        )


def chosen(names: Sequence[str], given: Mapping[str, Array]) -> tuple[dict[str, Array], list[str], list[str]]:
    """Columns that are inputs, names of the other columns, and inputs without a column.

    Raises `InputError` for an array of which only some elements have columns.
    """
    used = {name: given[name] for name in names if name in given}
    held = [name for name in names if name not in used]
    partial = {name.rpartition("[")[0] for name in used} - {""}
    for name in held:
        if name.rpartition("[")[0] in partial:
            raise InputError(f"input {name} has no column, but other elements of this array have one: give all or none")
    return used, [name for name in given if name not in used], held
