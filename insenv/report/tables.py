"""A report as a table for a terminal of 80 columns: every error beside its theoretical limit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from insenv.evaluation import CHANNELS, Report, Result

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

WIDTH = 80
_CHANNEL, _NUMBER, _GAP = 13, 8, 2
_NAMES = {
    **{f"{name}_deg": f"{name} [deg]" for name in ("roll", "pitch", "heading")},
    **{f"{name}_m": f"{name} [m]" for name in ("north", "east", "down")},
    **{f"{name}_mps": f"{name} [m/s]" for name in ("vn", "ve", "vd")},
}


def label(channel: str) -> str:
    """A channel as printed: ``heading [deg]``."""
    return _NAMES.get(channel, channel)


def number(value: float | None) -> str:
    """Three significant digits in at most 8 characters; a dash for what is not known."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 999_999.5:
        return f"{value:.1e}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def comparison(report: Report) -> Iterator[RenderableType]:
    """What is printed of a run, top to bottom: heading lines, one table for each estimator, notes.

    No line is longer than `WIDTH`, except that of a word that cannot be broken.
    """
    from rich.text import Text

    title = Text(report.scenario, "bold")
    if report.title and report.title != report.scenario:
        title.append(f": {report.title}", "not bold")
    yield title
    facts = [] if report.seed is None else [f"seed {report.seed}"]
    facts += [f"{report.duration_s:g} s", f"{report.imu_samples} inertial samples"]
    yield Text(", ".join(facts))
    for result in report.results:
        yield Text()
        yield from _of_result(result, report)
    yield Text()
    yield Text("final: at the end; rms, max: over the statistics' time; limit: theory's 1 sigma", "dim")
    for note in report.notes:
        yield Text(f"note: {note}")


def _of_result(result: Result, report: Report) -> Iterator[RenderableType]:
    from rich.text import Text

    line = Text(result.estimator, "bold")
    start = "whole run" if result.from_s <= 0 else f"{result.from_s:g} s on"
    line.append(f"   statistics: {start}   {number(result.us_per_sample)} us a sample", "not bold")
    yield line
    shown = [name for name in CHANNELS if name in result.errors]
    published = [(name, rms) for name, rms in report.published if any(channel in rms for channel in shown)]
    room = (WIDTH - _CHANNEL - 5 * (_NUMBER + _GAP)) // (_NUMBER + _GAP)
    numbers = [""] if len(published) == 1 else [f" {place + 1}" for place in range(len(published))]
    headings = [f"published{number}" for number in numbers]
    table = _table("error", "final", "rms", "max", "limit", "rms/limit", *headings[:room])
    statistics = result.statistics()
    for name in shown:
        final, rms, largest = (statistics[kind][name] for kind in ("final", "rms", "max"))
        limit = result.limit.get(name)
        ratio = rms / limit if limit else None
        table.add_row(
            label(name),
            number(final),
            Text(number(rms), "bold"),
            number(largest),
            number(limit),
            Text(number(ratio), "yellow" if ratio is not None and ratio > 3 else ""),
            *(number(figures.get(name)) for _, figures in published[:room]),
        )
    yield table if shown else Text("no reference to compare with")
    for place, (heading, (name, figures)) in enumerate(zip(headings, published, strict=False)):
        listed = [f"{label(channel)} {number(figures[channel])}" for channel in shown if channel in figures]
        yield Text(f"{heading}: rms of {name}" + (f": {', '.join(listed)}" if place >= room else ""))
    for note in result.notes:
        yield Text(f"note: {note}")


def _table(first: str, *columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, _GAP, 0, 0))
    table.add_column(first, no_wrap=True, min_width=_CHANNEL)
    for name in columns:
        table.add_column(name, justify="right", min_width=_NUMBER - 1, max_width=_NUMBER + 1, overflow="fold")
    return table
