"""The figure of a run: errors over time with their limits or the filter's stated three sigma, and the track of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, VELOCITY, Result, Track
from insenv.evaluation.health import APART, course
from insenv.report.run_data import RunData
from insenv.report.scales import set_scale
from insenv.report.tables import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

# Okabe and Ito's colours without yellow: distinguishable by colour-blind readers, and legible on white
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LIMIT, TRUTH, PALE = "#555555", "#bbbbbb", "#888888"
STYLE: Any = {
    "font.family": "DejaVu Sans",  # part of matplotlib: the same everywhere
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
    "svg.hashsalt": "insenv",  # makes the ids in an SVG reproducible
}


def save(figure: Figure, paths: Mapping[str, Path | BinaryIO]) -> None:
    """Save to each path or stream, by kind ("png", "svg"); the same figure gives the same bytes."""
    from matplotlib import rc_context

    metadata: dict[str, dict[str, Any]] = {"svg": {"Date": None, "Creator": "insenv"}, "png": {"Software": "insenv"}}
    with rc_context(STYLE):
        for kind, path in paths.items():
            figure.savefig(path, format=kind, dpi=150, metadata=metadata.get(kind, {}))


def draw(report: RunData) -> Figure:
    """The figure of a run or replay with all its estimators; requires `drawable`.

    It needs no display and does not change the global state of matplotlib.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context({**_defaults(), **STYLE}):
        figure = Figure(layout="constrained")
        FigureCanvasAgg(figure)
        shown = [name for name in CHANNELS if any(name in r.errors for r in report.results)]
        page = _track_page if not shown else _attitude_page if set(shown) <= set(ATTITUDE) else _navigation_page
        handles = page(figure, report, shown)
        seed = "" if report.seed is None else f", seed {report.seed}"
        figure.suptitle(f"{_title(report)}\n{report.scenario}{seed}, {report.duration_s:g} s", fontsize=10.5)
        figure.legend(
            handles=list(handles.values()),
            loc="outside lower center",
            ncols=min(4, len(handles)),
            frameon=False,
        )
        return figure


def drawable(report: RunData) -> bool:
    """Whether there are errors or a track to draw."""
    return any(len(r.time) and (r.errors or _track(r) is not None) for r in report.results)


def _defaults() -> Any:
    """The defaults of matplotlib, independent of the user's settings."""
    from matplotlib import rcParamsDefault

    return {name: value for name, value in rcParamsDefault.items() if not name.startswith(("backend", "date.", "toolbar"))}


def _title(report: RunData) -> str:
    return (report.title or report.scenario).replace("$", r"\$")


def _error_label(channel: str) -> str:
    return label(channel).replace(" [", " error [")


# --- pages -------------------------------------------------------------------------------------------


def _attitude_page(figure: Figure, report: RunData, shown: list[str]) -> dict[str, Any]:
    """Alignment: each angle over the whole run (left) and over the time of the statistics (right)."""
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


def _navigation_page(figure: Figure, report: RunData, shown: list[str]) -> dict[str, Any]:
    """Navigation: one row of panels each for attitude, position and velocity, the track from above, and the test ratios."""
    groups = [[name for name in group if name in shown] for group in (ATTITUDE, POSITION, VELOCITY)]
    groups = [group for group in groups if group]
    wide = report.truth.latitude is not None
    fixes = any(r.health is not None for r in report.results)
    figure.set_size_inches(
        13.0 if wide or fixes else 9.5, 1.4 + 2.2 * len(groups) + 1.6 * (len(groups) == 1 and wide and fixes)
    )
    mosaic = [group + ["."] * (3 - len(group)) for group in groups]
    if wide and fixes:  # on the right the track, and below it the test ratios, one row high
        rows = mosaic if len(mosaic) > 1 else 2 * mosaic
        mosaic = [[*row, "track"] for row in rows[:-1]] + [[*rows[-1], "health"]]
    elif wide or fixes:
        mosaic = [[*row, "track" if wide else "health"] for row in mosaic]
    axes = figure.subplot_mosaic(mosaic, width_ratios=[1, 1, 1, 1.35][: len(mosaic[0])])  # type: ignore[arg-type]
    handles: dict[str, Any] = {}
    first: Axes | None = None
    begin = min(float(r.time[0]) for r in report.results)
    end = max(float(r.time[-1]) for r in report.results)
    begin = 0.0 if 0 < begin < 0.02 * end else begin
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
    if fixes:
        handles |= _health(axes["health"], report)
        axes["health"].set_xlim(begin, end)
    if wide:
        handles |= _plan(axes["track"], report)
    return handles


def _track_page(figure: Figure, report: RunData, shown: list[str]) -> dict[str, Any]:
    """A log without a reference: the tracks, and the test ratios."""
    if all(r.health is None for r in report.results):
        figure.set_size_inches(8.0, 7.0)
        return _plan(figure.subplots(), report)
    figure.set_size_inches(8.0, 9.0)
    above, below = figure.subplots(2, 1, height_ratios=(3, 1))
    return {**_plan(above, report), **_health(below, report)}


# --- panels ------------------------------------------------------------------------------------------


def _channel(axis: Axes, report: RunData, channel: str, from_s: float, bands: bool) -> dict[str, Any]:
    """Draw the errors of all estimators in one channel; return the legend's handles by their text."""
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
        reach.append(0.0)
        (handles[result.estimator],) = axis.plot(time, error, color=colour, label=result.estimator, zorder=3)
        if bands and channel in result.sigma:
            sigma = result.sigma[channel][late]
            name = f"{result.estimator}: stated ±3 sigma"
            times, widest = _envelope(time, 3.0 * sigma)
            handles[name] = axis.fill_between(
                times, -widest, widest, color=colour, alpha=0.16, linewidth=0, zorder=2, label=name
            )
            reach[-1] = 3.0 * float(np.median(sigma))
        elif channel in result.limit:
            reach[-1] = result.limit[channel]
            limits.setdefault(round(result.limit[channel], 12), colour)
    for limit, colour in limits.items():
        for sign in (-1, 1):
            line = axis.axhline(
                sign * limit, color=LIMIT if len(limits) == 1 else colour, linestyle=(0, (4, 2)), linewidth=1.0, zorder=4
            )
        line.set_label("theoretical limit, ±1 sigma")
        handles[str(line.get_label())] = line
    return handles | set_scale(axis, drawn, reach)


def _health(axis: Axes, report: RunData) -> dict[str, Any]:
    """Draw the RMS of the test ratios of the fixes between records; return the handles of refused fixes by their text."""
    from matplotlib.ticker import LogLocator, NullLocator

    handles: dict[str, Any] = {}
    largest, smallest = APART, 0.5
    for index, result in enumerate(report.results):
        if result.health is None:
            continue
        colour = COLOURS[index % len(COLOURS)]
        ratio, refused = course(result.outputs)
        some = np.isfinite(ratio) & (ratio > 0)
        if not some.any():
            continue
        largest, smallest = max(largest, float(ratio[some].max())), min(smallest, float(np.quantile(ratio[some], 0.02)))
        axis.plot(result.time[some], ratio[some], ".", markersize=2.5, color=colour, zorder=3)
        gone = some & (refused > 0)
        if gone.any():
            name = f"{result.estimator}: fix refused"
            (handles[name],) = axis.plot(result.time[gone], ratio[gone], "x", markersize=5, color=colour, label=name, zorder=4)
    axis.axhline(1.0, color=LIMIT, linewidth=0.8, zorder=2)
    axis.set_yscale("log")
    axis.set_ylim(0.7 * smallest, 1.5 * largest)
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if largest < 100 * smallest else (1.0,)))
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.yaxis.set_minor_locator(NullLocator())
    axis.set_title("Innovations of fixes over their stated sigmas, rms", loc="left")
    axis.set_xlabel("time [s]")
    return handles


def _envelope(time: Array, value: Array, points: int = 600) -> tuple[Array, Array]:
    """At most about `points` times, with the largest value around each."""
    stride = -(-len(time) // points)
    if stride == 1:
        return time, value
    begins = np.arange(0, len(time), stride)
    return time[np.minimum(begins + stride // 2, len(time) - 1)], np.maximum.reduceat(value, begins)


def _plan(axis: Axes, report: RunData) -> dict[str, Any]:
    """Draw the tracks from above, north up, relative to the start of the truth."""
    tracks = [_track(result) for result in report.results]
    colours = [COLOURS[i % len(COLOURS)] for i, track in enumerate(tracks) if track is not None]
    known = [track for track in (report.truth, *tracks) if track is not None and track.latitude is not None]
    grounds = [_ground(track, known[0]) for track in known]
    scale, unit = (1e-3, "km") if max(float(np.ptp(arc)) for ground in grounds for arc in ground) > 5000 else (1.0, "m")
    lines = [(scale * east, scale * north) for east, north in grounds]
    handles: dict[str, Any] = {}
    if report.truth.latitude is not None:
        name = "truth" if report.seed is not None else "reference"
        (handles[name],) = axis.plot(*lines.pop(0), color=TRUTH, linewidth=4.0, zorder=2, label=name)
    for colour, line in zip(colours, lines, strict=True):
        axis.plot(*line, color=colour, linewidth=1.0, zorder=3)
    circle = {"marker": "o", "linestyle": "", "markersize": 6, "markerfacecolor": "white", "markeredgecolor": "black"}
    (handles["start"],) = axis.plot([0.0], [0.0], **circle, zorder=5, label="start")  # type: ignore[arg-type]
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_title("Track seen from above", loc="left")
    axis.set_xlabel(f"east [{unit}]")
    axis.set_ylabel(f"north [{unit}]")
    return handles


def _track(result: Result) -> Track | None:
    place = {name: result.outputs.get(name) for name in ("latitude", "longitude", "height")}
    return None if any(value is None for value in place.values()) else Track(result.time, **place)


def _ground(track: Track, origin: Track) -> tuple[Array, Array]:
    """East and north (n,) of a track, m, from the first known position of `origin`: arcs along the ellipsoid."""
    assert track.latitude is not None and track.longitude is not None
    assert origin.latitude is not None and origin.longitude is not None
    latitude, longitude = (float(a[np.isfinite(a)][0]) for a in (origin.latitude, origin.longitude))
    there = np.isfinite(track.latitude) & np.isfinite(track.longitude)
    meridian, transverse = (float(radius) for radius in geodesy.numeric.radii(math.sin(latitude)))
    turned = (track.longitude[there] - longitude + math.pi) % (2 * math.pi) - math.pi
    return turned * transverse * math.cos(latitude), (track.latitude[there] - latitude) * meridian
