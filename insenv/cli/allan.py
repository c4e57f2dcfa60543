"""The command `insenv allan`: what is my unit?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.cli.options import Json, NoFigure, Out, deferred, given_path


@deferred
def allan(
    log: Annotated[
        Path, typer.Argument(parser=given_path, metavar="LOG", help="A flight log, or a .toml file that describes a log.")
    ],
    begin: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option("--from", metavar="S", help="Begin of the part to use; without it and --to the longest rest."),
    ] = None,
    end: Annotated[Optional[float], typer.Option("--to", metavar="S", help="End of the part to use.")] = None,  # noqa: UP045
    grade: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(parser=given_path, metavar="FILE.toml", help='Write the grade file, for grade = "FILE.toml".'),
    ] = None,
    out: Out = None,
    no_figure: NoFigure = False,
    as_json: Json = False,
) -> None:
    """Measure the noise of a log's inertial unit by its Allan deviation; write a grade file."""
    from insenv.cli.output import print_result, working
    from insenv.report import OutputFolder
    from insenv.studies.allan import allan as measure
    from insenv.studies.allan_result import assumed, check_grade, document, write_files, write_grade

    check_grade(grade)
    folder = None if out is None else OutputFolder(out)
    with working(log.name) as progress:
        found = measure(log, from_s=begin, to_s=end, progress=progress)
        if grade is not None:
            write_grade(found, grade)
        written = None if folder is None else write_files(found, folder, grade, not no_figure)
    at = grade if grade is not None or written is None else written.paths[1]
    told = [] if grade is None else [f'written to {grade}: grade = "{grade.name}" in [imu] of a scenario or a log is this unit']
    told += [assumed(found)] if at is not None else []
    unwritten = "" if grade is not None else "--grade FILE.toml writes the grade of this unit, --out DIR the figure too"
    print_result(document(found, None if at is None else str(at)), written, as_json, unwritten, told)
