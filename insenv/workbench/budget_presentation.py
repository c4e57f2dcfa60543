"""Output of an error budget: tables for 80 columns, the document, the files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.limits import ratio_bounds
from insenv.report.document import finite, to_json
from insenv.report.files import FilesWritten, OutputFolder, no_matplotlib
from insenv.report.tables import number, table_of
from insenv.style import save
from insenv.workbench.budget_result import Budget

if TYPE_CHECKING:
    from rich.console import RenderableType

NAME = "budget"
GROUPS = (("attitude, deg", ATTITUDE), ("velocity, m/s", VELOCITY), ("position, m", POSITION))
SMALL = 1e-3
"""Share of the variance, in every channel of a table, below which a source is not listed."""
NAMED = 10
"""Largest number of seeds that are printed."""


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
    start = "over the whole runs" if found.from_s <= 0 else f"from {found.from_s:g} s on"
    yield Text(f"rms {start}: of the change by a source alone; w/o: of the error without", "dim")
    yield Text("method: no source at all; interaction: the rest of all sources, run by run", "dim")
    low, high = ratio_bounds(found.runs - len(found.diverged))
    count = found.runs - len(found.diverged)
    yield Text(f"rms of {count} runs over that of many runs: {low:.2f} to {high:.2f} (95 %)", "dim")
    if found.diverged:
        named = ", ".join(map(str, found.diverged[:NAMED])) + (", ..." if len(found.diverged) > NAMED else "")
        yield Text(f"{len(found.diverged)} of {found.runs} runs diverged and are left out: seed {named}", "yellow")
    for note in found.notes:
        yield Text(f"note: {note}")


def facts(found: Budget) -> str:
    """Runs, duration, seeds and sources in one line."""
    seeds = f"seeds {found.first_seed} to {found.first_seed + found.runs - 1}" if found.runs > 1 else f"seed {found.first_seed}"
    return f"{found.runs} runs of {found.duration_s:g} s, {seeds}; {len(found.sources)} sources of error"


def _group(found: Budget, title: str, places: list[int]) -> Iterator[RenderableType]:
    """One table: the sources by their share, then what they make together."""
    from rich.text import Text

    columns = [text for place in places for text in (found.channels[place].rpartition("_")[0], "w/o")]
    table = table_of(title, *columns, gap=1)
    shares = found.shares()[:, places]
    alone, without = found.rms(found.alone)[:, places], found.rms(found.without)[:, places]
    largest = np.nan_to_num(shares[:-1], nan=np.inf).max(axis=1)
    order = sorted(range(len(found.sources)), key=lambda k: -largest[k])
    small = [k for k in order if largest[k] < SMALL]
    for k in order:
        if k in small and len(small) > 1:
            continue
        pairs = zip(alone[k], without[k], shares[k], strict=True)
        cells = [c for a, w, s in pairs for c in (Text(number(a), "bold" if s >= 0.25 else ""), Text(number(w)))]
        table.add_row(found.sources[k], *cells)
    if len(small) > 1:
        together = np.sqrt(np.sum(alone[small] ** 2, axis=0))
        table.add_row(f"{len(small)} smaller ones", *(c for value in together for c in (number(value), "")))
    table.add_section()
    lines = [("method", found.none), ("root sum of squares", found.sum), ("all sources", found.whole)]
    lines += [("interaction", found.interaction)]
    lines += [] if found.limit is None else [("limit", found.limit)]
    for name, squares in lines:
        values = found.rms(squares)[places]
        style = "bold" if name == "all sources" else ""
        table.add_row(name, *(c for value in values for c in (Text(number(value), style), "")))
    yield table


def write_budget(found: Budget, folder: OutputFolder, figure: bool = True) -> FilesWritten:
    """Write budget.npz, budget.json and, if `figure` and matplotlib is installed, budget.png and budget.svg."""
    from insenv.workbench.budget_figure import draw_budget

    note = no_matplotlib() if figure else ""
    drawn = figure and not note
    names = [f"{NAME}.npz", f"{NAME}.json", *((f"{NAME}.png", f"{NAME}.svg") if drawn else ())]
    with folder.staged() as part:
        with part(names[0]).open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **budget_arrays(found))
        part(names[1]).write_text(to_json(budget_document(found, names)) + "\n", encoding="ascii")
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
