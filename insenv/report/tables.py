"""A report as tables for a terminal of 80 columns: every error with its theoretical limit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from math import isfinite
from typing import Any

from insenv.base.remarks import clock
from insenv.evaluation.errors import ATTITUDE, CHANNELS, VELOCITY, Result, Track
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.evaluation.limits import ratio_bounds
from insenv.evaluation.outages import BEYOND, SHOWN, Outages
from insenv.evaluation.specific_force import SpecificForce
from insenv.report.document import Block, Line, Sentences, Style, Table
from insenv.report.run_data import RunData

MARKED = 3.0
"""Ratio of an rms error to its yardstick from which a cell is marked."""
SEEDS = 10
"""Largest number of seeds that are printed; the files hold all."""
UNITS = {"deg": "deg", "m": "m", "mps": "m/s"}
"""Units by the end of the name of a channel."""


def unit_of(channel: str) -> str:
    """The unit of a channel: ``m/s``."""
    return UNITS[channel.rpartition("_")[2]]


def label(channel: str) -> str:
    """A channel as printed: ``heading [deg]``."""
    quantity, _, end = channel.rpartition("_")
    return f"{quantity} [{UNITS[end]}]" if end in UNITS else channel


def error_label(channel: str) -> str:
    """A channel's error as printed: ``heading error [deg]``."""
    return label(channel).replace(" [", " error [")


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


def run_blocks(report: RunData) -> Iterator[Block]:
    """The printed lines and tables of a run, top to bottom: heading, one table per estimator, notes; its page has the tables.

    No line is longer than `WIDTH`, unless a single word is.
    """
    named = report.title and report.title != report.scenario
    yield Line(report.scenario, "bold", f": {report.title}" if named else "")
    yield Line(", ".join(facts(report)))
    for place, result in enumerate(report.results):
        yield Line()
        yield from _of_result(result, place, report)
    yield Line()
    if any(result.errors for result in report.results):
        shown = {name for result in report.results if result.errors for name in error_columns(result)}
        yield Line("final: at the end; other columns: over the time of the statistics", "dim")
        meanings = {"stated": "stated: the estimator's own 1 sigma", "limit": "limit: theory's 1 sigma"}
        if explained := [meaning for name, meaning in meanings.items() if name in shown]:
            yield Line("; ".join(explained), "dim")
        if "limit" in shown:
            yield Line(within(1), "dim")
    yield Sentences("notes", report.notes, head="note: ")


def facts(report: RunData) -> list[str]:
    """Seed (of a simulation), duration and number of samples."""
    seed = [] if report.seed is None else [f"seed {report.seed}"]
    return [*seed, f"{report.duration_s:g} s", f"{report.imu_samples} inertial samples"]


def ratio_cell(ratio: float | None) -> Line:
    """A ratio of an error to its yardstick, in yellow above `MARKED`."""
    return Line(number(ratio), "yellow" if ratio is not None and ratio > MARKED else "")


def runs_of(count: int) -> str:
    """A number of runs in words."""
    return f"{count} run{'s' if count > 1 else ''}"


def seed_list(seeds: Sequence[int]) -> str:
    """Seeds by number, the first `SEEDS` of them."""
    return f"seed {', '.join(map(str, seeds[:SEEDS]))}{', ...' if len(seeds) > SEEDS else ''}"


def seeds_of(first: int, last: int) -> str:
    """Consecutive seeds in words."""
    return f"seeds {first} to {last}" if last > first else f"seed {first}"


def left_out(seeds: Sequence[int], runs: int, what: str = "diverged and are left out") -> list[str]:
    """The sentence on some of `runs` runs, by their seeds; none without any."""
    return [f"{len(seeds)} of {runs} runs {what}: {seed_list(seeds)}"] if seeds else []


def within(runs: int) -> str:
    """The sentence on how far rms/limit varies by chance over so many runs."""
    low, high = ratio_bounds(runs)
    return f"rms/limit of an optimal estimator over {runs_of(runs)}: {low:.2f} to {high:.2f} (95 %)"


def since(from_s: float) -> str:
    """The time of the statistics of several runs, in words."""
    return "over the whole runs" if from_s <= 0 else f"from {clock(from_s)} s on"


ESTIMATE_COLUMNS = ("no reference", "at the end", "stated sigma")


def error_columns(result: Result) -> tuple[str, ...]:
    """Names of the columns: see `columns_of`."""
    return columns_of(bool(result.stated()), bool(result.limit))


def columns_of(stated: bool, limit: bool) -> tuple[str, ...]:
    """Names of the columns: errors, the estimator's own sigma, the limit, and the ratio to the limit, or else to that sigma.

    stated, limit: whether there is such a sigma, and a limit.
    """
    yardsticks = [kind for kind, there in (("stated", stated), ("limit", limit)) if there]
    return ("error", "final", "rms", "max", *yardsticks, *(f"rms/{kind}" for kind in yardsticks[-1:]))


def error_rows(result: Result) -> list[tuple[str, dict[str, float | None]]]:
    """By error, its label and the values by column; no ratio of what is not judged, as a run too short for the estimator."""
    kinds, rows = {**result.statistics(), "stated": result.stated(), "limit": result.limit}, []
    _, *columns = error_columns(result)
    for name in (name for name in CHANNELS if name in result.errors):
        values = {column: kinds[column].get(name) for column in columns if column in kinds}
        if columns[-1].startswith("rms/"):
            error, reference = kinds["rms"][name], values[columns[-2]]
            known = reference if result.settled and name not in result.unjudged else None
            values[columns[-1]] = None if not known else limit_ratio(error, known, name) if result.limit else error / known
        rows.append((label(name), values))
    return rows


UNIT_COLUMNS = ("error of the unit at the end", "estimate", "stated", "true", "error")
"""Columns of the errors of the inertial unit that a calibration finds; the last two where the truth is known."""


def unit_columns(result: Result) -> tuple[str, ...]:
    """Those of `UNIT_COLUMNS` that a result has."""
    return UNIT_COLUMNS if any(one.true is not None for one in result.unit) else UNIT_COLUMNS[:3]


def unit_rows(result: Result) -> list[tuple[str, ...]]:
    """By error of the unit: its label, then the cells of `unit_columns`."""
    count = len(unit_columns(result)) - 1
    return [
        (f"{one.name} {one.component} [{one.unit}]", *map(number, (one.estimate, one.sigma, one.true, one.error)[:count]))
        for one in result.unit
    ]


OUTAGE_COLUMNS = (
    "fixes withheld", "hor. [m]", "max", "stated", "ratio", "down [m]", "max", "stated", "ratio",
)  # fmt: skip
"""Columns of the errors in outages: begin and length; horizontal and vertical, each at the end, the largest, the sigma stated
at the end, and the error at the end over it."""


def outage_rows(outages: Outages) -> list[tuple[str, ...]]:
    """By outage, and of all: a label, then the cells of `OUTAGE_COLUMNS`."""
    labels = [f"{round(one.begin, 1):.12g} s, {round(one.end - one.begin, 1):.6g} s" for one in outages.each]
    statistics = [one.statistics() for one in outages.each]
    if len(statistics) > 1:
        labels.append(f"all {len(statistics)}, rms")
        statistics.append(outages.summary())
    kinds = ("end", "max", "stated", "ratio")
    return [
        (label, *(number(one[kind][name]) for name in SHOWN for kind in kinds))
        for label, one in zip(labels, statistics, strict=True)
    ]


def beyond_line(outages: Outages) -> str:
    """What the columns mean, and the share of the errors beyond three sigma."""
    compared = "errors against the withheld fixes, at the end of each outage and the largest"
    if not outages.ratios.size:
        return compared
    beyond = f"{outages.beyond} of {outages.ratios.size} errors north, east, down are beyond {BEYOND:g} sigma"
    return f"{compared}; stated: 1 sigma of estimate and fix together; {beyond}"


def force_line(force: SpecificForce) -> str:
    """How an attitude fits the velocities of the receiver."""
    reference = "" if force.reference is None else f", by the reference {number(force.reference)}"
    return f"specific force against GNSS velocity: {number(force.estimate)} m/s2 rms{reference}"


def _of_result(result: Result, place: int, report: RunData) -> Iterator[Block]:
    """The tables of one estimator: its errors, those in outages and, of a calibration, those of the unit."""
    shown = [name for name in CHANNELS if name in result.errors]
    start = "over the whole run" if result.from_s <= 0 else f"from {clock(result.from_s)} s on"
    # no time is known of an estimate that came from outside
    facts_of = [f"statistics {start}"] if shown else []
    facts_of += [f"{number(result.us_per_sample)} us a sample"] if isfinite(result.us_per_sample) else []
    yield Line(result.estimator, "bold", f"   {', '.join(facts_of)}")
    remarks = list(_remarks(result))
    below = [f"Statistics {start}"] if shown and result.from_s > 0 else []
    below += [text for _, text in remarks]
    below += [f"{number(result.us_per_sample)} \N{MICRO SIGN}s a sample"] if result.us_per_sample else []
    on_page: dict[str, Any] = {"caption": result.estimator, "group": place}
    errors = on_page | {"below": below, "state": "" if result.health is None else result.health.verdict}
    published = [(name, rms) for name, rms in report.published if any(channel in rms for channel in shown)]
    if shown:
        columns = error_columns(result)
        rows: list[Sequence[str | Line]] = []
        for channel, (text, values) in zip(shown, error_rows(result), strict=True):
            cells = {column: Line(number(value), "bold" if column == "rms" else "") for column, value in values.items()}
            if columns[-1].startswith("rms/"):
                cells[columns[-1]] = ratio_cell(values[columns[-1]])
            rows.append((text, *cells.values(), *(number(figures.get(channel)) for _, figures in published)))
        heads = (*columns, *(f"rms of {name}" for name, _ in published))
        yield Table((*columns, *["published"][: len(published)]), rows, heads=heads, **errors)
    else:
        yield Table(ESTIMATE_COLUMNS, estimate_rows(result), **errors)
    for rank, (name, figures) in enumerate(published):  # only one further column fits
        listed = [f"{label(channel)} {number(figures[channel])}" for channel in shown if channel in figures]
        yield Line(f"rms of {name}: {', '.join(listed)}" if rank else f"published: rms of {name}")
    yield from (line for line, _ in remarks)
    if result.outages is not None:
        lost, meaning = outage_rows(result.outages), beyond_line(result.outages)
        rule = len(lost) - 1 if len(lost) > 1 else None
        yield Line()
        yield Table(OUTAGE_COLUMNS, lost, rule, least=5, gap=1, below=[meaning], wide=True, **on_page)
        yield Line(meaning, "dim")
    if result.unit:
        yield Line()
        yield Table(unit_columns(result), unit_rows(result), **on_page)


def _remarks(result: Result) -> Iterator[tuple[Line, str]]:
    """What is said below the errors of an estimator, on a terminal and on its page: its health, the specific force, notes."""
    if result.health is not None:
        style: Style = "yellow" if result.health.wrong else ""
        first, *others = result.health.lines
        yield Line(f"health: {first}", style), f"Health: {first}"
        yield from ((Line(f"  {each}", style), each) for each in others)
    if result.specific_force is not None:
        line = force_line(result.specific_force)
        yield Line(line, "yellow" if result.specific_force.contradicted else ""), f"{line[0].upper()}{line[1:]}"
    yield from ((Line(f"note: {note}"), note) for note in result.notes)


def estimate_rows(result: Result) -> list[tuple[str, str, str]]:
    """Without a reference: label, estimate at the end and the standard deviation that the estimator states."""
    last = {name: value[-1:] for name, value in result.outputs.items()} if len(result.time) else {}
    texts: dict[str, str] = {}
    if "q_nb" in last:
        angles = Track(result.time[-1:], last["q_nb"]).euler_deg()[0]
        texts |= {name: f"{angle:.4f}" for name, angle in zip(ATTITUDE, angles, strict=True)}
    texts |= {f"{n}_deg": f"{math.degrees(last[n][0]):.7f}" for n in ("latitude", "longitude") if n in last}
    texts |= {"height_m": f"{last['height'][0]:.3f}"} if "height" in last else {}
    if "velocity_n" in last:
        texts |= {name: f"{speed:.4f}" for name, speed in zip(VELOCITY, last["velocity_n"][0], strict=True)}
    rows = []
    sigmas = {"latitude_deg": "north_m", "longitude_deg": "east_m", "height_m": "down_m"}
    for name, text in texts.items():
        channel = sigmas.get(name, name)
        stated = number(result.sigma[channel][-1]) if channel in result.sigma else "-"
        rows.append((label(name), text, f"{stated} m" if channel != name else stated))
    return rows
