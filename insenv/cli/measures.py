"""The commands that measure insenv: `insenv reproduce` against papers, `insenv prove` on public logs, `insenv bench`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import check_output_file
from insenv.cli.options import Json, Out, Output, command, nonempty_path, out_option
from insenv.cli.signals import DONE, FAILED


def _logs(incomplete: str) -> list[str]:
    """The public logs that a shell offers."""
    from insenv.studies.proof import public_logs

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


# The command `insenv describe`: the description of a log that nobody has described.


@dataclass
class DescriptionOutput(Output):
    """Where the description goes, and the run of it.  Raises `InputError` for what cannot be written, before the work."""

    out: Annotated[
        Optional[Path],  # noqa: UP045
        out_option("LOG.toml", "Write the description to this file and run fusion on it; otherwise only print what is found."),
    ] = None
    run_out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--run-out",
            parser=nonempty_path,
            metavar="DIR",
            help="Write the run, its page and its figure there.",
        ),
    ] = None
    no_figure: Annotated[bool, typer.Option("--no-figure", help="With --run-out: write no figure and no page.")] = False
    no_run: Annotated[bool, typer.Option("--no-run", help="Do not run fusion on the described log.")] = False

    def __post_init__(self) -> None:
        self.folder = None
        self.written = None
        if self.out is not None:
            check_output_file(self.out, ".toml")
        if self.run_out is not None:
            if self.out is None or self.no_run:
                raise InputError("--run-out DIR keeps the run: allowed with -o LOG.toml and without --no-run")
            from insenv.report import OutputFolder

            self.folder = OutputFolder(self.run_out)


@command
def describe(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="The files of a log, or one folder.")],
    output: DescriptionOutput,
) -> int:
    """Find columns, units, axes, clock and lever arm of a log from its files; write its description and run fusion on it."""
    from insenv.cli.output import print_line
    from insenv.runs.replayed import replay
    from insenv.studies.describe import describe as describe_log
    from insenv.studies.describe.describing import document, write

    path = output.out
    next_step = "-o LOG.toml writes the description and runs fusion on it"
    with output.working(" ".join(files)) as progress:
        described = describe_log(
            [nonempty_path(file) for file in files],
            folder=Path() if path is None else path.parent,
            title="" if path is None else path.stem,
            progress=progress.describe,
        )
        report = None
        if path is not None:
            next_step = f"insenv replay {path} -e fusion --out DIR writes the page of the run"
            write(described, path)
        if path is not None and not output.no_run:
            progress.describe("fusion")
            try:
                report = replay(path, "fusion", progress=progress)
            except InsenvError as error:
                print_line(f"insenv: {path} is written, but fusion does not run on it: {error}", stderr=True)
                output.show(document(described, path), next_step)
                return FAILED
        if report is not None and output.folder is not None:
            from insenv.report import write_files

            output.written = write_files(report, output.folder, output.figure)
    output.show(document(described, path, report), next_step)
    return DONE
