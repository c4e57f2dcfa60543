"""What is printed and kept of a campaign: tables, document, page, figure, the table of its runs."""

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
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.health import CONTRADICTED, UNTESTED, VERDICTS
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.report.document import Block, Document, Line, Page, Sentences, Table, page_of
from insenv.report.notebook import data_frame
from insenv.report.of_run import EXPLAINED, GROUPS, NAMES, angles_picture
from insenv.report.panels import TRUTH_GROUP, Curve, Picture, Range, Section, TimePanel
from insenv.report.tables import error_label, label, left_out, number, ratio_cell, runs_of, seeds_of, since, unit_of, within
from insenv.scenario.variation import Variation
from insenv.studies.campaign.sensitivity import Sensitivity
from insenv.studies.campaign.statistics import Statistics

if TYPE_CHECKING:
    from pandas import DataFrame


# The runs of a campaign as a table: one row per run, as a DataFrame, a CSV file or a Parquet file.

FORMATS = ("csv", "parquet")


def run_columns(campaign: Statistics) -> dict[str, NDArray[Any]]:
    """By name: number and seed of the run, its varied keys, then final error, rms, limit and stated of each channel, health,
    whether it diverged, the codes of what `insenv.run` says of it.

    Values of choices are the chosen ones.  Numbers that do not exist are NaN.
    """
    columns: dict[str, NDArray[Any]] = {"run": np.arange(len(campaign.seeds)), "seed": campaign.seeds.astype(np.int64)}
    for place, variation in enumerate(campaign.plan.variations):
        numbers = campaign.values[:, place]
        drawn_from = variation.distribution
        choice = drawn_from.kind == "choice"
        columns[variation.key] = np.array([drawn_from.value(number) for number in numbers]) if choice else numbers
    for kind in ("final", "rms", "limit", "stated"):
        columns |= {f"{kind}_{name}": getattr(campaign, kind)[:, place] for place, name in enumerate(campaign.channels)}
    if campaign.health:
        columns["health"] = np.array(["" if one is None else one.verdict for one in campaign.health])
    columns["diverged"] = ~campaign.whole
    columns["remarks"] = np.array([" ".join(dict.fromkeys(one.remark.code for one in said)) for said in campaign.said])
    return columns


def check_format(name: str) -> None:
    """Raise `InputError` for a format that is unknown or whose package is missing."""
    if name not in FORMATS:
        raise InputError(f"table = {name!r}: allowed is {' or '.join(FORMATS)}")
    if name == "parquet":
        need("table 'parquet'", "pyarrow", extra="workbench")


def write_runs(campaign: Statistics, path: Path, name: str) -> None:
    """Write the table of the runs in a format (`FORMATS`); numbers keep all their digits."""
    check_format(name)
    columns = run_columns(campaign)
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


def campaign_blocks(campaign: Statistics, name: str = "", group: int | None = None) -> Iterator[Block]:
    """The printed lines and tables, top to bottom.  name, group: of the estimator, if the page has several."""
    plan, of = campaign.plan, f": {name}" if name else ""
    yield Line(f"{plan.name}: {plan.estimator}", "bold")
    yield Sentences("facts", [campaign_facts(campaign), *(f"{one.key} drawn {drawn(one)}" for one in plan.variations)])
    yield Line()
    rows = [
        (text, number(mean), Line(number(rms), "bold"), number(limit), ratio_cell(ratio), number(stated))
        for text, (mean, rms, limit, ratio, stated) in campaign_rows(campaign)
    ]
    start = [] if campaign.from_s <= 0 else [f"Statistics from {campaign.from_s:g} s on"]
    consistency, horizontal = list(consistency_lines(campaign)), list(horizontal_lines(campaign))
    yield Table(CAMPAIGN_COLUMNS, rows, caption=f"Errors over the runs{of}", group=group, below=[*start, *consistency])
    yield Line()
    levels = [f"{level:g} %" for level in campaign.percentile_levels]
    ends = [(label(name), *map(number, row["percentiles"].values())) for name, row in campaign.figures().items()]
    caption = f"Percentiles of the errors at the end{of}"
    yield Table(("at the end", *levels), ends, caption=caption, heads=("error", *levels), group=group, below=horizontal)
    for sentence in horizontal:
        yield Line()
        yield Line(sentence)
    yield Line()
    meaning = sensitivity_meaning(campaign)
    for columns, cells in sensitivity_tables(campaign):
        caption = f"Sensitivity of {', '.join(columns[1::2])}{of}"
        yield Table(columns, cells, least=5, gap=1, caption=caption, group=group, below=[meaning], wide=True)
    if campaign.sensitivity:
        yield Line(meaning, "dim")
        yield Line()
    yield Sentences("explained", list(meanings(campaign)), "dim")
    yield from map(Line, consistency)
    yield Sentences("notes", left_out(campaign.diverged, plan.runs), "yellow")
    yield Sentences("notes", left_out(campaign.far, plan.runs, "ended 10 times worse than the median"), "yellow")
    yield Sentences("notes", campaign.notes, head="note: ")


def horizontal_lines(campaign: Statistics) -> Iterator[str]:
    """CEP, R95 and 2DRMS with their intervals, of a navigation."""
    if (horizontal := campaign.horizontal()) is not None:
        said = [f"{name.upper()} {number(e.value)} m ({number(e.low)} to {number(e.high)})" for name, e in horizontal.items()]
        yield f"horizontal at the end, 95 %: {', '.join(said)}"


def sensitivity_tables(campaign: Statistics) -> Iterator[tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Columns and rows, for attitude, position and velocity: the keys by channel, with rank correlation and Sobol index."""
    names = dict.fromkeys(one.channel for one in campaign.sensitivity)
    for group in (ATTITUDE, POSITION, VELOCITY):
        shown = [name for name in group if name in names]
        if not shown:
            continue
        columns = ("rank correlation", *(text for name in shown for text in (name.rpartition("_")[0], "index")))
        rows = []
        for variation in campaign.plan.variations:
            by_channel = {one.channel: one for one in campaign.sensitivity if one.key == variation.key}
            rows.append((variation.key, *(cell for name in shown for cell in _sensitivity(by_channel[name]))))
        yield columns, rows


def _sensitivity(one: Sensitivity) -> tuple[str, str]:
    """Rank correlation, and total Sobol index or else that of the key alone."""
    index = one.first if one.total is None else one.total
    return (
        "-" if one.correlation is None else f"{one.correlation:+.2f}",
        "-" if index is None else f"{index.value:.2f} ±{index.reach:.2f}",
    )


def sensitivity_meaning(campaign: Statistics) -> str:
    """What the columns of `sensitivity_tables` mean."""
    kind = "total" if any(one.total is not None for one in campaign.sensitivity) else "alone"
    return (
        f"rank correlation with the rms of a run; index: share of its variance by the key ({kind}), "
        "±: half the width of its 95 % interval"
    )


def meanings(campaign: Statistics) -> Iterator[str]:
    """What the columns mean, and how far rms/limit varies by chance."""
    yield f"mean, percentiles: errors at the end; rms, limit, stated: {since(campaign.from_s)}"
    count = campaign.plan.runs - len(campaign.diverged)
    if count and any(row["limit"] for row in campaign.figures().values()):
        yield within(count)


def consistency_lines(campaign: Statistics) -> Iterator[str]:
    """NEES with its bounds, and the health of the runs, if there are any."""
    if (nees := campaign.as_json()["nees"]) is not None:
        yield (
            f"NEES {number(nees['mean'])} for {nees['degrees_of_freedom']} states, within its 95 % bounds ("
            f"{number(nees['low'])} to {number(nees['high'])}) {100 * nees['share_inside']:.0f} % of the time"
        )
    if (of_runs := campaign.verdicts()) is not None:
        yield f"health of {runs_of(of_runs['runs'])}: {_health_of(of_runs, 'fixes')}"
        for id, of_aid in of_runs["aids"].items():
            yield f"  {id}: {_health_of(of_aid, 'measurements')}"


def drawn(variation: Variation) -> str:
    """From what a key is drawn, in words."""
    distribution = variation.distribution
    if distribution.kind != "uniform":
        return f"from {distribution}"
    return f"from {distribution.parameters[0]:g} to {distribution.parameters[1]:g}"


def campaign_facts(campaign: Statistics) -> str:
    """Runs, duration, seeds and samples in one line."""
    plan = campaign.plan
    seeds = seeds_of(plan.first_seed, plan.seed_of(plan.runs - 1))
    return f"{runs_of(plan.runs)} of {plan.duration_s:g} s, {seeds}, {plan.runs * plan.samples} inertial samples"


CAMPAIGN_COLUMNS = ("error", "mean", "rms", "limit", "rms/limit", "stated")


def campaign_rows(campaign: Statistics) -> list[tuple[str, list[float | None]]]:
    """By error, its label and the values of `CAMPAIGN_COLUMNS`; no ratio for runs that are too short for the estimator."""
    rows, comparable = [], not campaign.plan.too_short
    for name, row in campaign.figures().items():
        ratio = limit_ratio(row["rms"], row["limit"], name) if comparable else None
        rows.append((label(name), [row["mean"], row["rms"], row["limit"], ratio, row["stated"]]))
    return rows


def campaign_frame(campaign: Statistics) -> DataFrame:
    """The courses as a DataFrame indexed by time; see `Summary.to_dataframe`."""
    columns: dict[str, Array] = {}
    for name, course in campaign.courses.items():
        levels = zip(campaign.percentile_levels, course.percentiles, strict=True)
        columns |= {f"mean_{name}": course.mean, f"rms_{name}": course.rms}
        columns |= {f"p{level:g}_{name}": values for level, values in levels}
        optional = {f"limit_{name}": course.limit, f"stated_{name}": course.stated}
        columns |= {key: values for key, values in optional.items() if values is not None}
    if campaign.nees is not None:
        columns["nees"] = campaign.nees.mean
    return data_frame(campaign.time, columns)


def campaign_document(campaign: Statistics, table: str = "") -> Document:
    """What is printed and kept of a campaign.

    table: format of a table of the runs, `runs.csv` or `runs.parquet`; empty: none.  Raises `InputError` for another format.
    """
    if table:
        check_format(table)
    further = {f"runs.{table}": partial(write_runs, campaign, name=table)} if table else {}
    return Document(
        NAME,
        campaign.as_json(),
        partial(campaign_blocks, campaign),
        arrays=partial(campaign_arrays, campaign),
        page=partial(campaign_page, campaign),
        figure=partial(campaign_picture, campaign),
        further=further,
    )


def campaign_arrays(campaign: Statistics) -> dict[str, NDArray[Any]]:
    """All arrays of a campaign by key (docs/campaigns.md)."""
    arrays: dict[str, NDArray[Any]] = {"time": campaign.time, "percentiles": np.array(campaign.percentile_levels)}
    for name, course in campaign.courses.items():
        for kind, values in vars(course).items():
            if values is not None:
                arrays[f"{name}/{kind}"] = values
    if campaign.nees is not None:
        arrays["nees/mean"] = campaign.nees.mean
        arrays["nees/bounds"] = np.array([campaign.nees.low, campaign.nees.high])
    arrays["runs/seed"] = campaign.seeds
    for place, variation in enumerate(campaign.plan.variations):
        arrays[f"runs/{variation.key}"] = campaign.values[:, place]
    for place, name in enumerate(campaign.channels):
        for kind in ("final", "rms", "limit", "stated"):
            arrays[f"runs/{name}/{kind}"] = getattr(campaign, kind)[:, place]
    for kind in ("fixes", "refused", "factor") if campaign.health else ():
        values = [np.nan if one is None else getattr(one, kind) for one in campaign.health]
        arrays[f"runs/health/{kind}"] = np.array(values, dtype=np.float64)
    if campaign.health:
        arrays["runs/health/nis"] = np.array([np.nan if one is None else one.nis.mean for one in campaign.health])
    arrays["runs/diverged"] = np.isin(campaign.seeds, campaign.diverged)
    arrays["meta"] = np.array(to_json({"format": "insenv-campaign-summary", "version": 1, **campaign.as_json()}, indent=None))
    return arrays


def _health_of(shares: Mapping[str, Any], what: str) -> str:
    """Shares by verdict; those of untested and of contradicted runs only if there are any."""
    if shares["untested"] == 1.0:
        return UNTESTED.format(count="the", what=what)
    verdicts = (*VERDICTS, CONTRADICTED)
    listed = [verdict for verdict in verdicts if verdict not in ("untested", CONTRADICTED) or shares[verdict]]
    counted = ", ".join(f"{100 * shares[verdict]:.3g} % {verdict}" for verdict in listed)
    if shares["nis"] is None:
        return counted
    return f"{counted}; mean NIS {number(shares['nis'])}, {100 * shares['refused']:.2g} % of the {what} refused"


# The page and the figure of a campaign: its tables, and the courses of its errors.


def campaign_page(campaign: Statistics, name: str = "", group: int | None = None) -> Page:
    """The page of a campaign.  name, group: as of `campaign_blocks`."""
    consistency = [Section("Consistency", [nees_panel(campaign)], columns=1)] if campaign.nees is not None else []
    return page_of(
        campaign_blocks(campaign, name, group),
        title=str(campaign.plan.scenario.get("title", "")),
        legend=[{"name": "median of the runs"}],
        explained=[EXPLAINED["limit"]],
        sections=[*course_sections([campaign]), *consistency],
        more={"shares": True},
    )


def campaign_picture(campaign: Statistics) -> Picture:
    """Percentiles of the errors over time with plus and minus the limit; the mean NEES with its bounds if there is one."""
    plan, names = campaign.plan, ("median", "", "")
    title = f"{plan.name}: {plan.estimator}\n{runs_of(plan.runs)} of {plan.duration_s:g} s"
    groups: list[list[TimePanel | None]] = [
        [course_panel([campaign], name) for name in group if name in campaign.courses] for _, group in GROUPS
    ]
    groups = [group for group in groups if group]
    consistency = [] if campaign.nees is None else [nees_panel(campaign)]
    if len(groups) == 1:  # attitude only
        return angles_picture(title, names, [*filter(None, groups[0]), *consistency], campaign.from_s, columns=3)
    rows = [*groups, *([one, None, None] for one in consistency)]
    return Picture(title, rows, names, (11.0, 1.4 + 2.2 * len(rows)), columns=3)


def course_sections(campaigns: Sequence[Statistics]) -> list[Section]:
    """The errors over time of campaigns of the same runs, by channel; the place of a campaign is its group of curves."""
    known = {name for one in campaigns for name in one.courses}
    return [Section(title, [course_panel(campaigns, name) for name in group if name in known]) for title, group in GROUPS]


def course_panel(campaigns: Sequence[Statistics], name: str) -> TimePanel:
    """Median and bands of one channel, and the limit of the first campaign that has the channel."""
    having = [(place, one, one.courses[name]) for place, one in enumerate(campaigns) if name in one.courses]
    start = min(one.from_s for _, one, _ in having)
    panel = TimePanel(
        NAMES[name], unit_of(name), having[0][1].time, error_label(name), errors=True, wraps=name in ATTITUDE,
        from_s=start if start > 0 else None,
    )  # fmt: skip
    for place, _, course in having:
        low, lower, _, upper, high = course.percentiles
        panel.marks += [Range(place, low, high, label="95 % of the runs"), Range(place, lower, upper, 1.6, "68 % of the runs")]
    limit = having[0][2].limit
    if limit is not None:
        panel.marks.append(Curve(TRUTH_GROUP, limit, "limit"))
    panel.marks += [Curve(place, course.percentiles[2]) for place, _, course in having]
    return panel


def nees_panel(campaign: Statistics) -> TimePanel:
    """The mean NEES with the bounds of a consistent estimator."""
    nees = campaign.nees
    assert nees is not None
    panel = TimePanel(
        f"Mean NEES of {nees.degrees:g} states, with its 95 % bounds", "1", campaign.time, "mean NEES", level=nees.degrees
    )
    low, high = (np.full(len(campaign.time), end) for end in (nees.low, nees.high))
    panel.marks += [Range(2, low, high), Curve(0, nees.mean)]
    return panel
