"""The commands that measure insenv itself: `insenv reproduce` against papers, `insenv bench` on this machine."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from insenv.cli.options import Json, Out, command


@command
def reproduce(
    paper: Annotated[Optional[str], typer.Argument(metavar="[PAPER]", help="One paper; all papers if omitted.")] = None,  # noqa: UP045
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Repeat the tests of the papers; print published values, those of the printed form and of insenv, and the limit."""
    from insenv.cli.output import print_blocks, print_json, print_line, working
    from insenv.report import OutputFolder
    from insenv.reproduce import chosen, document, figure
    from insenv.reproduce import reproduce as measure

    papers = chosen(paper)
    folder = None if out is None else OutputFolder(out)
    by_paper, written = {}, []
    with working(f"measuring {papers[0]}") as progress:
        for name, quantities in measure(paper):
            by_paper[name] = quantities
            progress.finished(f"measured {name}")
        if folder is not None:
            for name in papers:
                written += figure(name, folder.path)
    shown = document(by_paper)
    if as_json:
        print_json(shown.as_json()["rows"])
        return
    print_blocks(shown.blocks())
    if written:
        print_line(f"written: {', '.join(str(path) for path in written)}")


@command
def bench(
    only: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="PREFIX", help="Only the figures whose names start with this."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure speed and accuracy on this machine, each figure beside its floor."""
    from insenv.bench import document, figures
    from insenv.cli.output import print_blocks, print_json, working

    measured = []
    with working("measuring") as progress:
        for figure in figures(only):
            measured.append(figure)
            progress.describe(f"measuring: {figure.name} done")
    shown = document(measured)
    if as_json:
        print_json(shown.as_json())
        return
    print_blocks(shown.blocks())
