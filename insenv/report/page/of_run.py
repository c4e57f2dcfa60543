"""The page of a run or replay: what its tables, figure and JSON document show, as one document for the front end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from insenv.base.output import to_json
from insenv.base.version import __version__
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, VELOCITY, Result, Track, stated_sigma
from insenv.evaluation.health import course
from insenv.report import tracks
from insenv.report.page.html import assembled
from insenv.report.page.panels import BYTES, TRUTH_GROUP, Array, Pool, TimePanel, kept_records, section, table, track_panel
from insenv.report.run_data import RunData, has_fixes, without_fixes
from insenv.report.scales import threshold_of
from insenv.report.tables import (
    ESTIMATE_COLUMNS,
    error_columns,
    error_rows,
    estimate_rows,
    facts,
    number,
    unit_columns,
    unit_rows,
    within,
)
from insenv.sensors import units

NAMES = {
    "roll_deg": "Roll", "pitch_deg": "Pitch", "heading_deg": "Heading", "north_m": "North", "east_m": "East", "down_m": "Down",
    "vn_mps": "Velocity north", "ve_mps": "Velocity east", "vd_mps": "Velocity down",
}  # fmt: skip
EXPLAINED = {
    "rms": "final: at the end; rms, max: over the time of the statistics.",
    "limit": "limit: the smallest standard deviation that any method can have.",
    "stated": "stated: the standard deviation that the estimator itself states.",
}
"""What columns of a table of errors mean."""
UNITS = {"deg": "deg", "m": "m", "mps": "m/s"}
AXES = ("forward", "right", "down")
MARKED = 3.0
"""Ratio of an rms error to its yardstick from which a cell is marked."""
BIASES = (
    ("Gyro bias", "gyro_bias", "deg/h", float(units.rad_s_to_deg_h(1.0))),
    ("Accelerometer bias", "accel_bias", "ug", float(units.m_s2_to_ug(1.0))),
)
"""Title, output row, unit of the page and factor from SI; the standard deviation is in the row NAME_estimate_sigma."""


def run_page(report: RunData, more: Mapping[str, Any] | None = None) -> str:
    """The HTML of a run or replay. more: further documents by kind, such as "live"."""
    more = more or {}
    taken = sum(len(to_json(document, indent=None)) for document in more.values())
    return assembled(f"{report.scenario}: {report.title}", {"report": run_document(report, BYTES - taken), **more})


def unit_of(channel: str) -> str:
    """The unit of a channel of errors."""
    return UNITS[channel.rpartition("_")[2]]


def run_document(report: RunData, budget: int = BYTES) -> dict[str, Any]:
    """The document of a run (web/README.md); its arrays take about `budget` bytes at most."""
    drawn = _Drawn(report, budget)
    sections = [one for one in (*drawn.error_sections(), *drawn.motion_sections(), *drawn.filter_sections()) if one["panels"]]
    kept = len(drawn.keep)
    records = max((len(r.time) for r in report.results), default=0)
    thinned = [f"The page shows {kept} of {records} records; the .npz file holds all."] if kept < records else []
    return {
        "kind": "report",
        "version": __version__,
        "name": report.scenario,
        "title": report.title,
        "facts": facts(report),
        "truth": "truth" if report.seed is not None else "reference",
        "legend": [{"name": r.estimator} for r in report.results],
        "tables": [one for place, result in enumerate(report.results) for one in _tables(result, place, report)],
        "explained": _explained(report),
        "notes": [*report.notes, *thinned],
        "sections": sections,
        "arrays": drawn.pool.as_json(),
    }


def _tables(result: Result, place: int, report: RunData) -> Iterator[dict[str, Any]]:
    """The tables of one estimator: its errors and, of a calibration, those of the unit."""
    yield _summary(result, place, report)
    if result.unit:
        yield table(result.estimator, unit_columns(result), unit_rows(result), group=place)


def _summary(result: Result, place: int, report: RunData) -> dict[str, Any]:
    """The table of one estimator with what must be said of it."""
    below = []
    if result.health is not None:
        first, *others = result.health.lines
        below = [f"Health: {first}", *others]
    below += [*result.notes, *([f"{number(result.us_per_sample)} us a sample"] if result.us_per_sample else [])]
    state = "" if result.health is None else result.health.verdict
    if not result.errors:
        return table(result.estimator, ESTIMATE_COLUMNS, estimate_rows(result), group=place, below=below, state=state)
    rows = error_rows(result)
    shown = [name for name in CHANNELS if name in result.errors]
    published = [(name, rms) for name, rms in report.published if any(channel in rms for channel in shown)]
    cells = [
        (text, *map(number, values.values()), *(number(rms.get(channel)) for _, rms in published))
        for channel, (text, values) in zip(shown, rows, strict=True)
    ]
    ratio = error_columns(result)[-1]
    above = [(k, len(values)) for k, (_, values) in enumerate(rows) if (values.get(ratio) or 0.0) > MARKED and "/" in ratio]
    start = "" if result.from_s <= 0 else f"Statistics from {result.from_s:g} s on"
    columns = (*error_columns(result), *(f"rms of {name}" for name, _ in published))
    below = [*([start] if start else []), *below]
    return table(result.estimator, columns, cells, group=place, below=below, warnings=above, state=state)


def _explained(report: RunData) -> list[str]:
    """What the columns of the tables mean."""
    if not any(result.errors for result in report.results):
        return []
    columns = {name for result in report.results for name in error_columns(result)}
    told = [EXPLAINED[name] for name in ("rms", "limit", "stated") if name in columns]
    return [*told, *([f"{within(1)}."] if "limit" in columns else [])]


class _Drawn:
    """The sections of a page from one report, with arrays of the records that it keeps."""

    def __init__(self, report: RunData, budget: int) -> None:
        self.report, self.pool = report, Pool()
        records = max((len(r.time) for r in report.results), default=0)
        self.keep = kept_records(records, sum(_arrays(r) for r in report.results) + 21, budget)
        self.times = report.results[0].time[self.keep] if records else np.zeros(0)
        self.shade = without_fixes(report.results)

    def panel(self, title: str, unit: str, **more: Any) -> TimePanel:
        return TimePanel(self.pool, title, unit, self.times, shade=self.shade, **more)

    # --- errors

    def error_sections(self) -> Iterator[dict[str, Any]]:
        for title, group in (("Attitude error", ATTITUDE), ("Position error", POSITION), ("Velocity error", VELOCITY)):
            shown = [name for name in group if any(name in r.errors for r in self.report.results)]
            yield section(title, [self._errors(name) for name in shown])

    def _errors(self, channel: str) -> dict[str, Any]:
        results = [(place, r) for place, r in enumerate(self.report.results) if channel in r.errors]
        drawn, reach = [r.errors[channel] for _, r in results], [_reach(r, channel) for _, r in results]
        start = min(r.from_s for _, r in results)
        panel = self.panel(
            NAMES[channel], unit_of(channel), threshold=threshold_of(drawn, reach), wraps=channel in ATTITUDE,
            from_s=start if start > 0 and self.report.seed is not None else None,
        )  # fmt: skip
        limits: dict[bytes, tuple[int, Array]] = {}
        for place, r in results:
            if channel in r.sigma:
                panel.around(place, 3.0 * r.sigma[channel][self.keep])
            if channel in r.limit_sigma:
                limits.setdefault(r.limit_sigma[channel].tobytes(), (place, r.limit_sigma[channel]))
            panel.curve(place, r.errors[channel][self.keep])
        for place, limit in limits.values():
            panel.curve(TRUTH_GROUP if len(limits) == 1 else place, limit[self.keep], "limit")
        return panel.as_json()

    # --- motion

    def motion_sections(self) -> Iterator[dict[str, Any]]:
        yield section("Track and fixes", [*self._track(), *self._test_ratios()], columns=2)
        truth = self.report.truth
        angles = self._kept(None if truth.q_nb is None else truth.euler_deg())
        estimates = [(i, r, Track(r.time, r.outputs["q_nb"]).euler_deg()) for i, r in self._with("q_nb")]
        yield section("Attitude", [self._motion(name, i, angles, estimates, True) for i, name in enumerate(ATTITUDE)])
        speeds = [(i, r, r.outputs["velocity_n"]) for i, r in self._with("velocity_n")]
        true = self._kept(truth.velocity_n)
        yield section(
            "Velocity", [self._motion(name, i, true, speeds, False) for i, name in enumerate(VELOCITY)] if speeds else []
        )

    def _motion(self, channel: str, axis: int, true: Array | None, estimates: Sequence[Any], wraps: bool) -> dict[str, Any]:
        """True and estimated motion; where there is no truth, with three stated standard deviations."""
        panel = self.panel(NAMES[channel], unit_of(channel), wraps=wraps)
        lines = {} if true is None else {TRUTH_GROUP: true[:, axis]}
        lines |= {place: values[self.keep, axis] for place, _, values in estimates}
        if wraps:
            lines = in_a_turn(lines)
        for place, result, _ in estimates:
            sigma = (result.sigma or stated_sigma(result.outputs)).get(channel)
            if true is None and sigma is not None:
                panel.around(place, 3.0 * sigma[self.keep], lines[place])
        for place, values in lines.items():
            panel.curve(place, values)
        return panel.as_json()

    def _track(self) -> list[dict[str, Any]]:
        truth = self.report.truth
        found = [(i, tracks.track_of(r)) for i, r in enumerate(self.report.results)]
        placed = [(i, track) for i, track in found if track is not None]
        has_truth = truth.latitude is not None and len(truth.time) > 0
        if not placed and not (has_truth and _travels(truth)):
            return []
        origin = truth if has_truth else placed[0][1]
        lines = [(TRUTH_GROUP, truth)] if has_truth else []
        shown = [(i, *tracks.ground(_only(track, self.keep), origin)) for i, track in [*lines, *placed]]
        marks = []
        for i, r in enumerate(self.report.results):
            if has_fixes(r):
                refused = course({name: values[self.keep] for name, values in r.outputs.items()})[1]
                marks.append((i, np.flatnonzero(refused > 0)))
        panels = [track_panel(self.pool, self.times, shown, marks)]
        start = next(float(h[np.isfinite(h)][0]) for h in (origin.height,) if h is not None)
        height = self.panel("Height above the start", "m")
        for i, track in [*lines, *placed]:
            if track.height is not None:
                height.curve(i, track.height[self.keep] - start)
        return [*panels, height.as_json()]

    # --- what filters tell of themselves

    def filter_sections(self) -> Iterator[dict[str, Any]]:
        biases = []
        for title, row, unit, factor in BIASES:
            for axis, name in enumerate(AXES):
                panel = self.panel(f"{title}, {name}", unit)
                for place, r in self._with(row):
                    values = factor * r.outputs[row][self.keep, axis]
                    sigma = r.outputs.get(f"{row}_estimate_sigma")
                    if sigma is not None:
                        panel.around(place, 3.0 * factor * sigma[self.keep, axis], values)
                    panel.curve(place, values)
                biases += [panel.as_json()] if panel.curves else []
        yield section("Estimated biases", biases)

    def _test_ratios(self) -> list[dict[str, Any]]:
        panel = self.panel("Innovations over their stated sigmas, rms", "1", log=True)
        for place, r in enumerate(self.report.results):
            if not has_fixes(r):
                continue
            ratio, refused = course(
                {name: values[self.keep] for name, values in r.outputs.items() if len(values) == len(r.time)}
            )
            used = np.where(np.isfinite(ratio) & (ratio > 0), ratio, np.nan)
            panel.curve(place, np.where(refused > 0, np.nan, used), "points")
            if np.any(refused > 0):
                panel.curve(place, np.where(refused > 0, used, np.nan), "crosses")
        return [panel.as_json()] if panel.curves else []

    def _with(self, row: str) -> list[tuple[int, Result]]:
        return [(i, r) for i, r in enumerate(self.report.results) if row in r.outputs]

    def _kept(self, values: Array | None) -> Array | None:
        return None if values is None or len(values) == 0 else values[self.keep]


def in_a_turn(lines: Mapping[int, Array]) -> dict[int, Array]:
    """Angles in degrees from -180 to 180, or from 0 to 360 where all of them together cover less there, as about 180."""
    full = {group: np.where(values < 0.0, values + 360.0, values) for group, values in lines.items()}
    return min((dict(lines), full), key=_cover)


def _cover(lines: Mapping[int, Array]) -> float:
    """From the smallest to the largest of all values."""
    found = np.concatenate([np.ravel(values) for values in lines.values()] or [np.zeros(0)])
    found = found[np.isfinite(found)]
    return float(np.ptp(found)) if len(found) else 0.0


def _arrays(result: Result) -> int:
    """The number of arrays that an estimator adds to a page."""
    rows = [name for _, row, *_ in BIASES for name in (row, f"{row}_estimate_sigma") if name in result.outputs]
    return len(result.errors) + len(result.sigma) + 3 * len(rows) + 11


def _reach(result: Result, channel: str) -> float:
    """The extent of an estimator's stated accuracy and limit, which its panel of errors shows."""
    limit, sigma = result.limit_sigma.get(channel), result.sigma.get(channel)
    reach = 0.0 if sigma is None or len(sigma) == 0 else 3.0 * float(np.median(sigma))
    return reach if limit is None else max(reach, float(np.max(limit[-max(1, len(limit) // 4) :])))


def _travels(truth: Track) -> bool:
    """Whether a vehicle leaves the place where it starts, by more than a ship sways."""
    east, north = tracks.ground(truth, truth)
    return max(float(np.ptp(east)), float(np.ptp(north))) > 20.0


def _only(track: Track, keep: Any) -> Track:
    assert track.latitude is not None and track.longitude is not None
    return Track(track.time[keep], latitude=track.latitude[keep], longitude=track.longitude[keep])
