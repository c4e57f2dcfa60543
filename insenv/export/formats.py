"""`write`: results and sensors in the formats of other tools; `to_dataframes`: the tables of a log."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.installing import need
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY, Result, Track, stated_sigma, track_of
from insenv.logs import RecordedLog
from insenv.logs.formats import WRITTEN
from insenv.logs.formats.contract import Columns, Drive, Files, NamedTrack
from insenv.logs.formats.log_tables import tables
from insenv.report.files import OutputFolder, file_name, write_contents
from insenv.report.notebook import data_frame
from insenv.report.run_data import RunData

if TYPE_CHECKING:
    from pandas import DataFrame

_TRACK = ("q_nb", "velocity_n", "latitude", "longitude", "height")


def check_formats(formats: Iterable[str]) -> tuple[str, ...]:
    """The names, each once.  Raises `InputError` for an unknown one, or one whose package is missing."""
    names = tuple(dict.fromkeys((formats,) if isinstance(formats, str) else formats))
    for name in names:
        if name not in WRITTEN:
            raise InputError(f"formats: unknown name {name!r}{nearest(str(name), WRITTEN)}")
        form = WRITTEN[name]
        if form.module:
            need(f"format {name!r}", form.module, package=form.package, extra=form.extra)
    return names


def needs_log(formats: Iterable[str]) -> bool:
    """Whether one of the formats needs the log of the sensors."""
    return any(WRITTEN[name].needs_log for name in formats)


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
    formats: "csv", "gpx", "kml" of a report; "log", "nmea" of a log; "bag", "mcap", "rerun" of a log and, if there is one, a
        report.
    log: the log of the same drive, beside a report: `record` makes that of a scenario.
    name: first part of the file names; None: the scenario's.

    Raises `InputError` for an unknown format, for one that needs an absent argument, for a package that is missing, or for a
    folder that cannot be written to; `InsenvError` if writing fails.
    """
    report = source if isinstance(source, RunData) else None
    log = source if isinstance(source, RecordedLog) else log
    if report is None and log is None:
        raise InputError(f"source = {source!r}: allowed is a Report or a RecordedLog")
    contents = contents_of(report, log, check_formats(formats), name)
    target = OutputFolder(folder)
    with target.staged() as part:
        write_contents(contents, part)
    return tuple(target.path / each for each in contents)


def contents_of(report: RunData | None, log: RecordedLog | None, formats: Iterable[str], name: str | None = None) -> Files:
    """The contents of all files of some formats, by name.  Raises `InputError` for a format that needs an absent argument."""
    title = report.scenario if report is not None else log.description.title if log is not None else ""
    drive = Drive(name if name is not None else file_name(title or "run"), log)
    if report is not None:
        tracks, results = _tracks(report), {result.estimator: _columns(report, result) for result in report.results}
        drive = Drive(drive.name, log, report.scenario, report.title, tracks, results)
    files: dict[str, str | bytes] = {}
    for format in formats:
        form = WRITTEN[format]
        for needed, present, what in ((form.needs_report, report, "a Report"), (form.needs_log, log, "a RecordedLog")):
            if needed and present is None:
                raise InputError(f"format {format!r} needs {what}")
        assert form.write is not None
        files |= form.write(drive)
    return files


def _tracks(report: RunData) -> tuple[NamedTrack, ...]:
    """The truth, or the reference, where it is known, then each estimate."""
    tracks = [_named("truth" if report.seed is not None else "reference", _known(report.truth), {})]
    for result in report.results:
        tracks.append(_named(result.estimator, track_of(result.time, result.outputs), stated_sigma(result.outputs)))
    return tuple(each for each in tracks if len(each.time) and (each.q_nb is not None or each.latitude is not None))


def _named(name: str, track: Track, sigma: Columns) -> NamedTrack:
    """sigma: standard deviations (n,) by channel; empty if none are stated."""

    def of(channels: tuple[str, ...]) -> Array | None:
        return np.stack([sigma[channel] for channel in channels], axis=1) if channels[0] in sigma else None

    place = (track.latitude, track.longitude, track.height)
    return NamedTrack(name, track.time, track.q_nb, track.velocity_n, *place, of(ATTITUDE), of(POSITION), of(VELOCITY))


def _known(track: Track) -> Track:
    """The rows in which all that the track has is known."""
    series = {name: value for name in _TRACK if (value := getattr(track, name)) is not None}
    if not series:
        return Track(track.time[:0])
    known = np.all([np.isfinite(value.reshape(len(value), -1)).all(axis=1) for value in series.values()], axis=0)
    return Track(track.time[known], **{name: value[known] for name, value in series.items()})


def _columns(report: RunData, result: Result) -> Columns:
    """All series of one estimator as columns (n,) by name: time_s, truth, estimate, errors, standard deviations, limit.

    Angles in degrees, positions in degrees and metres, velocities in m/s.
    """
    times = result.time
    columns: Columns = {"time_s": times}
    truth = Track(times, **report.truth.at(times))
    for prefix, track in (("truth", truth), ("estimate", track_of(times, result.outputs))):
        if track.q_nb is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(ATTITUDE, track.euler_deg().T, strict=True)}
        if track.latitude is not None and track.longitude is not None and track.height is not None:
            columns[f"{prefix}_latitude_deg"] = np.degrees(track.latitude)
            columns[f"{prefix}_longitude_deg"] = np.degrees(track.longitude)
            columns[f"{prefix}_height_m"] = track.height
        if track.velocity_n is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(VELOCITY, track.velocity_n.T, strict=True)}
    for prefix, series in (("error", result.errors), ("sigma", result.sigma), ("limit", result.limit_sigma)):
        columns |= {f"{prefix}_{name}": values for name, values in series.items()}
    return columns


def to_dataframes(log: RecordedLog) -> dict[str, DataFrame]:
    """The tables of a log by section (imu, gnss, the instruments, reference) as pandas DataFrames, indexed by time (s).

    The columns are those of the CSV files that `insenv.write` makes of a log.  Raises `InsenvError` if pandas is missing.
    """
    return {name: data_frame(columns.pop("time_s"), columns) for name, columns in tables(log).items()}
