"""Small pictures of scenarios and estimators for their pages: the track (or the sway), and the error of an estimator beside its
stated sigma and the limit.  ``python tools/thumbnails.py [NAME ...]`` writes them into docs/figures/thumbnails/.  They are
drawn in colours that are legible on a light and on a dark page, and without a background.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np
from pages import ROOT

import insenv
from insenv.evaluation.errors import ATTITUDE
from insenv.report.of_run import NAMES
from insenv.report.tables import number, unit_of
from insenv.scenario import load, summaries

FOLDER = ROOT / "docs" / "figures" / "thumbnails"
ESTIMATOR = "estimator-"
LONGEST = 1800.0  # s of a scenario that is run for its picture
POINTS = 100  # of a curve
MOVES = 5.0  # m: a smaller track is that of a vehicle in place, whose roll and pitch are shown
SWAY = 60.0  # s of them
TRACK, ERROR = (8, 24, 150, 118), (214, 24, 300, 118)
"""Left, top, width and height of both plots, px."""
EXAMPLE = re.compile(r"^\$ insenv run ([\w-]+)(?: -e ([\w-]+))?.*?(?: --duration (\d+))?$", re.MULTILINE)
STYLE = (
    "text{font:14px system-ui,sans-serif;fill:#7d8893}path{fill:none;stroke-width:1.2;stroke-linejoin:round}"
    ".truth{stroke:#9aa3ad;stroke-width:3}.own{stroke:#2a8bc8}.other{stroke:#d9692b}"
    ".band{fill:#2a8bc8;fill-opacity:.18}.limit{stroke:#8d959d;stroke-dasharray:4 2}.zero{stroke:#8884}"
    ".outage{fill:#d95f3b;fill-opacity:.15}"
)


@cache
def runs() -> dict[str, tuple[str, str | None, float]]:
    """By name of a picture the scenario, the estimator (None: its first) and the duration (s) of its run."""
    found: dict[str, tuple[str, str | None, float]] = {
        entry["name"]: (entry["name"], None, min(entry["duration_s"], LONGEST)) for entry in summaries()
    }
    for page in sorted((ROOT / "docs" / "estimators").glob("*.md")):
        if example := EXAMPLE.search(page.read_text(encoding="utf-8")):
            scenario, id, duration = example.groups()
            found[f"{ESTIMATOR}{page.stem}"] = (scenario, id, float(duration or min(load(scenario).duration_s, LONGEST)))
    return found


def of_estimators() -> list[str]:
    """The names of the pictures of estimators."""
    return [name for name in runs() if name.startswith(ESTIMATOR)]


def shown(name: str, folder: str) -> str:
    """The picture of a page in Markdown; folder: the way from there to docs/."""
    scenario, estimator, _ = runs()[name]
    run = f"{estimator or load(scenario).estimators[0]} on {scenario}"
    what = f"{run}: track or sway, and the error with three stated sigmas and the limit"
    return f"![{what}]({folder}/figures/thumbnails/{name}.svg)"


def picture(name: str, scenario: str, estimator: str | None, duration_s: float) -> str:
    """The SVG of a run."""
    loaded = load(scenario)
    report = insenv.run(scenario, estimator or loaded.estimators[0], duration_s=duration_s)
    gnss = loaded.sensors.get("gnss")
    parts = [*track(report), *error(report, getattr(gnss, "outages_s", ()) or ())]
    title = escape(f"{name}: {report.results[0].estimator} on {scenario}")
    size = 'viewBox="0 0 520 150" width="520" height="150"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img"><title>{title}</title><style>{STYLE}</style>'
        f"{''.join(parts)}</svg>\n"
    )


def track(report: Any) -> list[str]:
    """The track seen from above with the estimate, or roll and pitch of a vehicle in place."""
    truth, outputs = report.truth, report.results[0].outputs
    east, north = ground(truth.latitude, truth.longitude, truth) if truth.latitude is not None else np.zeros((2, 2))
    extent = float(max(np.ptp(east), np.ptp(north)))
    if extent < MOVES:
        some = truth.time <= truth.time[0] + SWAY
        roll, pitch = truth.euler_deg()[some, 0], truth.euler_deg()[some, 1]
        largest = max(1.0, np.abs([roll, pitch]).max())
        time = scaled(truth.time[some], truth.time[some][0], truth.time[some][-1], TRACK[0], TRACK[2])
        return [
            text(TRACK, f"roll, pitch: 1 min, ±{largest:.2g}°"),
            *(curve(time, vertical(angle, largest, TRACK), kind) for angle, kind in ((roll, "own"), (pitch, "other"))),
        ]
    size = extent / 1000 if extent >= 1000 else extent
    left, top, width, height = TRACK
    scale = min(width, height) / extent
    centre = (np.min(east) + np.max(east)) / 2, (np.min(north) + np.max(north)) / 2

    def drawn(places: Any, kind: str) -> str:
        east, north = places
        return curve(left + width / 2 + scale * (east - centre[0]), top + height / 2 - scale * (north - centre[1]), kind)

    shown = [text(TRACK, f"track, {number(size)} {'km' if extent >= 1000 else 'm'} across"), drawn((east, north), "truth")]
    if "latitude" in outputs:
        shown.append(drawn(ground(outputs["latitude"], outputs["longitude"], truth), "own"))
    return [
        shown[0],
        f'<svg x="0" y="{top}" width="170" height="{height}" viewBox="0 {top} 170 {height}">',
        *shown[1:],
        "</svg>",
    ]


def ground(latitude: Any, longitude: Any, truth: Any) -> Any:
    """East and north of the start, m, on a sphere."""
    start = truth.latitude[0], truth.longitude[0]
    return 6.371e6 * np.stack([np.cos(start[0]) * (longitude - start[1]), latitude - start[0]])


def error(report: Any, outages: Sequence[Sequence[float]]) -> list[str]:
    """The heading error (or the first that there is) over time, with three stated sigmas and the limit; about zero the scale is
    linear, beyond it logarithmic.
    """
    result, left, top, width, height = report.results[0], *ERROR
    channel = "heading_deg" if "heading_deg" in result.errors else next(iter(result.errors))
    values, time = result.errors[channel], result.time
    sigma, limit = (kind.get(channel) for kind in (result.sigma, result.limit_sigma))
    late = time >= 0.75 * time[-1]
    settled = 2 * float(np.median(limit[late]) if limit is not None else np.sqrt(np.mean(values[late] ** 2)))
    bent = {"own": values, "limit": limit, "band": None if sigma is None else 3 * sigma}
    bent = {kind: np.arcsinh(series / settled) for kind, series in bent.items() if series is not None}
    ends = [np.abs(bent["own"]).max(), *(np.median(bent[kind]) for kind in ("band", "limit") if kind in bent)]
    most = min(float(max(ends)), np.arcsinh(180.0 / settled) if channel in ATTITUDE else np.inf)
    x = scaled(time, 0.0, time[-1], left, width)
    unit = unit_of(channel)
    largest = float(settled * np.sinh(most))
    shown = [text(ERROR, f"{NAMES[channel].lower()} error, ±{number(largest)} {unit}, {time[-1] / 60:.2g} min")]
    for begin, end in outages:
        edges = scaled(np.array([begin, min(end, time[-1])]), 0.0, time[-1], left, width)
        if begin < time[-1]:
            shown.append(
                f'<rect class="outage" x="{edges[0]:.0f}" y="{top}" width="{edges[1] - edges[0]:.0f}" height="{height}"/>'
            )
    shown.append(curve(np.array([left, left + width]), np.full(2, top + height / 2), "zero"))
    if "band" in bent:
        upper, lower = (vertical(sign * np.minimum(bent["band"], most), most, ERROR) for sign in (1, -1))
        shown.append(curve(np.concatenate([x, x[::-1]]), np.concatenate([upper, lower[::-1]]), "band", 2 * POINTS))
    if "limit" in bent:
        shown += [curve(x, vertical(sign * np.minimum(bent["limit"], most), most, ERROR), "limit") for sign in (1, -1)]
    return [*shown, curve(x, vertical(bent["own"], most, ERROR), "own")]


def scaled(values: Any, low: float, high: float, start: float, length: float) -> Any:
    """Values from low to high as places of a plot, px."""
    return start + length * (values - low) / (high - low)


def vertical(values: Any, most: float, box: tuple[int, int, int, int]) -> Any:
    """Values of -most to most as heights of a plot, px."""
    return scaled(-values, -most, most, box[1], box[3])


def curve(x: Any, y: Any, kind: str, points: int = POINTS) -> str:
    """A path through some of the points."""
    some = np.unique(np.linspace(0, len(x) - 1, points).astype(int))
    places = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[some], y[some], strict=True))
    return f'<path class="{kind}" d="M{places}"/>'


def text(box: tuple[int, int, int, int], words: str) -> str:
    """The caption of a plot."""
    return f'<text x="{box[0]}" y="{box[1] - 9}">{escape(words)}</text>'


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    wanted = sys.argv[1:]
    for name, run in runs().items():
        if not wanted or name in wanted:
            (FOLDER / f"{name}.svg").write_text(picture(name, *run), encoding="utf-8", newline="\n")
            print(name)
