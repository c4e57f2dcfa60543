"""Sampled inputs and outputs of an FMU as CSV: a column ``time``, s, and one for each element of each variable.

An array's elements stand in columns ``name[1]``, ``name[2]``, ... (``"name[1,1]"`` of a matrix), the same for FMI 2 and 3,
or in one column of that name with blanks between the elements, as FMPy writes them for FMI 3.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insenv.errors import InputError, InsenvError
from insenv.files.output import atomic
from insenv.fmu.instance import Array, element_names
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
        """By variable name, arrays put together again: (rows,), (rows, n) or (rows, r, c)."""
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
    """(rows,) by element name, from arrays by variable or element name: (rows,), (rows, n) or (rows, r, c)."""
    flat: dict[str, Array] = {}
    for name, value in inputs.items():
        array = np.asarray(value, dtype=np.float64)
        array = array.reshape(1) if array.ndim == 0 else array
        names = element_names(name, array.shape[1:])
        flat |= zip(names, array.reshape(len(array), -1).T, strict=True)
    return flat


def read_csv(path: str | Path) -> Series:
    """Read a CSV file.  Raises `InputError` that names file, line and column: unreadable, no ``time``, text, a value missing or
    not finite."""
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
        raise InputError(f"{path}: columns that stand there twice: {', '.join(sorted(repeated))}")
    # quoted names may hold commas, which the table reader does not read: plain ones stand in for them
    plain = [f"column{place + 1}" for place in range(len(names))]
    try:
        table = read_table(str(path), ",".join(plain).encode() + b"\n" + body, plain, delimiter=",", header_rows=1)
        check_finite(table)
    except InputError as error:
        shown = re.sub(r"'column(\d+)'", lambda found: repr(names[int(found[1]) - 1]), str(error))
        raise InputError(shown) from None
    place = names.index("time")
    rest = [i for i in range(len(names)) if i != place]
    return Series(table.values[:, place], tuple(names[i] for i in rest), table.values[:, rest])


def write_csv(path: str | Path, series: Series) -> None:
    """Write a CSV file, every number so that it reads back to the bit; under a temporary name, then renamed.

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
    """Check that the times stand `step` apart, within a tenth each and a thousandth on average.  Raises `InputError`."""
    gaps = np.diff(time)
    if not len(gaps):
        return
    mean = float(gaps.mean())
    wrong = np.flatnonzero(np.abs(gaps - step) > 0.1 * step)
    if abs(mean - step) > 1e-3 * step and abs(float(np.median(gaps)) - step) > 1e-3 * step:
        raise InputError(f"{label}: rows stand {np.median(gaps):.6g} s apart, steps are {step:g} s: give the step with --step")
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"{label}: time = {time[k + 1]:.9g} s in row {k + 2} follows {time[k]:.9g} s: allowed is a step of {step:g} s "
            f"within a tenth; fill gaps first ({wrong.size} such rows)"
        )


def chosen(names: Sequence[str], given: Mapping[str, Array]) -> tuple[dict[str, Array], list[str], list[str]]:
    """The columns that are inputs; the names of columns that are not; the inputs that have no column.

    Raises `InputError` for an array of which some elements have columns and others have none.
    """
    used = {name: given[name] for name in names if name in given}
    held = [name for name in names if name not in used]
    begun = {name.rpartition("[")[0] for name in used} - {""}
    for name in held:
        if name.rpartition("[")[0] in begun:
            raise InputError(f"input {name} has no column, other elements of it have: give all or none")
    return used, [name for name in given if name not in used], held
