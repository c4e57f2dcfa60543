"""The panels of a run or replay, and what of them stands on its page and in its figure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.base.remarks import LATE_S
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, VELOCITY, Result, Track, stated_sigma
from insenv.evaluation.health import course
from insenv.report.document import Page, page_of
from insenv.report.page import room, shown_records
from insenv.report.panels import TRUTH_GROUP, Band, Curve, Panel, Picture, Section, TimePanel, TrackPanel
from insenv.report.run_data import RunData, has_fixes, without_fixes
from insenv.report.tables import error_columns, error_label, facts, run_blocks, unit_of, within
from insenv.sensors import units

NAMES = {
    "roll_deg": "Roll", "pitch_deg": "Pitch", "heading_deg": "Heading", "north_m": "North", "east_m": "East", "down_m": "Down",
    "vn_mps": "Velocity north", "ve_mps": "Velocity east", "vd_mps": "Velocity down",
}  # fmt: skip
GROUPS = (("Attitude error", ATTITUDE), ("Position error", POSITION), ("Velocity error", VELOCITY))
EXPLAINED = {
    "rms": "final: at the end; rms, max: over the time of the statistics.",
    "limit": "limit: the smallest standard deviation that any method can have.",
    "stated": "stated: the standard deviation that the estimator itself states.",
    "vn": "vn, ve, vd: velocity north, east and down.",
}
"""What columns of a table of errors mean."""
AXES = ("forward", "right", "down")
BIASES = (
    ("Gyro bias", "gyro_bias", "deg/h", float(units.rad_s_to_deg_h(1.0))),
    ("Accelerometer bias", "accel_bias", "\N{MICRO SIGN}g", float(units.m_s2_to_ug(1.0))),
)
"""Title, output row, unit of the page and factor from SI; the standard deviation is in the row NAME_estimate_sigma."""
TRAVELS_M = 20.0
"""A ship that sways stays within this distance."""
STEEP = 0.3
"""A track whose height varies by more than this part of its horizontal extent shows its height in the figure too."""


def run_page(report: RunData, further: Mapping[str, Any] | None = None) -> Page:
    """The page of a run or replay, with as many records as fit into it.  further: other documents by kind, such as "live"."""
    further = further or {}
    records = max((len(r.time) for r in report.results), default=0)
    keep = shown_records(records, sum(map(_arrays, report.results)) + 21, room(further))
    thinned = [f"The page shows {len(keep)} of {records} records; the .npz file holds all."] if len(keep) < records else []
    counted, from_start = since_start(_thinned(report, keep))
    panels = RunPanels(counted, without_fixes(since_start(report)[0].results))
    return page_of(
        run_blocks(report),
        tab=f"{report.scenario}: {report.title}",
        title=report.title,
        facts=facts(report),
        truth=panels.truth_name,
        legend=[{"name": r.estimator} for r in report.results],
        explained=_explained(report),
        notes=[*thinned, *from_start],
        sections=[*panels.errors(), *panels.motion(), panels.biases()],
        further=further,
    )


def since_start(report: RunData) -> tuple[RunData, list[str]]:
    """The report with its times counted from its first second, if they count from a date, and a sentence that says so."""
    first = min((float(r.time[0]) for r in report.results if len(r.time)), default=0.0)
    if first < LATE_S:
        return report, []
    begin = math.floor(first)
    results = tuple(replace(r, time=r.time - begin, from_s=r.from_s - begin) for r in report.results)
    truth = replace(report.truth, time=report.truth.time - begin)
    return replace(report, results=results, truth=truth), [f"Times of the panels count from {begin} s of the log."]


def _thinned(report: RunData, keep: Any) -> RunData:
    """The report at some of its records."""

    def some(values: Mapping[str, Array], records: int) -> dict[str, Array]:
        return {name: v[keep] for name, v in values.items() if len(v) == records}

    kinds = ("outputs", "errors", "sigma", "limit_sigma")
    results = []
    for result in report.results:
        series: dict[str, Any] = {kind: some(getattr(result, kind), len(result.time)) for kind in kinds}
        results.append(replace(result, time=result.time[keep], **series))
    known = {each.name: getattr(report.truth, each.name) for each in fields(report.truth)}
    truth = {name: values[keep] for name, values in known.items() if values is not None and len(values)}
    return replace(report, results=tuple(results), truth=replace(report.truth, **truth))


def _arrays(result: Result) -> int:
    """The number of arrays that an estimator adds to a page."""
    rows = [name for _, row, *_ in BIASES for name in (row, f"{row}_estimate_sigma") if name in result.outputs]
    return len(result.errors) + len(result.sigma) + 3 * len(rows) + 11


def _explained(report: RunData) -> list[str]:
    """What the columns of the tables mean."""
    columns = {name for result in report.results if result.errors for name in error_columns(result)}
    meanings = [EXPLAINED[name] for name in ("rms", "limit", "stated") if name in columns]
    if any(name in VELOCITY for result in report.results for name in result.errors):
        meanings.append(EXPLAINED["vn"])
    return [*meanings, *([f"{within(1)}."] if "limit" in columns else [])]


# --- the figure --------------------------------------------------------------------------------------


def drawable(report: RunData) -> bool:
    """Whether there are errors, a track or an attitude to draw."""
    return any(len(r.time) and (r.errors or track_of(r) is not None or "q_nb" in r.outputs) for r in report.results)


def run_picture(report: RunData) -> Picture:
    """The figure of a run or replay with all its estimators; requires `drawable`.

    An alignment: each angle over the whole run, and over the time of the statistics.  A navigation: a row each for attitude,
    position and velocity, and beside them the track, the height where it matters, and the test ratios of fixes.
    """
    report, from_start = since_start(report)
    panels = RunPanels(report, without_fixes(report.results))
    seed = "" if report.seed is None else f", seed {report.seed}"
    title = "\n".join([f"{report.title or report.scenario}\n{report.scenario}{seed}, {report.duration_s:g} s", *from_start])
    names = [r.estimator for r in report.results]
    shown = [name for name in CHANNELS if any(name in r.errors for r in report.results)]
    if shown and set(shown) <= set(ATTITUDE):
        return angles_picture(
            title, names, [panels.error(name).without_bands() for name in shown], min(r.from_s for r in report.results)
        )
    placed = any(track_of(r) is not None for r in report.results)
    side = _side_panels(panels, placed if not shown else report.truth.latitude is not None)
    if not shown:
        grid: list[list[Panel | None]] = [[one] for one in (side if placed else panels.angles())]
        grid = [row for row in grid for _ in range(3 if isinstance(row[0], TrackPanel) else 1)]
        size = (8.0, 3.0 + 4.0 / 3.0 * len(grid)) if placed else (8.0, 7.5)
        return Picture(title, grid, names, size, panels.truth_name)
    groups = [[panels.error(name) for name in group if name in shown] for _, group in GROUPS]
    groups = [group for group in groups if group]
    rows = max(len(groups), len(side))
    grid = [[*group, *[None] * (3 - len(group))] for group in groups + groups[-1:] * (rows - len(groups))]
    # the first panel on the right, the track, takes the rows that are left
    column = side[:1] * (rows - len(side)) + side
    grid = [[*row, *one] for row, one in zip(grid, [[panel] for panel in column] or [[]] * rows, strict=True)]
    ratios = [1, 1, 1, 1.35][: len(grid[0])]
    return Picture(title, grid, names, (13.0 if side else 9.5, 1.4 + 2.2 * rows), panels.truth_name, ratios=ratios)


def angles_picture(title: str, names: Sequence[str], panels: Sequence[TimePanel], from_s: float, columns: int = 4) -> Picture:
    """Panels over the whole run at the left, over the time of the statistics at the right.  columns: of the legend."""
    heads = ("Error over the whole run", f"From {from_s:g} s on, where the statistics are taken")
    grid = [(replace(panel, from_s=from_s) if panel.errors else panel, panel.since(from_s)) for panel in panels]
    return Picture(title, grid, names, (9.0, 1.2 + 2.1 * len(grid)), heads=heads, ratios=(1.25, 1), columns=columns)


def _side_panels(panels: RunPanels, placed: bool) -> list[Panel]:
    """The panels beside the errors."""
    side: list[Panel] = []
    if placed:
        track, height = panels.track()
        steep = _steepness(panels.report)
        side = [height] if steep > 1.0 / STEEP else [track, height] if steep > STEEP else [track]
    return [*side, *panels.test_ratios()]


def _steepness(report: RunData) -> float:
    """Extent of the height over the horizontal extent, of the truth or, without it, of the first track; 0: no track."""
    tracks = (report.truth, *map(track_of, report.results))
    track = next((track for track in tracks if track and track.height is not None), None)
    if track is None or track.latitude is None or track.height is None:
        return 0.0
    height = track.height[np.isfinite(track.height)]
    return float(np.ptp(height)) / max(_extent(ground(track, track)), 1e-3) if np.ptp(height) > 1.0 else 0.0


# --- panels ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunPanels:
    """The panels of a report.  shade: intervals of time without fixes, s."""

    report: RunData
    shade: tuple[tuple[float, float], ...]

    @property
    def truth_name(self) -> str:
        """How the truth is called in the legend."""
        return "truth" if self.report.seed is not None else "reference"

    def panel(self, title: str, unit: str, **more: Any) -> TimePanel:
        """An empty panel."""
        times = self.report.results[0].time if self.report.results else np.zeros(0)
        return TimePanel(title, unit, times, shade=self.shade, **more)

    def errors(self) -> list[Section]:
        """The errors by channel."""
        known = {name for r in self.report.results for name in r.errors}
        return [Section(title, [self.error(name) for name in group if name in known]) for title, group in GROUPS]

    def error(self, channel: str) -> TimePanel:
        """The errors of all estimators in one channel, with their stated accuracies and limits."""
        results = [(place, r) for place, r in enumerate(self.report.results) if channel in r.errors]
        start = min(r.from_s for _, r in results)
        panel = self.panel(
            NAMES[channel], unit_of(channel), label=error_label(channel), errors=True, wraps=channel in ATTITUDE,
            from_s=start if start > 0 and self.report.seed is not None else None,
        )  # fmt: skip
        limits: dict[bytes, tuple[int, Array]] = {}
        for place, r in results:
            if channel in r.sigma:
                panel.marks.append(Band(place, 3.0 * r.sigma[channel]))
            if channel in r.limit_sigma:
                limits.setdefault(r.limit_sigma[channel].tobytes(), (place, r.limit_sigma[channel]))
            panel.marks.append(Curve(place, r.errors[channel]))
        for place, limit in limits.values():
            panel.marks.append(Curve(TRUTH_GROUP if len(limits) == 1 else place, limit, "limit"))
        return panel

    def motion(self) -> Iterator[Section]:
        """Track, height and test ratios of fixes; attitude; velocity."""
        yield Section("Track and fixes", [*self.track(), *self.test_ratios()], columns=2)
        yield Section("Attitude", self.angles())
        speeds = [(i, r, r.outputs["velocity_n"]) for i, r in self._with("velocity_n")]
        true = _known(self.report.truth.velocity_n)
        yield Section("Velocity", [self._motion(n, i, true, speeds) for i, n in enumerate(VELOCITY)] if speeds else [])

    def angles(self) -> list[TimePanel]:
        """Roll, pitch and heading, estimated and true."""
        true = None if _known(self.report.truth.q_nb) is None else self.report.truth.euler_deg()
        estimates = [(i, r, Track(r.time, r.outputs["q_nb"]).euler_deg()) for i, r in self._with("q_nb")]
        return [self._motion(name, i, true, estimates) for i, name in enumerate(ATTITUDE)]

    def _motion(self, channel: str, axis: int, true: Array | None, estimates: Sequence[Any]) -> TimePanel:
        """True and estimated motion; where there is no truth, with three stated standard deviations."""
        panel = self.panel(NAMES[channel], unit_of(channel), wraps=channel in ATTITUDE)
        lines = {} if true is None else {TRUTH_GROUP: true[:, axis]}
        lines |= {place: values[:, axis] for place, _, values in estimates}
        if panel.wraps:
            lines = in_a_turn(lines)
        for place, result, _ in estimates:
            sigma = (result.sigma or stated_sigma(result.outputs)).get(channel)
            if true is None and sigma is not None:
                panel.marks.append(Band(place, 3.0 * sigma, lines[place]))
        panel.marks += [Curve(place, values) for place, values in lines.items()]
        return panel

    def track(self) -> list[Panel]:
        """The track from above, and the height; none if no estimator has a track and the vehicle stays where it is."""
        truth = self.report.truth
        placed = [(i, track) for i, r in enumerate(self.report.results) if (track := track_of(r)) is not None]
        has_truth = _known(truth.latitude) is not None
        if not placed and not (has_truth and _extent(ground(truth, truth)) > TRAVELS_M):
            return []
        lines = [*([(TRUTH_GROUP, truth)] if has_truth else []), *placed]
        origin = lines[0][1]
        refused = [(i, np.flatnonzero(course(r.outputs)[1] > 0)) for i, r in enumerate(self.report.results) if has_fixes(r)]
        height = self.panel("Height above the start", "m")
        assert origin.height is not None
        start = float(origin.height[np.isfinite(origin.height)][0])
        height.marks += [Curve(i, track.height - start) for i, track in lines if track.height is not None]
        return [TrackPanel(height.x, [(i, *ground(track, origin)) for i, track in lines], refused), height]

    def test_ratios(self) -> list[TimePanel]:
        """Innovations of fixes over their stated sigmas; none without fixes."""
        panel = self.panel("Innovations over their stated sigmas, rms", "1", log=True, level=1.0)
        for place, r in enumerate(self.report.results):
            if not has_fixes(r):
                continue
            ratio, refused = course(r.outputs)
            used = np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)
            panel.marks.append(Curve(place, np.where(refused > 0, np.nan, used), "points"))
            if np.any(refused > 0):
                panel.marks.append(Curve(place, np.where(refused > 0, used, np.nan), "crosses"))
        return [panel] if panel.marks else []

    def biases(self) -> Section:
        """Biases of the unit as estimated, with three stated standard deviations."""
        panels = []
        for title, row, unit, factor in BIASES:
            for axis, name in enumerate(AXES):
                panel = self.panel(f"{title}, {name}", unit)
                for place, r in self._with(row):
                    values = factor * r.outputs[row][:, axis]
                    sigma = r.outputs.get(f"{row}_estimate_sigma")
                    if sigma is not None:
                        panel.marks.append(Band(place, 3.0 * factor * sigma[:, axis], values))
                    panel.marks.append(Curve(place, values))
                panels += [panel] if panel.marks else []
        return Section("Estimated biases", panels)

    def _with(self, row: str) -> list[tuple[int, Result]]:
        return [(i, r) for i, r in enumerate(self.report.results) if row in r.outputs]


def _known(values: Array | None) -> Array | None:
    return None if values is None or len(values) == 0 else values


def in_a_turn(lines: Mapping[int, Array]) -> dict[int, Array]:
    """Angles in degrees from -180 to 180, or from 0 to 360 where all of them together cover less there, as about 180."""
    full = {group: np.where(values < 0.0, values + 360.0, values) for group, values in lines.items()}
    return min((dict(lines), full), key=lambda each: _cover(each.values()))


def _cover(lines: Iterable[Array]) -> float:
    """From the smallest to the largest of all values."""
    values = np.concatenate([np.ravel(each) for each in lines] or [np.zeros(0)])
    values = values[np.isfinite(values)]
    return float(np.ptp(values)) if len(values) else 0.0


def _extent(east_north: tuple[Array, Array]) -> float:
    """The larger of the extents of a track, m."""
    return max(_cover([each]) for each in east_north)


def track_of(result: Result) -> Track | None:
    """The estimated positions; None without."""
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
