"""`LogTable`: the columns of a part of a log as numbers, and which of them is the time, in which unit.

The time is a column that increases from row to row; its unit follows from the sample rate, because the plausible rates of a
table span a factor of 1000 at most: `IMU_RATES`, `FIX_RATES`.  A name states a unit as well; where the numbers contradict it,
they decide, and the evidence says so.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from insenv.core.tables import Array
from insenv.logs.columns import Column
from insenv.logs.formats.contract import SectionKeys
from insenv.logs.units import TIME_UNITS
from insenv.studies.describe.finding import Finding, UnclearError

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
_OF_MATRIX = re.compile(r"\[\d+\]$")
CLOCK_SHARE = 0.1
"""Part of the samples' time by which the begin and the end of a column that counts may differ from it, if it is the time."""
EPOCH_S = (6e8, 4e9)
"""Seconds since 1970, or since 1980 (GPS), of a log of our time."""


@dataclass(frozen=True, eq=False)
class LogTable:
    """The columns of one length in a file of a log.

    files: paths as in the description, several if they are joined; names (k,) of the columns, "" without a header; refs (k,):
    how a description names them; values (n, k), NaN where no number stands.  roles: sections that it may be, and role: the one
    that it is; layout: keys of that section that say how the file is written, and said: the findings on them; fixed: keys that
    its format fixes; flight: whether it is that of a flight log.  time: the column of the time, and time_unit; times: that of
    each file.
    """

    files: tuple[str, ...]
    names: tuple[str, ...]
    refs: tuple[Column, ...]
    values: Array
    roles: tuple[str, ...] = ("imu", "gnss")
    role: str = ""
    layout: Mapping[str, Any] = field(default_factory=dict)
    fixed: SectionKeys = field(default_factory=dict)
    flight: bool = False
    said: tuple[Finding, ...] = ()
    time: int = -1
    time_unit: str = ""
    times: tuple[int, ...] = ()

    @property
    def file(self) -> str:
        """Its files in a sentence."""
        return ", ".join(self.files)

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
    def span(self) -> tuple[float, float]:
        """The first and the last stamp, s."""
        return float(np.nanmin(self.seconds)), float(np.nanmax(self.seconds))

    @property
    def named(self) -> bool:
        """Whether the file names its columns."""
        return any(self.names)

    def spoken(self, column: int) -> str:
        """The name of a column with its words apart: "GnssVelocityD" is "Gnss_Velocity_D"."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", self.names[column])

    def numbered(self, column: int) -> bool:
        """Whether a column has only a number: of a file without names, or of a matrix with one, "pos[0]"."""
        return not self.names[column] or bool(_OF_MATRIX.search(self.names[column]))

    def label(self, column: int) -> str:
        """A column in a sentence."""
        return repr(self.names[column]) if self.names[column] else f"number {column}"


def beside(one: LogTable, other: LogTable) -> LogTable:
    """Two tables with their times in one: the columns of the other are interpolated at the times of the first, as a
    description joins files.  A column that both have is named with its file, as in a description."""
    time, known = one.seconds, np.isfinite(other.seconds)
    inside = (time >= np.nanmin(other.seconds)) & (time <= np.nanmax(other.seconds))
    columns = [np.interp(time[inside], other.seconds[known], column[known]) for column in other.values.T]
    values = np.column_stack([one.values[inside], *columns])
    count = one.values.shape[1]
    both = set(one.names) & set(other.names)
    places = [(table, column) for table in (one, other) for column in range(table.values.shape[1])]
    twice = [table.names[column] in both and column != table.time for table, column in places]
    return replace(
        one,
        files=(*one.files, *other.files),
        names=tuple(
            f"{Path(table.file).stem} {table.names[column]}" if again else table.names[column]
            for (table, column), again in zip(places, twice, strict=True)
        ),
        refs=tuple(
            f"{table.file}:{table.names[column]}" if again else table.refs[column]
            for (table, column), again in zip(places, twice, strict=True)
        ),
        values=values,
        times=(one.time, count + other.time),
    )


# The time.


def with_time(
    table: LogTable, rates: tuple[float, float], others: Sequence[int] = (), clock: tuple[float, float] | None = None
) -> tuple[LogTable, tuple[Finding, ...]]:
    """The table with its time column and its unit.

    rates: plausible rates (Hz) of its rows; others: columns that are something else; clock: times (s) of the samples, with
    which the time has to overlap if any column does.  Raises `UnclearError`.
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
        seconds = values[filled][[0, -1]] * TIME_UNITS[units[0]]
        counter = bool(
            np.all(values[filled] == np.rint(values[filled])) and np.all(moving == 1.0) and abs(values[filled][0]) < 2
        ) and not (clock is not None and np.all(np.abs(seconds - clock) < CLOCK_SHARE * (clock[1] - clock[0])))
        by_name = bool(_TIMES.search(table.names[column]))
        overlaps = clock is not None and seconds[0] < clock[1] and seconds[1] > clock[0]
        fixed = table.refs[column] == table.fixed.get("time", -1)
        score = 16.0 * overlaps + 8.0 * fixed + 4.0 * by_name - 3.0 * counter - 2.0 * repeated - min(spread, 1.0)
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
    layout = (replace(finding, key=f"{table.role}.{finding.key}") for finding in table.said)
    return made, (
        *layout,
        Finding(f"{table.role}.time", table.refs[column], evidence),
        Finding(f"{table.role}.time_unit", unit, evidence),
    )


def stated_unit(name: str, units: dict[str, str]) -> str:
    """The unit that the name of a column states, by patterns of unit; "" if none."""
    return next((unit for unit, pattern in units.items() if re.search(pattern, name)), "")
