"""Output of a campaign: tables for 80 columns, the figure over time, the result files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.campaigns.statistics import Statistics
from insenv.campaigns.tables import check_format, write_runs
from insenv.campaigns.variation import Variation
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.health import VERDICTS
from insenv.evaluation.limits import ratio as limit_ratio
from insenv.report.document import finite, to_json
from insenv.report.files import FilesWritten, OutputFolder, no_matplotlib
from insenv.report.notebook import data_frame, html_document
from insenv.report.scales import set_scale
from insenv.report.tables import label, number, table_of, within
from insenv.style import COLOURS, DASHED, LIMIT, PALE, legend, page, save, title, unwrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from rich.console import RenderableType


NAME = "campaign"
NAMED = 10
"""Largest number of seeds of diverged runs that are printed; the files hold all."""


def campaign_document(found: Statistics, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented JSON form; with `files` (paths written) if there are any."""
    return finite({**found.as_json(), **({"files": list(files)} if files else {})})


def campaign_tables(found: Statistics) -> Iterator[RenderableType]:
    """The printed lines and tables, top to bottom."""
    from rich.text import Text

    plan, document = found.plan, found.as_json()
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
    if (horizontal := found.horizontal()) is not None:
        yield Text()
        said = [f"{name.upper()} {number(e.value)} m ({number(e.low)} to {number(e.high)})" for name, e in horizontal.items()]
        yield Text(f"horizontal at the end, 95 %: {', '.join(said)}")
    yield Text()
    yield from _sensitivity(found)
    start = "over the whole runs" if found.from_s <= 0 else f"from {found.from_s:g} s on"
    yield Text(f"mean, percentiles: of the errors at the end; rms, limit, stated: {start}, all runs", "dim")
    if document["limit_ratio_95"] and any(row["limit"] for row in figures.values()):
        yield Text(within(plan.runs - len(found.diverged)), "dim")
    for told in consistency_lines(found):
        yield Text(told)
    for seeds_of, what in ((found.diverged, "diverged and are left out"), (found.far, "ended 10 times worse than the median")):
        if seeds_of:
            named = ", ".join(str(seed) for seed in seeds_of[:NAMED]) + (", ..." if len(seeds_of) > NAMED else "")
            yield Text(f"{len(seeds_of)} of {plan.runs} runs {what}: seed {named}", "yellow")
    for note in document["notes"]:
        yield Text(f"note: {note}")


def _sensitivity(found: Statistics) -> Iterator[RenderableType]:
    """The keys by channel: rank correlation, first-order and total index."""
    from rich.text import Text

    if not found.sensitivity:
        return
    names = dict.fromkeys(one.channel for one in found.sensitivity)
    total = any(one.total is not None for one in found.sensitivity)
    for group in (ATTITUDE, POSITION, VELOCITY):
        shown = [name for name in group if name in names]
        if not shown:
            continue
        columns = [text for name in shown for text in (name.rpartition("_")[0], "index")]
        table = table_of("rank correlation", *columns, least=5, gap=1)
        for variation in found.plan.variations:
            own = {one.channel: one for one in found.sensitivity if one.key == variation.key}
            cells = []
            for name in shown:
                one = own[name]
                index = one.total if total else one.first
                cells += ["-" if one.correlation is None else f"{one.correlation:+.2f}"]
                cells += ["-" if index is None else f"{index.value:.2f} ±{index.reach:.2f}"]
            table.add_row(variation.key, *cells)
        yield table
    yield Text(
        f"rank correlation with the rms of a run; index: share of its variance by the key ({'total' if total else 'alone'}), "
        "±: half the width of its 95 % interval",
        "dim",
    )
    yield Text()


def consistency_lines(found: Statistics) -> Iterator[str]:
    """NEES with its bounds, and the health of the runs, if there are any."""
    if (nees := found.as_json()["nees"]) is not None:
        yield (
            f"NEES {number(nees['mean'])} for {nees['degrees_of_freedom']} states, in its 95 % bounds "
            f"{number(nees['low'])} to {number(nees['high'])} {100 * nees['share_inside']:.0f} % of the time"
        )
    if (of_runs := found.verdicts()) is not None:
        yield f"health of {of_runs['runs']} runs: {_health_of(of_runs, 'fixes')}"
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
    return f"{plan.runs} runs of {plan.duration_s:g} s, {seeds}, {plan.runs * plan.samples} inertial samples"


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
    from insenv.campaigns.campaign_page import campaign_page

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
        for kind in ("final", "rms", "limit"):
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
    verdicts = ", ".join(f"{100 * shares[verdict]:.3g} % {verdict}" for verdict in VERDICTS)
    if shares["nis"] is None:
        return verdicts
    return f"{verdicts}; mean NIS {number(shares['nis'])}, {100 * shares['refused']:.2g} % of the {what} refused"


def draw_campaign(found: Statistics) -> Figure:
    """Percentiles of the errors over time with plus and minus the limit; the mean NEES with its bounds if there is one."""
    with page() as figure:
        groups = [[name for name in group if name in found.courses] for group in (ATTITUDE, POSITION, VELOCITY)]
        groups = [group for group in groups if group]
        rows = len(groups) + (found.nees is not None)
        handles: dict[str, Any] = {}
        if len(groups) == 1:  # attitude only: one row of panels per angle; on the right, the end of the run
            count = 3 + (found.nees is not None)
            figure.set_size_inches(9.0, 1.2 + 2.1 * count)
            axes = figure.subplots(count, 2, squeeze=False, sharex="col", width_ratios=(1.25, 1))
            for (left, right), name in zip(axes, groups[0], strict=False):
                for axis, from_s in ((left, 0.0), (right, found.from_s)):
                    handles |= _course(axis, found, name, from_s)
                left.set_ylabel(label(name).replace(" [", " error ["))
            axes[0, 0].set_title("Error over the whole run", loc="left")
            axes[0, 1].set_title(f"From {found.from_s:g} s on, where the statistics are taken", loc="left")
            if found.nees is not None:
                for axis, from_s in zip(axes[-1], (0.0, found.from_s), strict=True):
                    _nees(axis, found, from_s)
                axes[-1, 0].set_ylabel("mean NEES")
            bottom = list(axes[-1])
        else:
            figure.set_size_inches(11.0, 1.4 + 2.2 * rows)
            axes = figure.subplots(rows, 3, squeeze=False, sharex=True)
            for row, group in zip(axes, groups, strict=False):
                for axis, name in zip(row, group, strict=True):
                    handles |= _course(axis, found, name, 0.0)
                    axis.set_title(label(name).replace(" [", " error ["), loc="left")
            if found.nees is not None:
                _nees(axes[-1, 0], found, 0.0)
                axes[-1, 0].set_title("Mean NEES over the runs", loc="left")
                for above, axis in zip(axes[-2, 1:], axes[-1, 1:], strict=True):
                    axis.set_axis_off()
                    above.tick_params(labelbottom=True)
            bottom = list(axes[-1]) if found.nees is None else [axes[-1, 0], *axes[-2, 1:]]
        for axis in bottom:
            axis.set_xlabel("time [s]")
        plan = found.plan
        title(figure, f"{plan.name}: {plan.estimator}\n{plan.runs} runs of {plan.duration_s:g} s")
        legend(figure, handles, columns=3)
        return figure


def _course(axis: Axes, found: Statistics, name: str, from_s: float) -> dict[str, Any]:
    """Draw one channel from `from_s` on; return the legend's handles by their text."""
    course, late = found.courses[name], found.time >= from_s - 1e-9
    time = found.time[late]
    low, lower, median, upper, high = course.percentiles[:, late]
    handles: dict[str, Any] = {}
    axis.axhline(0.0, color=PALE, linewidth=0.6, zorder=1)
    for below, above, alpha, share in ((low, high, 0.16, "95 %"), (lower, upper, 0.32, "68 %")):
        text = f"{share} of the runs"
        handles[text] = axis.fill_between(time, below, above, color=COLOURS[0], alpha=alpha, linewidth=0, zorder=2, label=text)
    shown = unwrapped(median) if name in ATTITUDE else median
    (handles["median"],) = axis.plot(time, shown, color=COLOURS[0], zorder=3, label="median")
    reach = 0.0
    if course.limit is not None:
        for sign in (-1, 1):
            (line,) = axis.plot(time, sign * course.limit[late], color=LIMIT, linestyle=DASHED, linewidth=1.0, zorder=4)
        line.set_label("theoretical limit, ±1 sigma")
        handles[str(line.get_label())] = line
        reach = float(np.nanmax(course.limit[late][-max(1, len(time) // 4) :]))
    axis.set_xlim(from_s, float(found.time[-1]))
    return handles | set_scale(axis, [np.concatenate([low, high]) if from_s > 0 else np.stack([low, high], 1).ravel()], [reach])


def _nees(axis: Axes, found: Statistics, from_s: float) -> None:
    """Draw the mean NEES with the bounds of a consistent estimator."""
    assert found.nees is not None
    late = found.time >= from_s - 1e-9
    axis.axhspan(found.nees.low, found.nees.high, color=COLOURS[2], alpha=0.2, linewidth=0, zorder=1)
    axis.axhline(found.nees.degrees, color=LIMIT, linestyle=DASHED, linewidth=1.0, zorder=2)
    axis.plot(found.time[late], found.nees.mean[late], color=COLOURS[2], zorder=3)
    axis.set_xlim(from_s, float(found.time[-1]))
    axis.set_ylim(0.0, None)
