"""The command `insenv reproduce`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Optional

import typer

from insenv.cli.options import Json, Out, command


@command
def reproduce(
    paper: Annotated[Optional[str], typer.Argument(metavar="[PAPER]", help="One paper; all papers if omitted.")] = None,  # noqa: UP045
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Repeat the tests of the papers; print the published values, those of the printed form, insenv's, and the limit."""
    from insenv.cli.output import print_blocks, print_json, print_line, working
    from insenv.report import OutputFolder
    from insenv.report.document import Line
    from insenv.report.tables import number
    from insenv.reproduce import PAPERS, chosen, conditions, figure, footnotes
    from insenv.reproduce import reproduce as measure

    papers = chosen(paper)
    folder = None if out is None else OutputFolder(out)
    by_paper, written = {}, []
    with working(f"measuring {papers[0]}") as progress:
        for name, quantities in measure(paper):
            by_paper[name] = quantities
            progress.describe(f"measured {name}")
        if folder is not None:
            folder.path.mkdir(parents=True, exist_ok=True)
            for name in papers:
                written += figure(name, folder.path)
    if as_json:
        print_json([quantity.as_json() for quantities in by_paper.values() for quantity in quantities])
        return
    for name, quantities in by_paper.items():
        marks, notes = footnotes(q.note for q in quantities)
        print_line()
        print_blocks(map(Line, (f"{name}: {PAPERS[name]}", f"conditions: {conditions(name)}", *notes)))
        print_line()
        print_line(_columns(("published", "as printed", "ours", "limit", "ours/limit", "seeds")))
        for q, mark in zip(quantities, marks, strict=True):
            print_blocks([Line(f"{q.quantity}{mark}" + (f", {q.unit}" if q.unit else ""))])
            print_line(_columns((*map(number, (q.published, q.printed_form, q.ours, q.limit, q.ratio)), str(q.seeds))))
    if written:
        print_line(f"written: {', '.join(str(path) for path in written)}")


def _columns(cells: Sequence[str]) -> str:
    """A line of the table; what a row is about stands on the line above it."""
    return "".join(f"{cell:>12}" for cell in cells)
