"""Output of an error budget: tables for 80 columns, the document, the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base.output import finite, to_json
from insenv.base.style import save
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.limits import ratio_bounds
from insenv.report.files import FilesWritten, OutputFolder, no_matplotlib
from insenv.report.tables import number, runs_of, since, table_of
from insenv.studies.budget_result import Array, Budget

if TYPE_CHECKING:
    from rich.console import RenderableType

NAME = "budget"
GROUPS = (("attitude, deg", ATTITUDE), ("velocity, m/s", VELOCITY), ("position, m", POSITION))
SMALL = 1e-3
"""Share of the variance, in every channel of a table, below which a source is not listed."""
NAMED = 10
"""Largest number of seeds that are printed."""
SHOWN = 10
"""Largest number of sources that have a colour of their own; the others are one band."""


def budget_document(found: Budget, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented JSON form; with `files` (paths written) if there are any."""
    return finite({**found.as_json(), **({"files": list(files)} if files else {})})


def budget_tables(found: Budget) -> Iterator[RenderableType]:
    """The printed lines and tables, top to bottom."""
    from rich.text import Text

    yield Text(f"{found.scenario}: {found.estimator}", "bold")
    yield Text(facts(found))
    for title, names in GROUPS:
        places = [found.channels.index(name) for name in names if name in found.channels]
        if places:
            yield Text()
            yield from _group(found, title, places)
    yield Text()
    for sentence in sentences(found):
        yield Text(sentence, "dim")
    if diverged := left_out(found):
        yield Text(diverged, "yellow")
    for note in found.notes:
        yield Text(f"note: {note}")


def sentences(found: Budget) -> tuple[str, ...]:
    """What the lines and columns mean."""
    count = found.runs - len(found.diverged)
    low, high = ratio_bounds(count)
    return (
        f"rms {since(found.from_s)}: change by a source alone; w/o: error without it",
        "method: no source at all; interaction: the rest of all sources, run by run",
        f"rms of {runs_of(count)} over that of many runs: {low:.2f} to {high:.2f} (95 %)",
    )


def ranked(found: Budget) -> tuple[list[int], list[int]]:
    """The sources with a colour of their own, the largest first, and the others; by place."""
    shares = np.nan_to_num(found.shares()[:-1])
    order = sorted(range(len(found.sources)), key=lambda k: -shares[k].max())
    return order[:SHOWN], order[SHOWN:]


def left_out(found: Budget) -> str:
    """The sentence on runs that diverged; empty if none did."""
    if not found.diverged:
        return ""
    named = ", ".join(map(str, found.diverged[:NAMED])) + (", ..." if len(found.diverged) > NAMED else "")
    return f"{len(found.diverged)} of {found.runs} runs diverged and are left out: seed {named}"


def facts(found: Budget) -> str:
    """Runs, duration, seeds and sources in one line."""
    seeds = f"seeds {found.first_seed} to {found.first_seed + found.runs - 1}" if found.runs > 1 else f"seed {found.first_seed}"
    return f"{runs_of(found.runs)} of {found.duration_s:g} s, {seeds}; {len(found.sources)} sources of error"


@dataclass(frozen=True)
class BudgetRow:
    """One line of a table.  values: by channel, of the source alone and of the error without it; None: not told.

    large: by channel, whether the source has a quarter of the variance.
    """

    name: str
    values: tuple[float | None, ...]
    large: tuple[bool, ...] = ()


def budget_rows(found: Budget, places: list[int]) -> list[BudgetRow]:
    """The lines for some channels, by their places: the sources by their share, then what they make together."""
    shares = found.shares()[:, places]
    alone, without = found.rms(found.alone)[:, places], found.rms(found.without)[:, places]
    largest = np.nan_to_num(shares[:-1], nan=np.inf).max(axis=1)
    order = sorted(range(len(found.sources)), key=lambda k: -largest[k])
    small = [k for k in order if largest[k] < SMALL]
    if len(small) < 2:
        small = []
    rows = [
        BudgetRow(found.sources[k], tuple(np.stack([alone[k], without[k]], 1).ravel().tolist()), tuple(shares[k] >= 0.25))
        for k in order
        if k not in small
    ]
    if small:
        rows.append(_together(f"{len(small)} smaller ones", np.sqrt(np.sum(alone[small] ** 2, axis=0))))
    lines = [("method", found.none), ("root sum of squares", found.sum), ("all sources", found.whole)]
    lines += [("interaction", found.interaction)]
    lines += [] if found.limit is None else [("limit", found.limit)]
    return rows + [_together(name, found.rms(squares)[places]) for name, squares in lines]


def _together(name: str, values: Array) -> BudgetRow:
    return BudgetRow(name, tuple(each for value in values.tolist() for each in (value, None)))


def _group(found: Budget, title: str, places: list[int]) -> Iterator[RenderableType]:
    """One table of `budget_rows`."""
    from rich.text import Text

    columns = [text for place in places for text in (found.channels[place].rpartition("_")[0], "w/o")]
    table = table_of(title, *columns, gap=1)
    for row in budget_rows(found, places):
        if row.name == "method":
            table.add_section()
        cells = [Text("" if value is None else number(value)) for value in row.values]
        for cell, large in zip(cells[::2], row.large or [row.name == "all sources"] * len(places), strict=True):
            cell.stylize("bold" if large else "")
        table.add_row(row.name, *cells)
    yield table


def write_budget(found: Budget, folder: OutputFolder, figure: bool = True) -> FilesWritten:
    """Write budget.npz, budget.json; if `figure`, the page budget.html, and, with matplotlib, budget.png and budget.svg."""
    from insenv.studies.budget_figure import draw_budget
    from insenv.studies.budget_page import budget_page

    note = no_matplotlib() if figure else ""
    drawn = figure and not note
    kinds = ["npz", "json", *(["html"] if figure else []), *(["png", "svg"] if drawn else [])]
    names = [f"{NAME}.{kind}" for kind in kinds]
    with folder.staged() as part:
        with part(names[0]).open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **budget_arrays(found))
        part(names[1]).write_text(to_json(budget_document(found, names)) + "\n", encoding="ascii")
        if figure:
            part(f"{NAME}.html").write_text(budget_page(found), encoding="utf-8", newline="\n")
        if drawn:
            save(draw_budget(found), {kind: part(f"{NAME}.{kind}") for kind in ("png", "svg")})
    return FilesWritten(tuple(folder.path / name for name in names), note)


def budget_arrays(found: Budget) -> dict[str, Any]:
    """All arrays of a budget by key (docs/budget.md): root mean squares over the runs at each time."""
    arrays: dict[str, Any] = {"time": found.time, "channels": np.array(found.channels), "sources": np.array(found.sources)}
    for name in ("whole", "none", "interaction", "sum", "alone", "without", "limit"):
        squares = getattr(found, name)
        if squares is not None:
            arrays[{"none": "method", "sum": "root_sum_square"}.get(name, name)] = np.sqrt(squares)
    arrays["meta"] = np.array(to_json({"format": "insenv-budget", "version": 1, **found.as_json()}, indent=None))
    return arrays
