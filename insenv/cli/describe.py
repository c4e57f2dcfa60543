"""The command `insenv describe`: the description of a log that nobody has described."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.base.errors import InputError, InsenvError
from insenv.cli.options import Output, command, given_path
from insenv.cli.signals import DONE, FAILED


@dataclass
class PageOutput(Output):
    """Where the run goes; -o is the description."""

    out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--out", parser=given_path, metavar="DIR", help="Write the run, its page and its figure there, as of insenv replay."
        ),
    ] = None


@command
def describe(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="The text files of a log, or one folder.")],
    output: PageOutput,
    description: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--output",
            "-o",
            parser=given_path,
            metavar="LOG.toml",
            help="The description to write; without it nothing is written or run.",
        ),
    ] = None,
    no_run: Annotated[bool, typer.Option("--no-run", help="Do not run fusion on the described log.")] = False,
) -> int:
    """Find columns, units, axes, clock and lever arm of a log from its files; write its description and run fusion on it."""
    from insenv.cli.output import print_line
    from insenv.runs.replayed import replay
    from insenv.studies.describe import describe as describe_log
    from insenv.studies.describe.described import document, write

    if output.out is not None and (description is None or no_run):
        raise InputError("--out DIR keeps the run: allowed with -o LOG.toml and without --no-run")
    paths = [given_path(file) for file in files]
    folder = Path() if description is None else description.parent
    with output.working(" ".join(files)) as progress:
        described = describe_log(
            paths, folder=folder, title="" if description is None else description.stem, progress=progress.describe
        )
        if description is None:
            report = None
        else:
            write(described, description)
            report = None
            if not no_run:
                progress.describe("fusion")
                try:
                    report = replay(description, "fusion", progress=progress)
                except InsenvError as error:
                    print_line(f"insenv: {description} is written, but fusion does not run on it: {error}", stderr=True)
                    output.show(document(described, description), "")
                    return FAILED
                if output.folder is not None:
                    from insenv.report import write_files

                    output.written = write_files(report, output.folder, output.figure)
    next_step = "-o LOG.toml writes the description and runs fusion on it"
    if description is not None:
        next_step = f"insenv replay {description} -e fusion --out DIR writes the page of the run"
    output.show(document(described, description, report), next_step)
    return DONE
