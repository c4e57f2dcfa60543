"""The commands that measure insenv: `insenv reproduce` against papers, `insenv prove` on public logs, `insenv bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli.options import Json, Out, Output, command, nonempty_path
from insenv.cli.signals import DONE, FAILED


def _logs(incomplete: str) -> list[str]:
    """The public logs that a shell offers."""
    from insenv.studies.proof_logs import public_logs

    return [name for name in public_logs() if name.startswith(incomplete)]


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
def prove(
    output: Output,
    names: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Argument(metavar="[NAME]...", help="Public logs; all of them if omitted.", autocompletion=_logs),
    ] = None,
    data: Annotated[
        Path, typer.Option("--data", parser=nonempty_path, metavar="FOLDER", help="Folder that holds the data of the logs.")
    ] = Path("."),
) -> int:
    """Run estimators on public logs that you have downloaded; print errors against references and withheld fixes."""
    from insenv.studies.proof import prove as judge

    with output.working("proving") as progress:

        def show(name: str, done: int, total: int) -> None:
            progress.describe(f"proving on {name}")
            progress(done, total)

        proof = judge(names or (), data, show)
        output.keep(proof.document())
    output.show(proof.document(), "--out DIR writes the page and the JSON document")
    lacks = proof.missing and (names or len(proof.missing) == len(proof.logs))
    return FAILED if lacks else DONE


@command
def bench(
    only: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="PREFIX", help="Measure only the figures whose names start with PREFIX."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure speed and accuracy on this machine; print each figure beside its lower bound."""
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
