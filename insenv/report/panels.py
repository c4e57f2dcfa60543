"""What pages and figures show, as data: curves and bands in panels, panels in sections.

A curve or a band names its entry in the legend by number (`group`); `TRUTH_GROUP` is the truth, the reference, or the limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from insenv.base.style import DASHED
from insenv.core.tables import Array

TRUTH_GROUP = -1
TIME = "time [s]"
OPAQUE = 4.5
"""Strength of bands that do not overlap."""
FALL, SPREAD = 10.0, 50.0
"""A scale of errors is logarithmic if they fall by more along the run, or if estimators differ by more."""

Kind = Literal["line", "points", "crosses", "limit", "marked", "thin", "dotted", "dashed", "circles", "model"]
"""Crosses: of what was refused.  limit: drawn at plus and minus the values.  In figures alone, marked: a line with dots; thin:
one of many lines; circles: published values; model: a grey line in the pattern `dash` of matplotlib."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Values (n,) over the panel's x, or over `x` (figures alone).  label: in a figure's legend, instead of the group's."""

    group: int
    y: Array
    kind: Kind = "line"
    x: Array | None = None
    label: str = ""
    dash: object = DASHED


@dataclass(frozen=True, eq=False)
class Band:
    """Plus and minus `half` (n,) around `centre` (zero if None)."""

    group: int
    half: Array
    centre: Array | None = None


@dataclass(frozen=True, eq=False)
class Range:
    """The area between two arrays; `strength` scales its opacity."""

    group: int
    low: Array
    high: Array
    strength: float = 1.0
    label: str = ""


@dataclass(eq=False)
class TimePanel:
    """A panel over time, or over another x.

    x (n,): s for time.  label: title in a figure (default: title and unit).  errors: a scale of errors, symmetric about 0, and
    logarithmic where a linear one would hide small errors.  log, log_x: logarithmic scales.  wraps: angles in degrees, drawn
    with a gap where they wrap.  from_s: start of the statistics, s.  positive: the vertical scale begins at 0.  most: where it
    ends; None: beyond the largest value.  level: the expected value, dashed in a figure.  shade: intervals of time without
    fixes, s.  x_name: what x is.  note: text of an empty panel in a figure.  In figures alone, span and x_span: ends of the
    scales; linear_to: value from which the vertical one is logarithmic.
    """

    title: str
    unit: str
    x: Array
    label: str = ""
    errors: bool = False
    log: bool = False
    log_x: bool = False
    wraps: bool = False
    from_s: float | None = None
    positive: bool = False
    most: float | None = None
    level: float | None = None
    shade: Sequence[tuple[float, float]] = ()
    x_name: str = TIME
    note: str = ""
    span: tuple[float, float] | None = None
    x_span: tuple[float, float] | None = None
    linear_to: float | None = None
    marks: list[Curve | Band | Range] = field(default_factory=list)

    @property
    def threshold(self) -> float | None:
        """Up to which value the scale is linear, and logarithmic beyond it; None for a linear scale.

        What an estimator states of itself does not choose it: the page, which shows that, has the scale of the figure.
        """
        return threshold_of(*self.without_bands().extents()) if self.errors else None

    def extents(self) -> tuple[list[Array], list[float]]:
        """By group that has a line: its errors, or the widest range of them, and the extent of its limit or stated accuracy."""
        errors, reach = {}, {}
        for mark in self.marks:
            if isinstance(mark, Curve) and mark.kind == "line":
                errors[mark.group] = mark.y
            elif isinstance(mark, Curve) and mark.kind == "limit":
                reach[mark.group] = float(np.nanmax(mark.y[-max(1, len(mark.y) // 4) :]))
            elif isinstance(mark, Band) and len(mark.half):
                reach[mark.group] = float(np.median(mark.half))
        widest = {m.group: np.stack([m.low, m.high], 1).ravel() for m in reversed(self.marks) if isinstance(m, Range)}
        shared = reach.get(TRUTH_GROUP, 0.0)
        return [widest.get(g, y) for g, y in errors.items()], [max(reach.get(g, 0.0), shared) for g in errors]

    def since(self, from_s: float) -> TimePanel:
        """The part of the panel from `from_s` on."""
        late = self.x >= from_s - 1e-9
        marks: list[Curve | Band | Range] = []
        for mark in self.marks:
            arrays: dict[str, Any] = {name: v[late] for name, v in vars(mark).items() if isinstance(v, np.ndarray)}
            marks.append(replace(mark, **arrays))
        return replace(self, x=self.x[late], marks=marks, from_s=None)

    def without_bands(self) -> TimePanel:
        """The panel without stated accuracies."""
        return replace(self, marks=[mark for mark in self.marks if not isinstance(mark, Band)])


@dataclass(frozen=True, eq=False)
class TrackPanel:
    """Tracks from above: group, east and north (n,) m at the times x (n,).  refused: group and indices of refused fixes."""

    x: Array
    tracks: Sequence[tuple[int, Array, Array]]
    refused: Sequence[tuple[int, NDArray[np.intp]]]
    title: str = "Track seen from above"
    label: str = ""


@dataclass(frozen=True)
class IntervalsPanel:
    """Values beside a line at 1.  rows: name, value, ends of its interval (None: it has none).  label, x_name: in a figure."""

    title: str
    rows: Sequence[tuple[str, float, float | None, float | None]]
    label: str = ""
    x_name: str = ""


Panel = TimePanel | TrackPanel | IntervalsPanel


@dataclass(frozen=True)
class Section:
    """Panels under a heading, up to `columns` beside each other."""

    title: str
    panels: Sequence[Panel]
    columns: int = 3
    note: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure: panels in rows.

    grid: a panel that stands in several cells fills them; None: an empty cell.  names: of the groups in the legend; truth: of
    `TRUTH_GROUP`.  size: inches.  heads: titles of the columns; the labels of the panels then stand at their left.
    ratios: widths of the columns.  columns: of the legend.
    """

    title: str
    grid: Sequence[Sequence[Panel | None]]
    names: Sequence[str]
    size: tuple[float, float]
    truth: str = "truth"
    heads: Sequence[str] = ()
    ratios: Sequence[float] | None = None
    columns: int = 4


def threshold_of(errors: Sequence[Array], reach: Sequence[float]) -> float | None:
    """Up to which value a scale of errors is linear, and logarithmic beyond it; None for a linear scale.

    errors, reach: by estimator, its errors and the extent of its limit.  A logarithmic scale is linear
    within the errors of the best estimator in the last quarter, so that these are legible beside the first of the worst one.
    """
    largest, settled = extents_of(errors, reach)
    if largest <= FALL * max(settled) and max(settled) <= SPREAD * min(settled):
        return None
    return round_up(min(settled))


def extents_of(errors: Iterable[Array], reach: Iterable[float]) -> tuple[float, list[float]]:
    """The largest error, and for each estimator that of the last quarter with its reach."""
    finite = [(e[np.isfinite(e)], r) for e, r in zip(errors, reach, strict=True)]
    finite = [(e, r) for e, r in finite if e.size]
    largest = max((float(np.abs(e).max()) for e, _ in finite), default=0.0)
    return largest, [max(float(np.abs(e[len(e) * 3 // 4 :]).max()), r, 1e-300) for e, r in finite] or [1.0]


def round_up(value: float) -> float:
    """The next larger of 1, 2, 5, 10, ..."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1 + 1e-9))
