"""Output of a campaign: tables for 80 columns, the document, the result files."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.output import to_json
from insenv.base.version import __version__
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.health import LINES, VERDICTS
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.report.document import Block, Document, Grid, Line
from insenv.report.notebook import data_frame, html_document
from insenv.report.page import assembled
from insenv.report.page.of_run import EXPLAINED, NAMES, unit_of
from insenv.report.page.panels import TRUTH_GROUP, Pool, TimePanel, kept_records, section, table
from insenv.report.scales import threshold_of
from insenv.report.tables import label, number, runs_of, since, within
from insenv.studies.campaign.campaign_figure import draw_campaign
from insenv.studies.campaign.sensitivity import Sensitivity
from insenv.studies.campaign.statistics import Statistics, named
from insenv.studies.campaign.variation import Variation

if TYPE_CHECKING:
    from pandas import DataFrame


# The runs of a campaign as a table: one row per run, as a DataFrame, a CSV file or a Parquet file.

FORMATS = ("csv", "parquet")


def run_columns(found: Statistics) -> dict[str, NDArray[Any]]:
    """By name: number and seed of the run, its varied keys, then final error, rms, limit and stated of each channel, health.

    Values of choices are the chosen ones.  Numbers that do not exist are NaN.
    """
    columns: dict[str, NDArray[Any]] = {"run": np.arange(len(found.seeds)), "seed": found.seeds.astype(np.int64)}
    for place, variation in enumerate(found.plan.variations):
        numbers = found.values[:, place]
        given = variation.distribution
        columns[variation.key] = numbers if given.kind != "choice" else np.array([given.value(number) for number in numbers])
    for kind in ("final", "rms", "limit", "stated"):
        columns |= {f"{kind}_{name}": getattr(found, kind)[:, place] for place, name in enumerate(found.channels)}
    if found.health:
        columns["health"] = np.array(["" if one is None else one.verdict for one in found.health])
    columns["diverged"] = ~found.whole
    return columns


def check_format(name: str) -> None:
    """Raise `InputError` for a format that is unknown or whose package is missing."""
    if name not in FORMATS:
        raise InputError(f"table = {name!r}: allowed is {' or '.join(FORMATS)}")
    if name == "parquet":
        need("table 'parquet'", "pyarrow", extra="workbench")


def write_runs(found: Statistics, path: Path, name: str) -> None:
    """Write the table of the runs in a format (`FORMATS`); numbers keep all their digits."""
    check_format(name)
    columns = run_columns(found)
    if name == "parquet":
        import pyarrow
        import pyarrow.parquet

        pyarrow.parquet.write_table(pyarrow.table({key: pyarrow.array(values) for key, values in columns.items()}), path)
        return
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(_texts(values) for values in columns.values()), strict=True))


def _texts(values: NDArray[Any]) -> list[Any]:
    """Values as they stand in a CSV file: NaN is empty."""
    if values.dtype.kind != "f":
        return [str(value).lower() if values.dtype.kind == "b" else value for value in values.tolist()]
    return ["" if np.isnan(value) else repr(value) for value in values.tolist()]


NAME = "campaign"


def campaign_blocks(found: Statistics) -> Iterator[Block]:
    """The printed lines and tables, top to bottom."""
    plan = found.plan
    yield Line(f"{plan.name}: {plan.estimator}", "bold")
    yield Line(campaign_facts(found))
    for variation in plan.variations:
        yield Line(f"{variation.key} drawn {drawn(variation)}")
    yield Line()
    rows: list[Sequence[str | Line]] = []
    for text, (mean, rms, limit, ratio, stated) in campaign_rows(found):
        far = Line(number(ratio), "yellow" if ratio is not None and ratio > 3 else "")
        rows.append((text, number(mean), Line(number(rms), "bold"), number(limit), far, number(stated)))
    yield Grid(CAMPAIGN_COLUMNS, rows)
    yield Line()
    ends = [(label(name), *map(number, row["percentiles"].values())) for name, row in found.figures().items()]
    yield Grid(("at the end", *(f"{p:g} %" for p in found.percentile_levels)), ends)
    for told in horizontal_lines(found):
        yield Line()
        yield Line(told)
    yield Line()
    for columns, cells in sensitivity_tables(found):
        yield Grid(columns, cells, least=5, gap=1)
    if found.sensitivity:
        yield Line(sensitivity_meaning(found), "dim")
        yield Line()
    for meaning in meanings(found):
        yield Line(meaning, "dim")
    for told in consistency_lines(found):
        yield Line(told)
    for told in failed_lines(found):
        yield Line(told, "yellow")
    for note in found.notes:
        yield Line(f"note: {note}")


def horizontal_lines(found: Statistics) -> Iterator[str]:
    """CEP, R95 and 2DRMS with their intervals, of a navigation."""
    if (horizontal := found.horizontal()) is not None:
        said = [f"{name.upper()} {number(e.value)} m ({number(e.low)} to {number(e.high)})" for name, e in horizontal.items()]
        yield f"horizontal at the end, 95 %: {', '.join(said)}"


def sensitivity_tables(found: Statistics) -> Iterator[tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Columns and rows, for attitude, position and velocity: the keys by channel, with rank correlation and Sobol index."""
    names = dict.fromkeys(one.channel for one in found.sensitivity)
    for group in (ATTITUDE, POSITION, VELOCITY):
        shown = [name for name in group if name in names]
        if not shown:
            continue
        columns = ("rank correlation", *(text for name in shown for text in (name.rpartition("_")[0], "index")))
        rows = []
        for variation in found.plan.variations:
            own = {one.channel: one for one in found.sensitivity if one.key == variation.key}
            rows.append((variation.key, *(cell for name in shown for cell in _sensitivity(own[name]))))
        yield columns, rows


def _sensitivity(one: Sensitivity) -> tuple[str, str]:
    """Rank correlation, and total Sobol index or else that of the key alone."""
    index = one.first if one.total is None else one.total
    return (
        "-" if one.correlation is None else f"{one.correlation:+.2f}",
        "-" if index is None else f"{index.value:.2f} ±{index.reach:.2f}",
    )


def sensitivity_meaning(found: Statistics) -> str:
    """What the columns of `sensitivity_tables` mean."""
    kind = "total" if any(one.total is not None for one in found.sensitivity) else "alone"
    return (
        f"rank correlation with the rms of a run; index: share of its variance by the key ({kind}), "
        "±: half the width of its 95 % interval"
    )


def meanings(found: Statistics) -> Iterator[str]:
    """What the columns mean, and how far rms/limit varies by chance."""
    yield f"mean, percentiles: errors at the end; rms, limit, stated: {since(found.from_s)}"
    count = found.plan.runs - len(found.diverged)
    if count and any(row["limit"] for row in found.figures().values()):
        yield within(count)


def failed_lines(found: Statistics) -> Iterator[str]:
    """The runs that diverged, and those that ended far off, by their seeds."""
    for seeds_of, what in ((found.diverged, "diverged and are left out"), (found.far, "ended 10 times worse than the median")):
        if seeds_of:
            yield f"{len(seeds_of)} of {found.plan.runs} runs {what}: {named(seeds_of)}"


def consistency_lines(found: Statistics) -> Iterator[str]:
    """NEES with its bounds, and the health of the runs, if there are any."""
    if (nees := found.as_json()["nees"]) is not None:
        yield (
            f"NEES {number(nees['mean'])} for {nees['degrees_of_freedom']} states, in its 95 % bounds "
            f"{number(nees['low'])} to {number(nees['high'])} {100 * nees['share_inside']:.0f} % of the time"
        )
    if (of_runs := found.verdicts()) is not None:
        yield f"health of {runs_of(of_runs['runs'])}: {_health_of(of_runs, 'fixes')}"
        for id, of_aid in of_runs["aids"].items():
            yield f"  {id}: {_health_of(of_aid, 'measurements')}"


def drawn(variation: Variation) -> str:
    """From what a key is drawn, in words."""
    distribution = variation.distribution
    if distribution.kind != "uniform":
        return f"from {distribution}"
    return f"from {distribution.parameters[0]:g} to {distribution.parameters[1]:g}"


def campaign_facts(found: Statistics) -> str:
    """Runs, duration, seeds and samples in one line."""
    plan = found.plan
    last = plan.seed_of(plan.runs - 1)
    seeds = f"seeds {plan.first_seed} to {last}" if last > plan.first_seed else f"seed {plan.first_seed}"
    return f"{runs_of(plan.runs)} of {plan.duration_s:g} s, {seeds}, {plan.runs * plan.samples} inertial samples"


CAMPAIGN_COLUMNS = ("error", "mean", "rms", "limit", "rms/limit", "stated")


def campaign_rows(found: Statistics) -> list[tuple[str, list[float | None]]]:
    """By error, its label and the values of `CAMPAIGN_COLUMNS`; no ratio for runs that are too short for the estimator."""
    rows, comparable = [], not found.plan.too_short
    for name, row in found.figures().items():
        ratio = limit_ratio(row["rms"], row["limit"], name) if comparable else None
        rows.append((label(name), [row["mean"], row["rms"], row["limit"], ratio, row["stated"]]))
    return rows


def campaign_html(found: Statistics) -> str:
    """A table of the errors, with the figure, for a notebook."""
    rows = [(text, *map(number, values)) for text, values in campaign_rows(found)]
    tables = [("errors", CAMPAIGN_COLUMNS, rows)]
    plan = found.plan
    return html_document(
        f"{plan.name}: {plan.estimator}", campaign_facts(found), tables, found.notes, lambda: draw_campaign(found)
    )


def campaign_frame(found: Statistics) -> DataFrame:
    """The courses as a DataFrame indexed by time; see `Summary.to_dataframe`."""
    columns: dict[str, NDArray[np.float64]] = {}
    for name, course in found.courses.items():
        levels = zip(found.percentile_levels, course.percentiles, strict=True)
        columns |= {f"mean_{name}": course.mean, f"rms_{name}": course.rms}
        columns |= {f"p{level:g}_{name}": values for level, values in levels}
        optional = {f"limit_{name}": course.limit, f"stated_{name}": course.stated}
        columns |= {key: values for key, values in optional.items() if values is not None}
    if found.nees is not None:
        columns["nees"] = found.nees.mean
    return data_frame(found.time, columns)


def campaign_document(found: Statistics, table: str = "") -> Document:
    """What is printed and kept of a campaign.

    table: format of a table of the runs, `runs.csv` or `runs.parquet`; empty: none.  Raises `InputError` for another format.
    """
    if table:
        check_format(table)
    further = {f"runs.{table}": partial(write_runs, found, name=table)} if table else {}
    return Document(
        NAME,
        found.as_json(),
        partial(campaign_blocks, found),
        arrays=partial(campaign_arrays, found),
        page=partial(campaign_page, found),
        figure=partial(draw_campaign, found),
        further=further,
    )


def campaign_arrays(found: Statistics) -> dict[str, NDArray[Any]]:
    """All arrays of a campaign by key (docs/campaigns.md)."""
    arrays: dict[str, NDArray[Any]] = {"time": found.time, "percentiles": np.array(found.percentile_levels)}
    for name, course in found.courses.items():
        for kind, values in vars(course).items():
            if values is not None:
                arrays[f"{name}/{kind}"] = values
    if found.nees is not None:
        arrays["nees/mean"] = found.nees.mean
        arrays["nees/bounds"] = np.array([found.nees.low, found.nees.high])
    arrays["runs/seed"] = found.seeds
    for place, variation in enumerate(found.plan.variations):
        arrays[f"runs/{variation.key}"] = found.values[:, place]
    for place, name in enumerate(found.channels):
        for kind in ("final", "rms", "limit", "stated"):
            arrays[f"runs/{name}/{kind}"] = getattr(found, kind)[:, place]
    for kind in ("fixes", "refused", "factor") if found.health else ():
        values = [np.nan if one is None else getattr(one, kind) for one in found.health]
        arrays[f"runs/health/{kind}"] = np.array(values, dtype=np.float64)
    if found.health:
        arrays["runs/health/nis"] = np.array([np.nan if one is None else one.nis.mean for one in found.health])
    arrays["runs/diverged"] = np.isin(found.seeds, found.diverged)
    arrays["meta"] = np.array(to_json({"format": "insenv-campaign-summary", "version": 1, **found.as_json()}, indent=None))
    return arrays


def _health_of(shares: Mapping[str, Any], what: str) -> str:
    """Shares by verdict; that of untested runs only if there are any."""
    if shares["untested"] == 1.0:
        return LINES["untested"].format(count="the", what=what)
    listed = [verdict for verdict in VERDICTS if verdict != "untested" or shares[verdict]]
    verdicts = ", ".join(f"{100 * shares[verdict]:.3g} % {verdict}" for verdict in listed)
    if shares["nis"] is None:
        return verdicts
    return f"{verdicts}; mean NIS {number(shares['nis'])}, {100 * shares['refused']:.2g} % of the {what} refused"


# The page of a campaign: its tables and the courses of its errors, as one document for the front end.

GROUPS = (("Attitude error", ATTITUDE), ("Position error", POSITION), ("Velocity error", VELOCITY))


def campaign_page(found: Statistics) -> str:
    """The HTML of a campaign."""
    return assembled(f"{found.plan.name}: {found.plan.estimator}", {"report": campaign_page_document(found)})


def campaign_page_document(found: Statistics) -> dict[str, Any]:
    """The document of the page of a campaign (web/README.md)."""
    pool = Pool()
    keep = kept_records(len(found.time), 8 * len(found.courses) + 2)
    sections = course_sections([found], pool, keep)
    if found.nees is not None:
        sections.append(section("Consistency", [_nees(found, pool, keep)], columns=1))
    plan = found.plan
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{plan.name}: {plan.estimator}",
        "title": str(plan.scenario.get("title", "")),
        "facts": campaign_page_facts(found),
        "truth": "truth",
        "shares": True,
        "legend": [{"name": "median of the runs"}],
        "tables": campaign_page_tables(found),
        "explained": explained(found),
        "notes": campaign_page_notes(found),
        "sections": sections,
        "arrays": pool.as_json(),
    }


def campaign_page_facts(found: Statistics) -> list[str]:
    """Runs, seeds and varied keys."""
    return [campaign_facts(found), *(f"{one.key} drawn {drawn(one)}" for one in found.plan.variations)]


def campaign_page_tables(found: Statistics, name: str = "", group: int | None = None) -> list[dict[str, Any]]:
    """The tables that are printed.  name, group: of the estimator, if the page has several."""
    rows = [(text, *map(number, values)) for text, values in campaign_rows(found)]
    ratio = CAMPAIGN_COLUMNS.index("rms/limit")
    above = [(k, ratio) for k, (_, values) in enumerate(campaign_rows(found)) if (values[ratio - 1] or 0.0) > 3.0]
    start = [] if found.from_s <= 0 else [f"Statistics from {found.from_s:g} s on"]
    levels = [f"{level:g} %" for level in found.percentile_levels]
    ends = [(label(channel), *map(number, row["percentiles"].values())) for channel, row in found.figures().items()]
    of = f": {name}" if name else ""
    meaning = [sensitivity_meaning(found)]
    sensitivities = [
        table(f"Sensitivity of {', '.join(columns[1::2])}{of}", columns, cells, group=group, below=meaning, wide=True)
        for columns, cells in sensitivity_tables(found)
    ]
    return [
        table(
            f"Errors over the runs{of}", CAMPAIGN_COLUMNS, rows, group=group,
            below=[*start, *consistency_lines(found)], warnings=above,
        ),
        table(
            f"Percentiles of the errors at the end{of}", ("error", *levels), ends, group=group,
            below=list(horizontal_lines(found)),
        ),
        *sensitivities,
    ]  # fmt: skip


def explained(found: Statistics) -> list[str]:
    """What the columns of the tables mean."""
    return [*(f"{meaning}." for meaning in meanings(found)), EXPLAINED["limit"]]


def campaign_page_notes(found: Statistics) -> list[str]:
    """The runs that failed, and what must be said of the campaign."""
    return [*failed_lines(found), *found.notes]


def course_sections(campaigns: Sequence[Statistics], pool: Pool, keep: Any) -> list[dict[str, Any]]:
    """The errors over time of campaigns of the same runs, by channel; the place of a campaign is its group of curves."""
    sections = []
    for title, group in GROUPS:
        shown = [name for name in group if any(name in one.courses for one in campaigns)]
        if shown:
            sections.append(section(title, [_course(campaigns, pool, keep, name) for name in shown]))
    return sections


def _course(campaigns: Sequence[Statistics], pool: Pool, keep: Any, name: str) -> dict[str, Any]:
    """Median and bands of one channel, and the limit of the first campaign that has the channel."""
    own = [(place, one, one.courses[name]) for place, one in enumerate(campaigns) if name in one.courses]
    _, found, first = own[0]
    reach = 0.0 if first.limit is None else float(np.nanmax(first.limit[-max(1, len(found.time) // 4) :]))
    ends = [np.stack([course.percentiles[0], course.percentiles[-1]], 1).ravel() for _, _, course in own]
    start = min(one.from_s for _, one, _ in own)
    panel = TimePanel(
        pool, NAMES[name], unit_of(name), found.time[keep], wraps=name in ATTITUDE,
        threshold=threshold_of(ends, [reach] * len(ends)), from_s=start if start > 0 else None,
    )  # fmt: skip
    for place, _, course in own:
        low, lower, _, upper, high = course.percentiles
        panel.between(place, low[keep], high[keep])
        panel.between(place, lower[keep], upper[keep], 1.6)
    if first.limit is not None:
        panel.curve(TRUTH_GROUP, first.limit[keep], "limit")
    for place, _, course in own:
        panel.curve(place, course.percentiles[2][keep])
    return panel.as_json()


def _nees(found: Statistics, pool: Pool, keep: Any) -> dict[str, Any]:
    assert found.nees is not None
    times = found.time[keep]
    panel = TimePanel(pool, f"Mean NEES of {found.nees.degrees:g} states, with its 95 % bounds", "1", times)
    panel.between(2, np.full(len(times), found.nees.low), np.full(len(times), found.nees.high))
    panel.curve(0, found.nees.mean[keep])
    return panel.as_json()
