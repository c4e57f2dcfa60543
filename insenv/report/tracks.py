"""Panels of a figure that show where a vehicle went: seen from above, and its height over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.base.style import COLOURS, TRUTH
from insenv.evaluation.errors import Result, Track
from insenv.report.run_data import RunData

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

STEEP = 0.3
"""A track whose height varies by more than this part of its horizontal extent shows its height too."""
CIRCLE: Any = {"marker": "o", "linestyle": "", "markersize": 6, "markerfacecolor": "white", "markeredgecolor": "black"}


def steepness(report: RunData) -> float:
    """Extent of the height over the horizontal extent, of the truth or, without it, of the first track; 0: no track."""
    found = next(
        (track for track in (report.truth, *map(track_of, report.results)) if track and track.height is not None), None
    )
    if found is None or found.latitude is None or found.height is None:
        return 0.0
    height = found.height[np.isfinite(found.height)]
    wide = max(float(np.ptp(arc)) for arc in _ground(found, found))
    return float(np.ptp(height)) / max(wide, 1e-3) if np.ptp(height) > 1.0 else 0.0


def height(axis: Axes, report: RunData) -> dict[str, Any]:
    """Draw the height over time, relative to the first one of the truth (or of the first track)."""
    tracks = [track_of(result) for result in report.results]
    first = next(track for track in (report.truth, *tracks) if track is not None and track.height is not None)
    assert first.height is not None
    start = float(first.height[np.isfinite(first.height)][0])
    handles: dict[str, Any] = {}
    if report.truth.height is not None:
        name = _name_of_truth(report)
        (handles[name],) = axis.plot(
            report.truth.time, report.truth.height - start, color=TRUTH, linewidth=4.0, zorder=2, label=name
        )
    for index, track in enumerate(tracks):
        if track is not None and track.height is not None:
            axis.plot(track.time, track.height - start, color=COLOURS[index % len(COLOURS)], linewidth=1.0, zorder=3)
    axis.set_title("Height above the start [m]")
    axis.set_xlabel("time [s]")
    return handles


def _name_of_truth(report: RunData) -> str:
    return "truth" if report.seed is not None else "reference"


def plan(axis: Axes, report: RunData) -> dict[str, Any]:
    """Draw the tracks from above, north up, relative to the start of the truth."""
    tracks = [track_of(result) for result in report.results]
    colours = [COLOURS[i % len(COLOURS)] for i, track in enumerate(tracks) if track is not None]
    known = [track for track in (report.truth, *tracks) if track is not None and track.latitude is not None]
    grounds = [_ground(track, known[0]) for track in known]
    scale, unit = (1e-3, "km") if max(float(np.ptp(arc)) for ground in grounds for arc in ground) > 5000 else (1.0, "m")
    lines = [(scale * east, scale * north) for east, north in grounds]
    handles: dict[str, Any] = {}
    if report.truth.latitude is not None:
        name = _name_of_truth(report)
        (handles[name],) = axis.plot(*lines.pop(0), color=TRUTH, linewidth=4.0, zorder=2, label=name)
    for colour, line in zip(colours, lines, strict=True):
        axis.plot(*line, color=colour, linewidth=1.0, zorder=3)
    (handles["start"],) = axis.plot([0.0], [0.0], **CIRCLE, zorder=5, label="start")
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_title("Track seen from above", loc="left")
    axis.set_xlabel(f"east [{unit}]")
    axis.set_ylabel(f"north [{unit}]")
    return handles


def track_of(result: Result) -> Track | None:
    place = {name: result.outputs.get(name) for name in ("latitude", "longitude", "height")}
    return None if any(value is None for value in place.values()) else Track(result.time, **place)


def ground(track: Track, origin: Track) -> tuple[Array, Array]:
    """East and north (n,) of a track, m, from the first known position of `origin`: arcs on the ellipsoid; NaN: not known."""
    assert track.latitude is not None and track.longitude is not None
    assert origin.latitude is not None and origin.longitude is not None
    latitude, longitude = (float(a[np.isfinite(a)][0]) for a in (origin.latitude, origin.longitude))
    meridian, transverse = (float(radius) for radius in geodesy.numeric.radii(math.sin(latitude)))
    turned = (track.longitude - longitude + math.pi) % (2 * math.pi) - math.pi
    return turned * transverse * math.cos(latitude), (track.latitude - latitude) * meridian


def _ground(track: Track, origin: Track) -> tuple[Array, Array]:
    """East and north of the known positions of a track."""
    east, north = ground(track, origin)
    there = np.isfinite(east) & np.isfinite(north)
    return east[there], north[there]
