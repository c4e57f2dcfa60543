"""The figure of a run: errors over time with their limits or the filter's stated three sigma, and the track of the vehicle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base import style
from insenv.base.style import COLOURS, DASHED, LIMIT, PALE, STATISTICS
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, VELOCITY
from insenv.evaluation.health import APART, course
from insenv.report import attitudes, tracks
from insenv.report.run_data import RunData, has_fixes, without_fixes
from insenv.report.scales import set_scale
from insenv.report.tables import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]


def draw(report: RunData) -> Figure:
    """The figure of a run or replay with all its estimators; requires `drawable`.

    It needs no display and does not change the global state of matplotlib.
    """
    with style.page() as figure:
        shown = [name for name in CHANNELS if any(name in r.errors for r in report.results)]
        placed = any(tracks.track_of(r) is not None for r in report.results)
        alone = _track_page if placed else attitudes.page
        page = alone if not shown else _attitude_page if set(shown) <= set(ATTITUDE) else _navigation_page
        handles = page(figure, report, shown)
        seed = "" if report.seed is None else f", seed {report.seed}"
        style.title(figure, f"{report.title or report.scenario}\n{report.scenario}{seed}, {report.duration_s:g} s")
        style.legend(figure, handles)
        return figure


def drawable(report: RunData) -> bool:
    """Whether there are errors, a track or an attitude to draw."""
    return any(len(r.time) and (r.errors or tracks.track_of(r) is not None or "q_nb" in r.outputs) for r in report.results)


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
        left.axvspan(begin, end, color=STATISTICS, zorder=0, linewidth=0)
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
    side = _side_panels(report, report.truth.latitude is not None)
    rows = max(len(groups), len(side)) if side else len(groups)
    figure.set_size_inches(13.0 if side else 9.5, 1.4 + 2.2 * rows)
    mosaic = [group + ["."] * (3 - len(group)) for group in (groups + groups[-1:] * (rows - len(groups)))]
    if side:  # the first panel on the right, the track, takes the rows that are left
        column = side[:1] * (rows - len(side)) + side
        mosaic = [[*row, panel] for row, panel in zip(mosaic, column, strict=True)]
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
    for panel in side:
        handles |= PANELS[panel](axes[panel], report)
        if panel != "track":
            axes[panel].set_xlim(begin, end)
    for name, axis in axes.items():
        if name not in ("track", "."):
            handles |= style.shade(axis, without_fixes(report.results))
    return handles


def _track_page(figure: Figure, report: RunData, shown: list[str]) -> dict[str, Any]:
    """A log without a reference: the tracks, and the test ratios."""
    side = _side_panels(report, True)
    heights = [3.0 if panel == "track" else 1.0 for panel in side]
    figure.set_size_inches(8.0, 3.0 + 2.0 * sum(heights) * 2 / 3)
    handles: dict[str, Any] = {}
    for axis, panel in zip(figure.subplots(len(side), 1, height_ratios=heights, squeeze=False)[:, 0], side, strict=True):
        handles |= PANELS[panel](axis, report)
        if panel != "track":
            handles |= style.shade(axis, without_fixes(report.results))
    return handles


def _side_panels(report: RunData, placed: bool) -> list[str]:
    """Names of the panels beside the errors: the track, the height where it matters, the test ratios of fixes."""
    panels = ["track"] if placed else []
    if placed and (steep := tracks.steepness(report)) > tracks.STEEP:
        panels = ["track", "height"] if steep < 1.0 / tracks.STEEP else ["height"]
    return panels + ["health"] * any(has_fixes(r) for r in report.results)


# --- panels ------------------------------------------------------------------------------------------


def _channel(axis: Axes, report: RunData, channel: str, from_s: float, bands: bool) -> dict[str, Any]:
    """Draw the errors of all estimators in one channel; return the legend's handles by their text."""
    handles: dict[str, Any] = {}
    axis.axhline(0.0, color=PALE, linewidth=0.6, zorder=1)
    drawn: list[Array] = []
    reach: list[float] = []
    limits: dict[bytes, tuple[Array, Array, str]] = {}
    for index, result in enumerate(report.results):
        if channel not in result.errors:
            continue
        colour = COLOURS[index % len(COLOURS)]
        late = result.time >= from_s - 1e-9
        time, error = result.time[late], result.errors[channel][late]
        drawn.append(error)
        reach.append(0.0)
        shown = style.unwrapped(error) if channel in ATTITUDE else error
        (handles[result.estimator],) = axis.plot(time, shown, color=colour, label=result.estimator, zorder=3)
        if bands and channel in result.sigma:
            sigma = result.sigma[channel][late]
            name = f"{result.estimator}: stated ±3 sigma"
            times, widest = _envelope(time, 3.0 * sigma)
            handles[name] = axis.fill_between(
                times, -widest, widest, color=colour, alpha=0.16, linewidth=0, zorder=2, label=name
            )
            reach[-1] = 3.0 * float(np.median(sigma))
        if channel in result.limit_sigma:
            limit = result.limit_sigma[channel][late]
            reach[-1] = max(reach[-1], float(np.max(limit[-max(1, len(limit) // 4) :])))
            limits.setdefault(limit.tobytes(), (time, limit, colour))
    for time, limit, colour in limits.values():
        for sign in (-1, 1):
            (line,) = axis.plot(
                time, sign * limit, color=LIMIT if len(limits) == 1 else colour, linestyle=DASHED, linewidth=1.0, zorder=4
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
        if not has_fixes(result):
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
    axis.set_title("Innovations of fixes / their sigma, rms", loc="left")
    axis.set_xlabel("time [s]")
    return handles


def _envelope(time: Array, value: Array, points: int = 600) -> tuple[Array, Array]:
    """At most about `points` times, with the largest value around each."""
    stride = -(-len(time) // points)
    if stride == 1:
        return time, value
    begins = np.arange(0, len(time), stride)
    return time[np.minimum(begins + stride // 2, len(time) - 1)], np.maximum.reduceat(value, begins)


PANELS = {"track": tracks.plan, "height": tracks.height, "health": _health}
"""The panels beside the errors, by name."""
