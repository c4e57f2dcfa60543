"""A report as tables for a terminal of 80 columns: every error with its theoretical limit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from insenv.evaluation.errors import ATTITUDE, CHANNELS, VELOCITY, Result, Track
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.evaluation.limits import ratio_bounds
from insenv.report.run_data import RunData

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


WIDTH = 80
_CHANNEL, _NUMBER, _GAP = 13, 8, 2
_NAMES = {
    **{f"{name}_deg": f"{name} [deg]" for name in ("roll", "pitch", "heading", "latitude", "longitude")},
    **{f"{name}_m": f"{name} [m]" for name in ("north", "east", "down", "height")},
    **{f"{name}_mps": f"{name} [m/s]" for name in ("vn", "ve", "vd")},
}


def label(channel: str) -> str:
    """A channel as printed: ``heading [deg]``."""
    return _NAMES.get(channel, channel)


def number(value: float | None) -> str:
    """Three significant digits in at most 8 characters; a dash for an unknown value."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 999_999.5:
        return f"{value:.1e}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def comparison(report: RunData) -> Iterator[RenderableType]:
    """The printed lines and tables of a run, top to bottom: heading, one table per estimator, notes.

    No line is longer than `WIDTH`, unless a single word is.
    """
    from rich.text import Text

    title = Text(report.scenario, "bold")
    if report.title and report.title != report.scenario:
        title.append(f": {report.title}", "not bold")
    yield title
    yield Text(", ".join(facts(report)))
    for result in report.results:
        yield Text()
        yield from _of_result(result, report)
    yield Text()
    if any(result.errors for result in report.results):
        kinds = [error_columns(result)[4:5] for result in report.results if result.errors]
        meanings = {"limit": "limit: theory's 1 sigma", "stated": "stated: its own 1 sigma"}
        told = "".join(f"; {meaning}" for kind, meaning in meanings.items() if (kind,) in kinds)
        yield Text(f"final: at the end; rms, max: over the statistics' time{told}", "dim")
        if ("limit",) in kinds:
            yield Text(within(1), "dim")
    for note in report.notes:
        yield Text(f"note: {note}")


def facts(report: RunData) -> list[str]:
    """Seed (of a simulation), duration and number of samples."""
    seed = [] if report.seed is None else [f"seed {report.seed}"]
    return [*seed, f"{report.duration_s:g} s", f"{report.imu_samples} inertial samples"]


def within(runs: int) -> str:
    """The sentence on how far rms/limit varies by chance over so many runs."""
    low, high = ratio_bounds(runs)
    return f"rms/limit of an optimal estimator over {runs} run{'s' if runs > 1 else ''}: {low:.2f} to {high:.2f} (95 %)"


ESTIMATE_COLUMNS = ("no reference", "at the end", "stated sigma")


def error_columns(result: Result) -> tuple[str, ...]:
    """Names of the columns: errors, and the limit, or else the estimator's own sigma, with the ratio to it."""
    kind = "limit" if result.limit else "stated" if result.stated() else ""
    return ("error", "final", "rms", "max", *((kind, f"rms/{kind}") if kind else ()))


def error_rows(result: Result) -> list[tuple[str, list[float | None]]]:
    """By error, its label and the values of `error_columns`; no ratio for a run that is too short for the estimator."""
    statistics, rows = result.statistics(), []
    yardstick = result.limit or result.stated()
    for name in (name for name in CHANNELS if name in result.errors):
        final, rms, largest = (statistics[kind][name] for kind in ("final", "rms", "max"))
        own = yardstick.get(name)
        ratio = None if not own or not result.settled else limit_ratio(rms, own, name) if result.limit else rms / own
        rows.append((label(name), [final, rms, largest, *([own, ratio] if yardstick else [])]))
    return rows


def _of_result(result: Result, report: RunData) -> Iterator[RenderableType]:
    from rich.text import Text

    line = Text(result.estimator, "bold")
    shown = [name for name in CHANNELS if name in result.errors]
    start = "over the whole run" if result.from_s <= 0 else f"from {result.from_s:g} s on"
    statistics_of = f"statistics {start}, " if shown else ""
    line.append(f"   {statistics_of}{number(result.us_per_sample)} us a sample", "not bold")
    yield line
    published = [(name, rms) for name, rms in report.published if any(channel in rms for channel in shown)]
    if shown:
        columns = error_columns(result)
        table = _table(*columns, *["published"][: len(published)])
        for channel, (text, values) in zip(shown, error_rows(result), strict=True):
            cells = [Text(number(value)) for value in values]
            cells[1].stylize("bold")
            if len(values) > 3 and (ratio := values[-1]) is not None and ratio > 3:
                cells[-1].stylize("yellow")
            table.add_row(
                text,
                *cells,
                *(number(figures.get(channel)) for _, figures in published[:1]),
            )
    else:
        table = _table(*ESTIMATE_COLUMNS)
        for row in estimate_rows(result):
            table.add_row(*row)
    yield table
    for place, (name, figures) in enumerate(published):  # only one further column fits
        listed = [f"{label(channel)} {number(figures[channel])}" for channel in shown if channel in figures]
        yield Text(f"rms of {name}: {', '.join(listed)}" if place else f"published: rms of {name}")
    if result.health is not None:
        healthy = result.health.verdict == "consistent"
        for place, told in enumerate(result.health.lines):
            yield Text(f"{'  ' if place else 'health: '}{told}", "" if healthy else "yellow")
    for note in result.notes:
        yield Text(f"note: {note}")


def estimate_rows(result: Result) -> list[tuple[str, str, str]]:
    """Without a reference: label, estimate at the end and the standard deviation that the estimator states."""
    last = {name: value[-1:] for name, value in result.outputs.items()} if len(result.time) else {}
    found: dict[str, str] = {}
    if "q_nb" in last:
        angles = Track(result.time[-1:], last["q_nb"]).euler_deg()[0]
        found |= {name: f"{angle:.4f}" for name, angle in zip(ATTITUDE, angles, strict=True)}
    found |= {f"{n}_deg": f"{math.degrees(last[n][0]):.7f}" for n in ("latitude", "longitude") if n in last}
    found |= {"height_m": f"{last['height'][0]:.3f}"} if "height" in last else {}
    if "velocity_n" in last:
        found |= {name: f"{speed:.4f}" for name, speed in zip(VELOCITY, last["velocity_n"][0], strict=True)}
    rows = []
    sigmas = {"latitude_deg": "north_m", "longitude_deg": "east_m", "height_m": "down_m"}
    for name, text in found.items():
        channel = sigmas.get(name, name)
        stated = number(result.sigma[channel][-1]) if channel in result.sigma else "-"
        rows.append((label(name), text, f"{stated} m" if channel != name else stated))
    return rows


def _table(first: str, *columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, _GAP, 0, 0))
    table.add_column(first, no_wrap=True, min_width=_CHANNEL)
    for name in columns:
        table.add_column(name, justify="right", min_width=_NUMBER - 1, no_wrap=True)
    return table
