"""The figure of a run: errors over time beside their limits or the filter's own three sigma, and where the vehicle went."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.evaluation import ATTITUDE, CHANNELS, POSITION, VELOCITY, Report, Result, Track
from insenv.report.tables import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# Okabe and Ito's colours without yellow: told apart by colour-blind readers, and legible on white
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LIMIT, TRUTH, PALE = "#555555", "#bbbbbb", "#888888"
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
    "svg.hashsalt": "insenv",  # ids in an SVG are the same in every run
}
_WIDE = 10.0  # an error that falls by more than this along the run is drawn on a symmetric logarithmic scale


def save(figure: Figure, paths: Mapping[str, Path]) -> None:
    """Save under each path, by kind ("png", "svg"); the same figure gives the same bytes."""
    from matplotlib import rc_context

    metadata: dict[str, dict[str, Any]] = {"svg": {"Date": None, "Creator": "insenv"}, "png": {"Software": "insenv"}}
    with rc_context(STYLE):
        for kind, path in paths.items():
            figure.savefig(path, format=kind, dpi=150, metadata=metadata.get(kind, {}))


def draw(report: Report) -> Figure:
    """The figure of a run or replay, all its estimators in one; needs no display and changes no global state of matplotlib."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context({**_defaults(), **STYLE}):
        figure = Figure(layout="constrained")
        FigureCanvasAgg(figure)
        shown = [name for name in CHANNELS if any(name in r.errors for r in report.results)]
        handles = _attitude_page(figure, report, shown) if set(shown) <= set(ATTITUDE) else _navigation_page(figure, report, shown)
        seed = "" if report.seed is None else f", seed {report.seed}"
        figure.suptitle(f"{_title(report)}\n{report.scenario}{seed}, {report.duration_s:g} s", fontsize=10.5)
        figure.legend(
            handles=list(handles.values()),
            loc="outside lower center",
            ncols=min(4, len(handles)),
            frameon=False,
        )
        return figure


def _defaults() -> dict[str, Any]:
    """matplotlib's own defaults, whatever the user's settings file says."""
    from matplotlib import rcParamsDefault

    return {name: value for name, value in rcParamsDefault.items() if not name.startswith(("backend", "date.", "toolbar"))}


def _title(report: Report) -> str:
    return (report.title or report.scenario).replace("$", r"\$")


def _error_label(channel: str) -> str:
    return label(channel).replace(" [", " error [")


# --- pages -------------------------------------------------------------------------------------------


def _attitude_page(figure: Figure, report: Report, shown: list[str]) -> dict[str, Any]:
    """Alignment: each angle over the whole run and, beside it, over the time of the statistics."""
    figure.set_size_inches(9.0, 1.2 + 2.1 * len(shown))
    axes = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=(1.25, 1))
    handles: dict[str, Any] = {}
    begin = min(r.from_s for r in report.results)
    end = max(float(r.time[-1]) for r in report.results)
    for (left, right), channel in zip(axes, shown, strict=True):
        for axis, from_s in ((left, -math.inf), (right, begin)):
            handles |= _channel(axis, report, channel, from_s, bands=False)
        left.set_ylabel(_error_label(channel))
        left.axvspan(begin, end, color="#f4f4f4", zorder=0, linewidth=0)
        right.set_xlim(begin, end)
    axes[0, 0].set_title("Error over the whole run", loc="left")
    axes[0, 1].set_title(f"From {begin:g} s on, where the statistics are taken", loc="left")
    axes[0, 0].set_xlim(0.0, end)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.align_ylabels(axes[:, 0])
    return handles


def _navigation_page(figure: Figure, report: Report, shown: list[str]) -> dict[str, Any]:
    """Navigation: a row of panels each for attitude, position and velocity, and the track seen from above."""
    groups = [[name for name in group if name in shown] for group in (ATTITUDE, POSITION, VELOCITY)]
    groups = [group for group in groups if group]
    wide = report.truth.latitude is not None
    figure.set_size_inches(13.0 if wide else 9.5, 1.4 + 2.2 * len(groups))
    mosaic = [[*(group + ["."] * (3 - len(group))), *(["track"] if wide else [])] for group in groups]
    axes = figure.subplot_mosaic(mosaic, width_ratios=[1, 1, 1, 1.35][: len(mosaic[0])])  # type: ignore[arg-type]
    handles: dict[str, Any] = {}
    first: Axes | None = None
    begin = min(float(r.time[0]) for r in report.results)
    end = max(float(r.time[-1]) for r in report.results)
    for group in groups:
        for channel in group:
            axis = axes[channel]
            handles |= _channel(axis, report, channel, -math.inf, bands=True)
            axis.set_title(_error_label(channel), loc="left")
            if first is None:
                first = axis
            else:
                axis.sharex(first)
            if group is groups[-1]:
                axis.set_xlabel("time [s]")
            else:
                axis.tick_params(labelbottom=False)
            axis.set_xlim(begin, end)
    if wide:
        handles |= _plan(axes["track"], report)
    return handles


# --- panels ------------------------------------------------------------------------------------------


def _channel(axis: Axes, report: Report, channel: str, from_s: float, bands: bool) -> dict[str, Any]:
    """Draw all estimators' errors in one channel; give the legend's handles by their text."""
    handles: dict[str, Any] = {}
    axis.axhline(0.0, color=PALE, linewidth=0.6, zorder=1)
    drawn: list[Array] = []
    reach: list[float] = []
    limits: dict[float, str] = {}
    for index, result in enumerate(report.results):
        if channel not in result.errors:
            continue
        colour = COLOURS[index % len(COLOURS)]
        late = result.time >= from_s - 1e-9
        time, error = result.time[late], result.errors[channel][late]
        drawn.append(error)
        (handles[result.estimator],) = axis.plot(time, error, color=colour, label=result.estimator, zorder=3)
        if bands and channel in result.sigma:
            sigma = result.sigma[channel][late]
            name = f"{result.estimator}: stated ±3 sigma"
            times, widest = _envelope(time, 3.0 * sigma)
            handles[name] = axis.fill_between(
                times, -widest, widest, color=colour, alpha=0.16, linewidth=0, zorder=2, label=name
            )
            reach.append(3.0 * float(np.median(sigma)))
        elif channel in result.limit:
            limits.setdefault(round(result.limit[channel], 12), colour)
    for limit, colour in limits.items():
        for sign in (-1, 1):
            line = axis.axhline(
                sign * limit, color=LIMIT if len(limits) == 1 else colour, linestyle=(0, (4, 2)), linewidth=1.0, zorder=4
            )
        line.set_label("theoretical limit, ±1 sigma")
        handles[str(line.get_label())] = line
    _scale(axis, drawn, [*reach, *limits])
    return handles


def _envelope(time: Array, value: Array, points: int = 600) -> tuple[Array, Array]:
    """At most about `points` times and the largest value about each: what a band a few pixels fine shows."""
    stride = -(-len(time) // points)
    if stride == 1:
        return time, value
    begins = np.arange(0, len(time), stride)
    return time[np.minimum(begins + stride // 2, len(time) - 1)], np.maximum.reduceat(value, begins)


def _scale(axis: Axes, errors: list[Array], reach: list[float]) -> None:
    """Vertical scale: linear about the errors and limits; symmetric logarithmic where the errors fall by orders.

    A logarithmic one is linear within the errors of the last quarter, so that its end can be read as well as its beginning.
    """
    from matplotlib.ticker import MaxNLocator

    finite = [e[np.isfinite(e)] for e in errors]
    finite = [e for e in finite if e.size]
    largest = max((float(np.abs(e).max()) for e in finite), default=0.0)
    settled = max((float(np.abs(e[len(e) * 3 // 4 :]).max()) for e in finite), default=0.0)
    settled = max([settled, *reach, 1e-300])
    if largest <= _WIDE * settled:
        top = 1.12 * max(largest, settled)
        axis.set_ylim(-top, top)
        axis.yaxis.set_major_locator(MaxNLocator(5))
        return
    threshold = 10.0 ** math.ceil(math.log10(settled) - 1e-9)
    decades = math.ceil(math.log10(largest) - 1e-9)
    lowest, highest = min(float(e.min()) for e in finite), max(float(e.max()) for e in finite)
    axis.set_yscale("symlog", linthresh=threshold, linscale=1.3)
    axis.set_ylim(min(1.8 * lowest, -1.3 * threshold), max(1.8 * highest, 1.3 * threshold))
    first = round(math.log10(threshold))
    stride = 1 + (decades - first) // 4
    marks = [10.0**power for power in range(first, decades + 1, stride)]
    ticks = [*(-m for m in reversed(marks)), 0.0, *marks]
    axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    axis.set_yticks([], minor=True)
    axis.axhspan(-threshold, threshold, color="#f1f6fa", linewidth=0, zorder=0)


def _plan(axis: Axes, report: Report) -> dict[str, Any]:
    """The tracks seen from above, north up, from the start of the truth."""
    truth = report.truth
    east, north = _ground(truth, truth)
    span = max(float(np.ptp(east)), float(np.ptp(north)))
    scale, unit = (1e-3, "km") if span > 5000 else (1.0, "m")
    handles: dict[str, Any] = {}
    name = "truth" if report.seed is not None else "reference"
    (handles[name],) = axis.plot(east * scale, north * scale, color=TRUTH, linewidth=4.0, zorder=2, label=name)
    for index, result in enumerate(report.results):
        track = _track(result)
        if track is not None:
            easting, northing = _ground(track, truth)
            axis.plot(easting * scale, northing * scale, color=COLOURS[index % len(COLOURS)], linewidth=1.0, zorder=3)
    (handles["start"],) = axis.plot(
        [0], [0], marker="o", linestyle="", markersize=6, markerfacecolor="white", markeredgecolor="black", zorder=5, label="start"
    )
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_title("Track seen from above", loc="left")
    axis.set_xlabel(f"east [{unit}]")
    axis.set_ylabel(f"north [{unit}]")
    return handles


def _track(result: Result) -> Track | None:
    place = {name: result.outputs.get(name) for name in ("latitude", "longitude", "height")}
    return None if any(value is None for value in place.values()) else Track(result.time, **place)


def _ground(track: Track, truth: Track) -> tuple[Array, Array]:
    """East and north (n,) of a track, m, from the truth's first place: arcs along the ellipsoid, so that a long track stays in scale."""
    assert track.latitude is not None and track.longitude is not None
    assert truth.latitude is not None and truth.longitude is not None
    origin = float(truth.latitude[0]), float(truth.longitude[0])
    meridian, transverse = (float(radius) for radius in geodesy.numeric.radii(math.sin(origin[0])))
    north = (track.latitude - origin[0]) * meridian
    turned = (track.longitude - origin[1] + math.pi) % (2 * math.pi) - math.pi
    return turned * transverse * math.cos(origin[0]), north
