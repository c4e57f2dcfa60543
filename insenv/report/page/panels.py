"""The parts of a page as plain values: panels over time, the track, tables.  web/README.md describes their form.

A curve refers to an entry of the page's legend by number (`group`) and to arrays by number.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Arrays of a page: single-precision numbers as text, each kept once.

Array = NDArray[np.float64]
BYTES = 1_500_000
"""Bytes of a page for its arrays."""
FEWEST = 100
"""Records that a page keeps, however many arrays it has."""


def kept_records(records: int, arrays: int, budget: int = BYTES) -> NDArray[np.intp]:
    """Indices of the records that a page keeps: evenly spaced, the last among them; `arrays` arrays of them fit in `budget`."""
    most = max(FEWEST, int(budget / (16 / 3 * max(arrays, 1))))
    stride = -(-records // most) if records else 1
    return np.arange(records - 1, -1, -stride)[::-1]


class Pool:
    """The arrays of a page; panels refer to them by number."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}
        self._texts: list[str] = []

    def add(self, values: Any) -> int:
        """The number of an array (n,): single precision, little endian; the same array again has the same number."""
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        if data not in self._places:
            self._places[data] = len(self._texts)
            self._texts.append(base64.b64encode(data).decode("ascii"))
        return self._places[data]

    def as_json(self) -> list[str]:
        """The arrays in base64, by number."""
        return self._texts


TRUTH_GROUP = -1
"""The group of curves of the truth or the reference."""


@dataclass
class TimePanel:
    """A panel over time.

    times (n,) s. threshold: up to which the vertical scale is linear, beyond it logarithmic; None: linear. log: a logarithmic
    scale. wraps: angles in degrees, drawn with a gap where they wrap. from_s: start of the statistics, s. positive: the
    vertical scale begins at 0. most: where it ends; None: beyond the largest value. shade: intervals of time without fixes, s.
    """

    pool: Pool
    title: str
    unit: str
    times: Array
    threshold: float | None = None
    log: bool = False
    wraps: bool = False
    from_s: float | None = None
    positive: bool = False
    most: float | None = None
    shade: Sequence[tuple[float, float]] = ()
    curves: list[dict[str, Any]] = field(default_factory=list)

    def curve(self, group: int, values: Array, kind: str = "line") -> None:
        """A line; `kind` may be "points", "crosses" (of what was refused) or "limit" (drawn at plus and minus the values)."""
        self.curves.append({"kind": kind, "group": group, "y": self.pool.add(values)})

    def around(self, group: int, half: Array, centre: Array | None = None) -> None:
        """A band of plus and minus `half` around `centre` (zero if None)."""
        middle = None if centre is None else self.pool.add(centre)
        self.curves.append({"kind": "band", "group": group, "half": self.pool.add(half), "centre": middle})

    def between(self, group: int, low: Array, high: Array, strength: float = 1.0) -> None:
        """A band between two arrays; `strength` scales its opacity."""
        both = {"low": self.pool.add(low), "high": self.pool.add(high)}
        self.curves.append({"kind": "between", "group": group, **both, "strength": strength})

    def as_json(self) -> dict[str, Any]:
        return {
            "type": "time",
            "title": self.title,
            "unit": self.unit,
            "x": self.pool.add(self.times),
            "threshold": self.threshold,
            "log": self.log,
            "wraps": self.wraps,
            "from_s": self.from_s,
            "positive": self.positive,
            "most": self.most,
            "shade": [list(interval) for interval in self.shade],
            "curves": self.curves,
        }


def track_panel(pool: Pool, times: Array, tracks: Sequence[tuple[int, Array, Array]], marks: Sequence[Any]) -> dict[str, Any]:
    """The track from above. tracks: group, east and north (n,) m at `times`. marks: group and indices of refused fixes."""
    return {
        "type": "track",
        "title": "Track seen from above",
        "unit": "m",
        "x": pool.add(times),
        "tracks": [{"group": group, "east": pool.add(east), "north": pool.add(north)} for group, east, north in tracks],
        "refused": [{"group": group, "at": [int(place) for place in places]} for group, places in marks],
    }


def intervals_panel(title: str, rows: Iterable[tuple[str, float, float | None, float | None]]) -> dict[str, Any]:
    """Values beside a line at 1, on a logarithmic scale. rows: name, value, ends of its interval (None: it has none)."""
    shown = [dict(zip(("name", "value", "low", "high"), row, strict=True)) for row in rows]
    return {"type": "intervals", "title": title, "rows": shown}


def table(
    caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]], *, group: int | None = None, below: Sequence[str] = (),
    warnings: Sequence[tuple[int, int]] = (), state: str = "", wide: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """A table of texts; the first column names the row. below: sentences. warnings: row and column of marked cells.

    state: a word on the health of what the table shows (`insenv.evaluation.nis.VERDICTS`).  wide: no table stands
    beside it.
    """
    return {
        "caption": caption, "columns": list(columns), "rows": [list(row) for row in rows], "group": group,
        "below": list(below), "warnings": [list(place) for place in warnings], "state": state, "wide": wide,
    }  # fmt: skip


def section(title: str, panels: Sequence[Mapping[str, Any]], columns: int = 3, note: str = "") -> dict[str, Any]:
    """Panels under a heading, up to `columns` beside each other."""
    return {"title": title, "panels": list(panels), "columns": columns, "note": note}
