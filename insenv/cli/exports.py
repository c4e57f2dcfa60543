"""Options of `insenv run` and `insenv replay` that write results and sensors in the formats of other tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insenv.errors import InputError

if TYPE_CHECKING:
    from insenv.export.formats import Files
    from insenv.logs import RecordedLog
    from insenv.report import Report

Csv = Annotated[bool, typer.Option("--csv", help="With --out: write truth, estimate, errors and sigma as CSV.")]
Gpx = Annotated[bool, typer.Option("--gpx", help="With --out: write truth and estimates as a GPX file.")]
Kml = Annotated[bool, typer.Option("--kml", help="With --out: write truth and estimates as a KML file.")]
Bag = Annotated[bool, typer.Option("--bag", help="With --out: write sensors, truth and estimates as a ROS 2 bag.")]
Mcap = Annotated[bool, typer.Option("--mcap", help="With --out: write the same messages as an MCAP recording.")]
Rerun = Annotated[bool, typer.Option("--rerun", help="With --out: write them as a recording for the Rerun viewer.")]
Nmea = Annotated[bool, typer.Option("--nmea", help="With --out: write the fixes of the receiver as NMEA 0183.")]
Log = Annotated[bool, typer.Option("--log", help="With --out: write the sensors as a log that `insenv replay` reads.")]


def chosen_formats(out: Path | None, flags: Mapping[str, bool]) -> tuple[str, ...]:
    """The names of the formats asked for.  Raises `InputError` if there is no folder for them, or a package is missing."""
    from insenv.export import check_formats

    chosen = tuple(name for name, given in flags.items() if given)
    if chosen and out is None:
        raise InputError(f"--{chosen[0]} writes files: --out DIR names their folder")
    return check_formats(chosen)


def exported(report: Report, formats: tuple[str, ...], log: Callable[[], RecordedLog]) -> Files:
    """The files of the formats by name.  log: the log of the same drive, made only if a format needs it."""
    from insenv.export.formats import Given, contents_of, needs_log
    from insenv.report.files import file_name

    given = Given(report, log() if needs_log(formats) else None, file_name(report.scenario))
    return contents_of(given, formats)
