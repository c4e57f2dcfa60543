"""The text side of a log: how its files are written, their columns as numbers, and the column and unit of the time.

The separator is the one by which the most lines have one number of fields, most of them numbers.  The time is a column that
increases from row to row; its unit follows from the sample rate, because the plausible rates of a table span a factor of
1000 at most: `IMU_RATES`, `FIX_RATES`.  A name states a unit as well; where the numbers contradict it, they decide, and the
evidence says so.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError
from insenv.logs.columns import Column
from insenv.logs.files import read_bytes
from insenv.logs.formats.csv_table import AllColumns, all_columns
from insenv.logs.units import TIME_UNITS, Array
from insenv.studies.describe.finding import Finding, UnclearError

SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": None}
"""Separator by its name in a description."""
HEAD_LINES = 400
"""Lines from which the layout is detected."""
NUMBERS_SHARE = 0.5
"""Share of the fields of a line that are numbers or empty, from which it is a row."""
FILLED_SHARE = 0.9
"""Share of rows in which a time column is filled."""
IMU_RATES = (5.0, 5000.0)
"""Plausible sample rates (Hz) of inertial units: a factor of 1000, so that one of s, ms, us, ns fits."""
FIX_RATES = (0.06, 60.0)
"""Plausible rates (Hz) of fixes, likewise."""
MIN_RISING = 0.999
"""Share of the steps of a time column that are positive."""
_TIMES = re.compile(r"time|stamp|(^|[^a-z])(t|ts|tow|sow|secs?|seconds|sec_of_week)([^a-z]|$)|utc|epoch", re.IGNORECASE)
_UNITS = {
    "ns": r"(^|[^a-z])n(ano)?s(ec(onds?)?)?([^a-z]|$)|nanos",
    "us": r"(^|[^a-z])(u|µ|micro)s(ec(onds?)?)?([^a-z]|$)|micros|TimeUS|usec",
    "ms": r"(^|[^a-z])(m|milli)s(ec(onds?)?)?([^a-z]|$)|millis|msec",
    "s": r"(^|[^a-z])(s|secs?|seconds|tow|sow)([^a-z]|$)",
}
EPOCH_S = (6e8, 4e9)
"""Seconds since 1970, or since 1980 (GPS), of a log of our time."""


@dataclass(frozen=True, eq=False)
class LogTable:
    """A file of a log: path as in the description; delimiter, header_rows (None: detected), comment as keys of a section; names
    (k,) of the columns, "" without a header; refs (k,): how a description names them; values (n, k), NaN where no number
    stands.
    """

    file: str
    delimiter: str
    header_rows: int | None
    comment: str
    names: tuple[str, ...]
    refs: tuple[Column, ...]
    values: Array
    time: int = -1
    time_unit: str = ""
    role: str = ""
    files: tuple[str, ...] = ()
    times: tuple[int, ...] = ()

    @property
    def seconds(self) -> Array:
        """The stamps (n,) s, of the rows of `values`."""
        return self.values[:, self.time] * TIME_UNITS[self.time_unit]

    @property
    def interval(self) -> float:
        """The median step of the stamps, s."""
        steps = np.diff(self.seconds[np.isfinite(self.seconds)])
        return float(np.median(steps[steps > 0]))

    @property
    def named(self) -> bool:
        """Whether the file names its columns."""
        return any(self.names)

    def label(self, column: int) -> str:
        """A column in a sentence."""
        return repr(self.names[column]) if self.names[column] else f"number {column}"


def read_file(path: Path, file: str) -> tuple[LogTable, tuple[Finding, ...]]:
    """A text file of a log and the findings on its layout.  Raises `InputError`."""
    label, raw = read_bytes(str(path), Path())
    if b"\0" in raw[:4096]:
        raise InputError(f"{label}: not a text file; `insenv describe` takes text tables, flight logs need no description")
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
    made = LogTable(file, name, header_rows, comment, names, refs, table.values)
    return made, (Finding(f"{file}.delimiter", name, evidence),)


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
    return bool(filled) and sum(map(_is_number, filled)) >= NUMBERS_SHARE * len(filled)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


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


def beside(one: LogTable, other: LogTable) -> LogTable:
    """Two tables with their times in one: the columns of the other are interpolated at the times of the first, as a
    description joins files."""
    time, known = one.seconds, np.isfinite(other.seconds)
    inside = (time >= np.nanmin(other.seconds)) & (time <= np.nanmax(other.seconds))
    columns = [np.interp(time[inside], other.seconds[known], column[known]) for column in other.values.T]
    values = np.column_stack([one.values[inside], *columns])
    count = one.values.shape[1]
    names = (*one.names, *(f"{Path(other.file).stem} {name}" if name in one.names else name for name in other.names))
    return replace(
        one,
        file=f"{one.file}, {other.file}",
        files=(one.file, other.file),
        names=names,
        refs=(*one.refs, *other.refs),
        values=values,
        times=(one.time, count + other.time),
    )


# The time.


def with_time(table: LogTable, rates: tuple[float, float], others: Sequence[int] = ()) -> tuple[LogTable, tuple[Finding, ...]]:
    """The table with its time column and its unit.

    rates: plausible rates (Hz) of its rows; others: columns that are something else.  Raises `UnclearError`.
    """
    candidates = []
    for column in range(table.values.shape[1]):
        values = table.values[:, column]
        filled = np.isfinite(values)
        if column in others or column in table.times[1:] or filled.mean() < FILLED_SHARE or np.count_nonzero(filled) < 10:
            continue
        steps = np.diff(values[filled])
        moving = steps[steps != 0]
        if (
            len(moving) < 0.01 * len(steps)
            or (steps > 0).mean() < MIN_RISING * (steps >= 0).mean()
            or (steps < 0).mean() > 1 - MIN_RISING
        ):
            continue
        step = float(np.median(moving))
        units = [unit for unit in ("s", "ms", "us", "ns") if step > 0 and rates[0] <= 1 / (step * TIME_UNITS[unit]) < rates[1]]
        if not units:
            continue
        repeated = 1.0 - len(moving) / len(steps)
        spread = float(np.quantile(np.abs(moving - step), 0.9)) / step
        counter = bool(
            np.all(values[filled] == np.rint(values[filled])) and np.all(moving == 1.0) and abs(values[filled][0]) < 2
        )
        by_name = bool(_TIMES.search(table.names[column]))
        score = 4.0 * by_name - 3.0 * counter - 2.0 * repeated - min(spread, 1.0)
        candidates.append((score, column, units[0], step, by_name, counter))
    candidates.sort(reverse=True)
    if not candidates:
        raise UnclearError(
            f"{table.file}: no column increases from row to row at {rates[0]:g} to {rates[1]:g} Hz in s, ms, us or ns: "
            f"the time is not found (dates as text are not read)"
        )
    score, column, unit, step, by_name, counter = candidates[0]
    if counter and not by_name:
        raise UnclearError(f"{table.file}: column {table.label(column)} counts rows; no column holds the time")
    scale = TIME_UNITS[unit]
    begin = float(table.values[np.isfinite(table.values[:, column]), column][0]) * scale
    kind = "Unix or GPS time" if EPOCH_S[0] < begin < EPOCH_S[1] else "a relative time"
    evidence = (
        f"column {table.label(column)} increases by {step:.6g} in the median, {1 / (step * scale):.4g} Hz in {unit}; "
        f"in any other of s, ms, us, ns the rate is not within {rates[0]:g} to {rates[1]:g} Hz; it begins at "
        f"{begin:.6f} s, {kind}"
    )
    said = stated_unit(table.names[column], _UNITS)
    if said and said != unit:
        evidence += f"; its name says {said}, which the rate contradicts"
    if len(candidates) > 1:
        evidence += f"; column {table.label(candidates[1][1])} increases too and is not used"
    made = replace(table, time=column, time_unit=unit, times=table.times or (column,))
    return made, (
        Finding(f"{table.role}.time", table.refs[column], evidence),
        Finding(f"{table.role}.time_unit", unit, evidence),
    )


def stated_unit(name: str, units: dict[str, str]) -> str:
    """The unit that the name of a column states, by patterns of unit; "" if none."""
    return next((unit for unit, pattern in units.items() if re.search(pattern, name)), "")
