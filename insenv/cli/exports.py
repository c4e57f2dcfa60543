"""Options of `insenv run` and `insenv replay` that write results and sensors in the formats of other tools."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insenv.base.errors import InputError

if TYPE_CHECKING:
    from insenv.export.formats import Files
    from insenv.logs import RecordedLog
    from insenv.report import Report

OPTIONS = {
    "csv": "write truth, estimate, errors and sigma as CSV.",
    "gpx": "write truth and estimates as a GPX file.",
    "kml": "write truth and estimates as a KML file.",
    "bag": "write sensors, truth and estimates as a ROS 2 bag.",
    "mcap": "write the same messages as an MCAP recording.",
    "rerun": "write them as a recording for the Rerun viewer.",
    "nmea": "write the fixes of the receiver as NMEA 0183.",
    "log": "write the sensors as a log that `insenv replay` reads.",
}
"""Formats by name, each an option --NAME, and what it writes."""


def with_formats(command: Callable[..., int]) -> Callable[..., int]:
    """The command with an option for each format in place of its parameter `formats`, which gets the names asked for."""
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        if parameter.name != "formats":
            parameters.append(parameter)
            continue
        for name, writes in OPTIONS.items():
            option = Annotated[bool, typer.Option(f"--{name}", help=f"With --out: {writes}")]
            parameters.append(parameter.replace(name=_PREFIX + name, default=False, annotation=option))

    @functools.wraps(command)
    def chosen(**given: Any) -> int:
        formats = tuple(name for name in OPTIONS if given.pop(_PREFIX + name))
        return command(**given, formats=formats)

    chosen.__signature__ = inspect.Signature(parameters, return_annotation=int)  # type: ignore[attr-defined]
    chosen.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return chosen


_PREFIX = "as_"
"""Before the name of a format, that of its parameter: `insenv replay` has an argument ``log``."""


def check_asked(out: Path | None, chosen: Sequence[str]) -> tuple[str, ...]:
    """The formats asked for.  Raises `InputError` if there is no folder for them, or a package is missing."""
    if not chosen:  # without the import of all formats
        return ()
    from insenv.export import check_formats

    if out is None:
        raise InputError(f"--{chosen[0]} writes files: --out DIR names their folder")
    return check_formats(chosen)


def exported(report: Report, formats: tuple[str, ...], log: Callable[[], RecordedLog]) -> Files:
    """The files of the formats by name.  log: the log of the same drive, made only if a format needs it."""
    if not formats:
        return {}
    from insenv.export.formats import Given, contents_of, needs_log
    from insenv.report.files import file_name

    given = Given(report, log() if needs_log(formats) else None, file_name(report.scenario))
    return contents_of(given, formats)
