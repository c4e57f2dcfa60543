"""The figure of a `Picture`: the one place where panels become matplotlib's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base import style
from insenv.base.style import COLOURS, LIMIT, PALE, STATISTICS, TRUTH
from insenv.core.tables import Array
from insenv.report.panels import (
    DASHED,
    OPAQUE,
    TIME,
    TRUTH_GROUP,
    Band,
    Curve,
    IntervalsPanel,
    Panel,
    Picture,
    Range,
    TimePanel,
    TrackPanel,
    extents_of,
    round_up,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PALETTE = (*COLOURS, "#8C6BB1", "#A6761D", "#7A9A01", "#F0E442", "#c8c8c8", "#7f7f7f")
"""Colours of the groups, as on the page."""
CIRCLE: Any = {"marker": "o", "linestyle": "", "markersize": 6, "markerfacecolor": "white", "markeredgecolor": "black"}
FORMS: dict[str, dict[str, Any]] = {
    "line": {"linewidth": 1.1, "zorder": 3},
    "truth": {"linewidth": 4.0, "zorder": 2},
    "thin": {"linewidth": 0.7, "zorder": 3},
    "dotted": {"linewidth": 0.8, "zorder": 3, "linestyle": ":"},
    "dashed": {"linewidth": 1.1, "zorder": 3, "linestyle": DASHED},
    "marked": {"linewidth": 1.1, "zorder": 3, "marker": "o", "markersize": 3.0},
    "circles": {"linestyle": "", "zorder": 4, "marker": "o", "markersize": 6.0, "markeredgecolor": "black"},
    "points": {"linestyle": "", "zorder": 3, "marker": ".", "markersize": 2.5},
    "crosses": {"linestyle": "", "zorder": 3, "marker": "x", "markersize": 5.0},
}
FAINT = 0.16
"""Opacity of a band of strength 1."""
POINTS = 600
"""Approximate number of points of a band."""
KILOMETRES = 5000.0
"""Extent of a track from which it is drawn in km, m."""


def draw(picture: Picture) -> Figure:
    """The figure; it needs no display and does not change the global state of matplotlib."""
    with style.page() as figure:
        figure.set_size_inches(*picture.size)
        mosaic = [["." if panel is None else str(id(panel)) for panel in row] for row in picture.grid]
        placed = figure.subplot_mosaic(mosaic, width_ratios=picture.ratios)  # type: ignore[arg-type]
        handles: dict[str, Any] = {}
        for panel in {id(panel): panel for row in picture.grid for panel in row if panel is not None}.values():
            handles |= _Drawing(placed[str(id(panel))], picture).panel(panel)
        for above, below in zip(picture.grid, [*picture.grid[1:], [None] * len(picture.grid[-1])], strict=True):
            for upper, lower in zip(above, below, strict=True):
                if isinstance(upper, TimePanel) and upper is not lower:
                    _name_x(placed[str(id(upper))], upper, lower)
        if picture.heads:
            for name, head in zip(picture.heads, picture.grid[0], strict=True):
                placed[str(id(head))].set_title(name, loc="left")
            left = [(row[0], placed[str(id(row[0]))]) for row in picture.grid]
            for first, axes in left:
                axes.set_ylabel(_label(first))
            figure.align_ylabels([axes for _, axes in left])
        style.title(figure, picture.title)
        style.legend(figure, handles, columns=picture.columns)
        return figure


def _name_x(axes: Axes, panel: TimePanel, below: Panel | None) -> None:
    """Say what x is, unless the panel below has the same scale."""
    if isinstance(below, TimePanel) and panel.x_span == below.x_span and np.array_equal(panel.x, below.x):
        axes.tick_params(labelbottom=False)
    else:
        axes.set_xlabel(panel.x_name)


def _label(panel: Panel | None) -> str:
    if panel is None or panel.label:
        return "" if panel is None else panel.label
    return panel.title if not isinstance(panel, TimePanel) or panel.unit == "1" else f"{panel.title} [{panel.unit}]"


class _Drawing:
    """Draws one panel; what it draws returns the legend's handles by their text."""

    def __init__(self, axes: Axes, picture: Picture) -> None:
        self.axes, self.picture = axes, picture
        self.handles: dict[str, Any] = {}

    def panel(self, panel: Panel) -> dict[str, Any]:
        """Draw a panel of any kind."""
        if not self.picture.heads:
            self.axes.set_title(_label(panel), loc="left")
        if isinstance(panel, TimePanel):
            self._time(panel)
        elif isinstance(panel, TrackPanel):
            self._track(panel)
        else:
            self._intervals(panel)
        return self.handles

    def _name(self, group: int) -> str:
        return self.picture.truth if group == TRUTH_GROUP else dict(enumerate(self.picture.names)).get(group, "")

    def _keep(self, name: str, handle: Any) -> None:
        if name:
            handle.set_label(name)
            self.handles[name] = handle

    # --- over time

    def _time(self, panel: TimePanel) -> None:
        axes = self.axes
        if not panel.marks:
            axes.text(0.5, 0.5, panel.note, transform=axes.transAxes, ha="center")
        if panel.errors and not panel.positive:
            axes.axhline(0.0, color=PALE, linewidth=0.6, zorder=1)
        if panel.level is not None:
            axes.axhline(panel.level, color=LIMIT, linestyle="-" if panel.log else DASHED, linewidth=0.9, zorder=2)
        for mark in panel.marks:
            if isinstance(mark, Curve):
                self._curve(mark, panel)
            elif isinstance(mark, Band):
                self._band(mark, panel)
            else:
                alpha = 1.0 if mark.strength >= OPAQUE else FAINT * mark.strength
                colour = LIMIT if mark.group == TRUTH_GROUP else _colour(mark.group)
                area = axes.fill_between(panel.x, mark.low, mark.high, color=colour, alpha=alpha, linewidth=0, zorder=2)
                self._keep(mark.label or self._name(mark.group), area)
        self._scale(panel)
        if panel.x_name != TIME and not panel.log_x:
            axes.xaxis.get_major_locator().set_params(integer=True)  # type: ignore[call-arg]
        if not panel.log_x and len(panel.x) > 1:
            begin, end = float(panel.x[0]), float(panel.x[-1])
            axes.set_xlim(0.0 if 0 < begin < 0.02 * end else begin, end)
            if panel.from_s is not None and not panel.positive:
                axes.axvspan(panel.from_s, end, color=STATISTICS, zorder=0, linewidth=0)
        if panel.x_span is not None:
            axes.set_xlim(*panel.x_span)
        self.handles |= style.shade(axes, panel.shade)

    def _curve(self, mark: Curve, panel: TimePanel) -> None:
        axes, colour, x = self.axes, _colour(mark.group), panel.x if mark.x is None else mark.x
        name = mark.label or self._name(mark.group)
        if mark.kind == "limit":
            colour = LIMIT if mark.group == TRUTH_GROUP else colour
            if panel.positive:
                axes.plot(x, mark.y, color="white", linewidth=2.2, zorder=3)
            for sign in (1,) if panel.positive else (-1, 1):
                (line,) = axes.plot(x, sign * mark.y, color=colour, linestyle=DASHED, linewidth=1.0, zorder=4)
            self._keep(mark.label or ("theoretical limit" if panel.positive else "theoretical limit, ±1 sigma"), line)
        elif mark.kind == "crosses":
            self._keep(f"{name}: fix refused", axes.plot(x, mark.y, color=colour, **FORMS["crosses"])[0])
        elif mark.kind == "model":
            self._keep(name, axes.plot(x, mark.y, linestyle=mark.dash, color=LIMIT, linewidth=0.9)[0])
        else:
            form = FORMS["truth" if (mark.group, mark.kind) == (TRUTH_GROUP, "line") else mark.kind]
            y = style.unwrapped(mark.y) if panel.wraps else mark.y
            (line,) = axes.plot(x, y, color=colour, **form)
            if mark.kind != "points":
                self._keep(name, line)

    def _band(self, mark: Band, panel: TimePanel) -> None:
        x, half, centre = panel.x, mark.half, mark.centre
        if centre is None:
            x, half = _envelope(x, half)
        middle = 0.0 if centre is None else centre
        form: dict[str, Any] = {"color": _colour(mark.group), "alpha": FAINT, "linewidth": 0, "zorder": 2}
        area = self.axes.fill_between(x, middle - half, middle + half, **form)
        self._keep(f"{self._name(mark.group)}: stated ±3 sigma", area)

    def _scale(self, panel: TimePanel) -> None:
        """The vertical scale, and the horizontal one if it is logarithmic."""
        axes, curves = self.axes, [mark for mark in panel.marks if isinstance(mark, Curve)]
        centred = [mark for mark in panel.marks if isinstance(mark, Band) and mark.centre is not None]
        if panel.log_x:
            axes.set_xscale("log")
        if panel.linear_to is not None:
            style.symlog(axes, panel.linear_to)
        if panel.log:
            values = np.concatenate([curve.y for curve in curves] or [np.ones(1)])
            if panel.level is not None and (values := values[np.isfinite(values)]).size:
                low, high = float(np.quantile(values, 0.02)), float(values.max())
                axes.set_ylim(0.7 * min(0.5 * panel.level, low), 1.5 * max(4.0 * panel.level, high))
            style.log(axes)
        elif panel.span is not None:
            axes.set_ylim(*panel.span)
        elif panel.most is not None:
            axes.set_ylim(0.0, panel.most)
        elif panel.positive:
            self._from_zero(panel, curves)
        elif panel.errors:
            self._errors(panel)
        elif panel.level is not None:
            axes.set_ylim(0.0, None)
        elif centred:  # what is estimated first would hide the rest
            late = len(panel.x) // 4
            halves = {mark.group: float(np.median(mark.half)) for mark in centred}
            ends = [y + sign * halves.get(c.group, 0.0) for c in curves for sign in (-1, 1) for y in _ends(c.y[late:])]
            space = 0.08 * (max(ends) - min(ends)) + 1e-3
            axes.set_ylim(min(ends) - space, max(ends) + space)

    def _from_zero(self, panel: TimePanel, curves: Sequence[Curve]) -> None:
        """A linear scale; an alignment begins with errors that would hide the rest."""
        late = panel.x >= 0.3 * panel.x[-1] if panel.from_s else np.full(len(panel.x), True)
        tops = [*(curve.y for curve in curves), *(mark.high for mark in panel.marks if isinstance(mark, Range))]
        highest = float(np.nanmax([np.nanmax(values[late]) for values in tops]))
        self.axes.set_ylim(0.0, 1.1 * highest if highest > 0.0 else 1.0)

    def _errors(self, panel: TimePanel) -> None:
        """A linear scale, or a symmetric logarithmic one with its linear part marked (`TimePanel.threshold`)."""
        from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

        axes, (errors, reach) = self.axes, panel.extents()
        (largest, settled), threshold = extents_of(errors, reach), panel.threshold
        if threshold is None:
            top = 1.12 * max(largest, *settled)
            axes.set_ylim(-top, top)
            axes.yaxis.set_major_locator(MaxNLocator(5))
            return
        finite = [e[np.isfinite(e)] for e in errors if np.isfinite(e).any()]
        lowest, highest = min(float(e.min()) for e in finite), max(float(e.max()) for e in finite)
        bottom, top = min(1.8 * lowest, -1.3 * max(settled)), max(1.8 * highest, 1.3 * max(settled))
        powers = range(math.ceil(math.log10(4.0 * threshold)), math.floor(math.log10(max(top, -bottom))) + 1)
        stride = -(-len(powers) // 3) or 1
        ticks = [threshold, *(10.0**power for power in powers[stride - 1 :: stride])]
        if not powers and (near := round_up(max(top, -bottom) / 2.6)) > threshold:
            ticks.append(near)
        axes.set_yscale("symlog", linthresh=threshold, linscale=1.3)
        axes.yaxis.set_major_locator(FixedLocator([*(-tick for tick in reversed(ticks)), 0.0, *ticks]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}"))
        axes.set_ylim(bottom, top)
        style.mark_scale(axes, threshold)
        linear = axes.axhspan(-threshold, threshold, color=style.LINEAR, linewidth=0, zorder=0)
        self._keep("scale: linear here, logarithmic beyond", linear)

    # --- others

    def _track(self, panel: TrackPanel) -> None:
        """Tracks from above, north up."""
        axes = self.axes
        widest = max(float(np.nanmax(arc) - np.nanmin(arc)) for _, *arcs in panel.tracks for arc in arcs)
        scale, unit = (1e-3, "km") if widest > KILOMETRES else (1.0, "m")
        for group, east, north in panel.tracks:
            wide, depth = (4.0, 2) if group == TRUTH_GROUP else (1.0, 3)
            (line,) = axes.plot(scale * east, scale * north, color=_colour(group), linewidth=wide, zorder=depth)
            if group == TRUTH_GROUP:
                self._keep(self._name(group), line)
        self._keep("start", axes.plot([0.0], [0.0], **CIRCLE, zorder=5)[0])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"east [{unit}]")
        axes.set_ylabel(f"north [{unit}]")

    def _intervals(self, panel: IntervalsPanel) -> None:
        """Values with their intervals, the first at the top."""
        axes, places = self.axes, np.arange(len(panel.rows))[::-1]
        values = np.array([[value if each is None else each for each in (value, *ends)] for _, value, *ends in panel.rows])
        spread = np.abs(np.nan_to_num(values[:, 1:] - values[:, :1])).T
        axes.errorbar(values[:, 0], places, xerr=spread, fmt="o", color=COLOURS[2], capsize=3, markersize=4)
        axes.set_yticks(places, [name for name, *_ in panel.rows])
        axes.axvline(1.0, color=LIMIT, linewidth=0.8)
        axes.set_xlabel(panel.x_name)
        if np.nanmax(values) > 5.0 * np.nanmin(values) > 0.0:
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _colour(group: int) -> str:
    return TRUTH if group == TRUTH_GROUP else PALETTE[group % len(PALETTE)]


def _ends(values: Array) -> list[float]:
    """The smallest and the largest value that are finite."""
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if finite.size else []


def _envelope(x: Array, half: Array) -> tuple[Array, Array]:
    """At most about `POINTS` values of x, with the largest half width around each."""
    stride = -(-len(x) // POINTS)
    if stride <= 1:
        return x, half
    begins = np.arange(0, len(x), stride)
    return x[np.minimum(begins + stride // 2, len(x) - 1)], np.maximum.reduceat(half, begins)
