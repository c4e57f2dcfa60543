"""The formats in which results and sensors are written, and `write`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from insenv.base.errors import InputError, nearest
from insenv.base.installing import need
from insenv.export import geo, rerun_recording, ros, text_log
from insenv.export.log_tables import csv_text
from insenv.export.tracks import columns_of
from insenv.logs import RecordedLog
from insenv.report.files import OutputFolder, file_name, write_contents
from insenv.report.run_data import RunData

Files = Mapping[str, "str | bytes"]
"""Contents by name; a name may have one folder in it."""


@dataclass(frozen=True)
class Given:
    """What is written: the report of a run, or None; the log of its sensors, or None; the first part of all file names."""

    report: RunData | None
    log: RecordedLog | None
    name: str


@dataclass(frozen=True)
class Format:
    """A format: its title, the function that gives its files, and whether that needs the report and the log.

    module, package, extra: what is imported to write it, its package, if that is another, and the extra of insenv that
    installs this; empty: none.
    """

    title: str
    files: Callable[[Given], Files]
    report: bool = True
    log: bool = False
    module: str = ""
    extra: str = ""
    package: str = ""


def _csv(given: Given) -> Files:
    assert given.report is not None
    return {
        f"{given.name}-{result.estimator}.csv": csv_text(columns_of(given.report, result)) for result in given.report.results
    }


def _gpx(given: Given) -> Files:
    assert given.report is not None
    return {f"{given.name}.gpx": geo.gpx_text(given.report)}


def _kml(given: Given) -> Files:
    assert given.report is not None
    return {f"{given.name}.kml": geo.kml_text(given.report)}


def _bag(given: Given) -> Files:
    return ros.bag(given.report, given.log, given.name, mcap=False)


def _mcap(given: Given) -> Files:
    return ros.bag(given.report, given.log, given.name, mcap=True)


def _rerun(given: Given) -> Files:
    return rerun_recording.recording(given.report, given.log, given.name)


def _nmea(given: Given) -> Files:
    assert given.log is not None
    return {f"{given.name}.nmea": geo.nmea_text(given.log)}


def _log(given: Given) -> Files:
    assert given.log is not None
    return text_log.texts(given.log, f"{given.name}-log")


FORMATS: Mapping[str, Format] = {
    "csv": Format("truth, estimate, errors, sigma and limit as a CSV file for each estimator", _csv),
    "gpx": Format("truth and estimates as tracks of a GPX file", _gpx, module="gpxpy", extra="workbench"),
    "kml": Format("truth and estimates as tracks of a KML file, with their attitude", _kml),
    "bag": Format("sensors, truth and estimates as a ROS 2 bag", _bag, False, True, "rosbags", "view"),
    "mcap": Format("the same messages as an MCAP recording", _mcap, False, True, "rosbags", "view"),
    "rerun": Format(
        "the same as a recording for the Rerun viewer, with errors, sigma and limit",
        _rerun,
        False,
        True,
        module="rerun",
        package="rerun-sdk",
        extra="view",
    ),
    "nmea": Format("the fixes of the receiver as NMEA 0183", _nmea, False, True),
    "log": Format("the sensors as a log that `insenv replay` reads: CSV files and their description", _log, False, True),
}
"""Formats by name."""


def check_formats(formats: Iterable[str]) -> tuple[str, ...]:
    """The names, each once.  Raises `InputError` for an unknown one, or one whose package is missing."""
    if isinstance(formats, str):
        formats = (formats,)
    found = tuple(dict.fromkeys(formats))
    for name in found:
        if name not in FORMATS:
            raise InputError(f"formats: unknown name {name!r}{nearest(str(name), FORMATS)}")
        if FORMATS[name].module:
            need(f"format {name!r}", FORMATS[name].module, package=FORMATS[name].package, extra=FORMATS[name].extra)
    return found


def needs_log(formats: Iterable[str]) -> bool:
    """Whether one of the formats needs the log of the sensors."""
    return any(FORMATS[name].log for name in formats)


def write(
    source: RunData | RecordedLog,
    folder: str | Path,
    formats: Iterable[str],
    *,
    log: RecordedLog | None = None,
    name: str | None = None,
) -> tuple[Path, ...]:
    """Write the results of a run, the log of a drive, or both, in the formats of other tools; return the paths.

    Parameters
    ----------
    source: the `Report` of a run or a replay, or a `RecordedLog`.
    folder: it is made if it does not exist.  All files are written, or none.
    formats: names of `FORMATS`: "csv", "gpx", "kml" of a report; "log", "nmea" of a log; "bag", "mcap", "rerun" of a log and,
        if there is one, a report.
    log: the log of the same drive, beside a report: `record` makes that of a scenario.
    name: first part of the file names; None: the scenario's.

    Raises `InputError` for an unknown format, for one that needs what is not given, for a package that is missing, or for a
    folder that cannot be written to; `InsenvError` if writing fails.
    """
    report = source if isinstance(source, RunData) else None
    log = source if isinstance(source, RecordedLog) else log
    if report is None and log is None:
        raise InputError(f"source = {source!r}: allowed is a Report or a RecordedLog")
    chosen = check_formats(formats)
    title = report.scenario if report is not None else log.description.title if log is not None else ""
    given = Given(report, log, name if name is not None else file_name(title or "run"))
    contents = contents_of(given, chosen)
    target = OutputFolder(folder)
    with target.staged() as part:
        write_contents(contents, part)
    return tuple(target.path / each for each in contents)


def contents_of(given: Given, formats: Iterable[str]) -> Files:
    """The contents of all files of some formats, by name.  Raises `InputError` for a format that needs what is not given."""
    files: dict[str, str | bytes] = {}
    for name in formats:
        form = FORMATS[name]
        for needed, there, what in ((form.report, given.report, "a Report"), (form.log, given.log, "a RecordedLog")):
            if needed and there is None:
                raise InputError(f"format {name!r} needs {what}")
        files |= form.files(given)
    return files
