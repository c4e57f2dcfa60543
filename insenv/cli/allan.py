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
    from insenv.cli.output import print_json, print_line, print_parts, working
    from insenv.report import OutputFolder
    from insenv.workbench.allan import allan as measure
    from insenv.workbench.allan_report import check_grade, document, tables, write_files, write_grade

    check_grade(grade)
    folder = None if out is None else OutputFolder(out)
    with working(log.name) as progress:
        found = measure(log, from_s=begin, to_s=end, progress=progress)
        if grade is not None:
            write_grade(found, grade)
        written = None if folder is None else write_files(found, folder, grade, not no_figure)
    files = [str(path) for path in written.paths] if written else []
    if written and written.note:
        print_line(f"insenv: {written.note}", stderr=True)
    if as_json:
        at = None if grade is None else str(grade)
        print_json(document(found, at or (files[1] if files else None), files))
        return
    print_parts(tables(found))
    print_line()
    if grade is not None:
        print_line(f'written to {grade}: grade = "{grade.name}" in [imu] of a scenario or a log is this unit')
    if written:
        print_line(f"written to {written.paths[0].parent}: {', '.join(path.name for path in written.paths)}")
    if grade is None and not written:
        print_line("--grade FILE.toml writes the grade of this unit, --out DIR the figure too")
