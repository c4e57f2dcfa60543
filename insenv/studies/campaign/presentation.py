"""Output of a campaign: tables for 80 columns, the document, the result files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.output import finite, to_json
from insenv.base.style import save
from insenv.evaluation import sentences
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.health import VERDICTS
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.report.files import FilesWritten, OutputFolder, no_matplotlib
from insenv.report.notebook import data_frame, html_document
from insenv.report.tables import label, number, runs_of, since, table_of, within
from insenv.studies.campaign.campaign_figure import draw_campaign
from insenv.studies.campaign.sensitivity import Sensitivity
from insenv.studies.campaign.statistics import Statistics, named
from insenv.studies.campaign.tables import check_format, write_runs
from insenv.studies.campaign.variation import Variation

if TYPE_CHECKING:
    from pandas import DataFrame
    from rich.console import RenderableType


NAME = "campaign"


def campaign_document(found: Statistics, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented JSON form; with `files` (paths written) if there are any."""
    return finite({**found.as_json(), **({"files": list(files)} if files else {})})


def campaign_tables(found: Statistics) -> Iterator[RenderableType]:
    """The printed lines and tables, top to bottom."""
    from rich.text import Text

    plan = found.plan
    yield Text(f"{plan.name}: {plan.estimator}", "bold")
    yield Text(campaign_facts(found))
    for variation in plan.variations:
        yield Text(f"{variation.key} drawn {drawn(variation)}")
    yield Text()
    figures = found.figures()
    table = table_of(*CAMPAIGN_COLUMNS)
    for text, (mean, rms, limit, ratio, stated) in campaign_rows(found):
        warning = "yellow" if ratio is not None and ratio > 3 else ""
        table.add_row(
            text, number(mean), Text(number(rms), "bold"), number(limit), Text(number(ratio), warning), number(stated)
        )
    yield table
    yield Text()
    table = table_of("at the end", *(f"{p:g} %" for p in found.percentile_levels))
    for name, row in figures.items():
        table.add_row(label(name), *(number(value) for value in row["percentiles"].values()))
    yield table
    for told in horizontal_lines(found):
        yield Text()
        yield Text(told)
    yield Text()
    for columns, rows in sensitivity_tables(found):
        table = table_of(*columns, least=5, gap=1)
        for cells in rows:
            table.add_row(*cells)
        yield table
    if found.sensitivity:
        yield Text(sensitivity_meaning(found), "dim")
        yield Text()
    for meaning in meanings(found):
        yield Text(meaning, "dim")
    for told in consistency_lines(found):
        yield Text(told)
    for told in failed_lines(found):
        yield Text(told, "yellow")
    for note in found.notes:
        yield Text(f"note: {note}")


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


def write_campaign(found: Statistics, folder: OutputFolder, figure: bool = True, table: str = "") -> FilesWritten:
    """Write campaign.npz and .json; if `figure`, the page campaign.html, and, with matplotlib, campaign.png and .svg.

    table: format of a table of the runs, `runs.csv` or `runs.parquet`; empty: none.
    """
    from insenv.studies.campaign.campaign_page import campaign_page

    if table:
        check_format(table)
    note = no_matplotlib() if figure else ""
    drawn = figure and not note
    tables = [f"runs.{table}"] if table else []
    kinds = ["npz", "json", *(["html"] if figure else []), *(["png", "svg"] if drawn else [])]
    names = [*(f"{NAME}.{kind}" for kind in kinds), *tables]
    paths = tuple(folder.path / name for name in names)
    with folder.staged() as part:
        with part(names[0]).open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **campaign_arrays(found))
        text = to_json(campaign_document(found, names)) + "\n"  # without the folder, so that equal campaigns are equal files
        part(names[1]).write_text(text, encoding="ascii")
        for name in tables:
            write_runs(found, part(name), table)
        if figure:
            part(f"{NAME}.html").write_text(campaign_page(found), encoding="utf-8", newline="\n")
        if drawn:
            save(draw_campaign(found), {kind: part(f"{NAME}.{kind}") for kind in ("png", "svg")})
    return FilesWritten(paths, note)


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
        return sentences.UNTESTED.format(count="the", what=what)
    listed = [verdict for verdict in VERDICTS if verdict != "untested" or shares[verdict]]
    verdicts = ", ".join(f"{100 * shares[verdict]:.3g} % {verdict}" for verdict in listed)
    if shares["nis"] is None:
        return verdicts
    return f"{verdicts}; mean NIS {number(shares['nis'])}, {100 * shares['refused']:.2g} % of the {what} refused"
