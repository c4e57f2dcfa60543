"""Files of tracks: CSV by a description of its columns, GPX, NMEA, KML, logs and results of runs."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from insenv.attitude import numeric
from insenv.base.errors import InputError, nearest
from insenv.base.remarks import Remark, declared
from insenv.base.toml import Section, key, read_toml
from insenv.logs import RecordedLog, load
from insenv.logs.columns import AngleUnit
from insenv.logs.files import read_bytes
from insenv.logs.formats import TRACKS, is_flight_log
from insenv.logs.formats.contract import NamedTrack
from insenv.logs.formats.csv_table import Column, check_finite, read_table
from insenv.logs.units import ANGLE_UNITS, TIME_UNITS
from insenv.scenario.tracks.shape import Points


class Columns(Section):
    """Columns of a CSV file, by name or by number, counted from 0."""

    time: Column = key("time", "time")
    latitude: Column = key("latitude", "latitude")
    longitude: Column = key("longitude", "longitude")
    height: Column = key("height", "height above the ellipsoid")
    roll: Column | None = key(None, "roll; with pitch and heading, or none of them")
    pitch: Column | None = key(None, "pitch")
    heading: Column | None = key(None, "heading, clockwise from north")
    time_unit: Literal["s", "ms", "us", "ns", "min", "h"] = key("s", "unit of the time")
    position_unit: AngleUnit = key("deg", "unit of latitude and longitude")
    angle_unit: AngleUnit = key("deg", "unit of roll, pitch and heading")

    @model_validator(mode="after")
    def _one_attitude(self) -> Columns:
        angles = {name: getattr(self, name) for name in ("roll", "pitch", "heading")}
        missing = [name for name, column in angles.items() if column is None]
        if 0 < len(missing) < 3:
            raise ValueError(
                f"no {' and no '.join(missing)}: allowed are columns of roll, pitch and heading, or of none of them"
            )
        return self


def formats() -> str:
    """The suffixes of the files that can be read."""
    return ", ".join(sorted([*_READERS, *TRACKS])) + ", or a flight log"


def points_of(path: Path, columns: Columns, height_offset_m: float = 0.0, track: Column | None = None) -> Points:
    """The points of a file.  track: the one that is taken of several, by name or number from 0; None: the first.

    Raises `InputError` for a file that cannot be read, and for a track that is not in it.
    """
    suffix = path.suffix.lower()
    form, reader = TRACKS.get(suffix), _READERS.get(suffix, _log if is_flight_log(path) else None)
    if form is None and reader is None:
        raise InputError(f"{path}: allowed is {formats()}")
    if track is not None and (form is None or not form.several):
        several = " and ".join(end for end, each in TRACKS.items() if each.several)
        raise InputError(f"vehicle.track = {track!r}: allowed with {several}, not with {path}")
    try:
        if form is not None and form.read_tracks is not None:
            points = _chosen(path, form.read_tracks(str(path), path.read_bytes()), track)
        else:
            assert reader is not None
            points = reader(path, columns)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return replace(points, height=points.height + height_offset_m)


_SEVERAL_TRACKS = declared(
    "several-tracks", "{file} has the tracks {tracks}: the first is taken; vehicle.track chooses another"
)
_NO_HEIGHTS = declared("track-without-heights", "{file} has no heights: the track is at height_offset_m above the ellipsoid")


def _chosen(path: Path, tracks: Sequence[NamedTrack], track: Column | None) -> Points:
    """The points of one of the named tracks of a file, with a note if it is one of several and not chosen."""
    names = [each.name for each in tracks]
    listed = ", ".join(map(repr, names))
    if isinstance(track, int):
        if not 0 <= track < len(tracks):
            raise InputError(f"vehicle.track = {track}: {path} has the tracks {listed}, numbered from 0")
        return _points(path, tracks[track])
    if track is not None:
        if names.count(track) > 1:
            raise InputError(
                f"vehicle.track = {track!r}: {names.count(track)} tracks of {path} have this name: number it from 0"
            )
        if track not in names:
            raise InputError(f"vehicle.track = {track!r}: no such track in {path}{nearest(track, names)}")
        return _points(path, tracks[names.index(track)])
    points = _points(path, tracks[0])
    if len(tracks) == 1:
        return points
    return replace(points, notes=(_SEVERAL_TRACKS.filled(file=path.name, tracks=listed), *points.notes))


def _points(path: Path, track: NamedTrack) -> Points:
    """The points of a track; their heights are 0, with a note, if none has one.  Raises `InputError` if some have none."""
    assert track.place is not None
    latitude, longitude, height = track.place
    unknown = np.flatnonzero(np.isnan(height))
    if 0 < len(unknown) < len(height):
        raise InputError(
            f"{path}: point {unknown[0] + 1} has no height, others have one: allowed are heights of all or of none"
        )
    if not len(unknown):
        return Points(str(path), track.time, latitude, longitude, height)
    notes = (_NO_HEIGHTS.filled(file=path.name),)
    return Points(str(path), track.time, latitude, longitude, np.zeros(len(height)), notes=notes)


def _csv(path: Path, columns: Columns) -> Points:
    attitude = [each for each in (columns.roll, columns.pitch, columns.heading) if each is not None]
    place = [columns.latitude, columns.longitude, columns.height]
    table = read_table(str(path), path.read_bytes(), [columns.time, *place, *attitude])
    check_finite(table, ())
    degrees, turned = ANGLE_UNITS[columns.position_unit], ANGLE_UNITS[columns.angle_unit]
    return Points(
        str(path),
        table.column(columns.time) * TIME_UNITS[columns.time_unit],
        table.column(columns.latitude) * degrees,
        table.column(columns.longitude) * degrees,
        table.column(columns.height),
        table.columns(attitude) * turned if attitude else None,
    )


def _log(path: Path, columns: Columns) -> Points:
    """The reference of a log, with its attitude if it has one, or else its fixes."""
    log = load(path)
    known, attitude = log.reference, None
    if known is not None and known.latitude is not None and known.longitude is not None and known.height is not None:
        if known.roll is not None and known.pitch is not None and known.heading is not None:
            attitude = np.column_stack([known.roll, known.pitch, known.heading])
        place = (known.latitude, known.longitude, known.height)
        return Points(str(path), known.time, *place, attitude, notes=_notes(log, "reference"))
    if log.gnss is None:
        raise InputError(f"{path}: the log has neither a reference with positions nor fixes, and so no track")
    fixes = log.gnss
    return Points(str(path), fixes.time, fixes.latitude, fixes.longitude, fixes.height, notes=_notes(log, "gnss"))


def _notes(log: RecordedLog, section: str) -> tuple[Remark, ...]:
    """What the log notes on the table that is the track, as rows that are left out."""
    begins = (f"{section}:", *(f"{source.file}:" for source in log.sources if source.section == section))
    return tuple(note for note in log.notes if note.startswith(begins))


def _run(path: Path, columns: Columns) -> Points:
    """The truth of the result file of a run."""
    names = ("time", "latitude", "longitude", "height", "q_nb")
    try:
        with np.load(path, allow_pickle=False) as arrays:
            time, latitude, longitude, height, q_nb = (arrays[f"truth/{name}"] for name in names)
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: not the result of a run with its truth: {error}") from None
    unknown = np.flatnonzero(~np.all(np.isfinite(np.column_stack([latitude, longitude, height, q_nb])), axis=1))
    if unknown.size:
        raise InputError(
            f"{path}: no true position and attitude at point {unknown[0] + 1}: a replay has no truth, only what its log's "
            "reference covers; allowed is the result of a simulated run, or the log itself"
        )
    attitude = np.column_stack(numeric.to_euler(q_nb))
    return Points(str(path), time, latitude, longitude, height, attitude)


_READERS = {".csv": _csv, ".txt": _csv, ".npz": _run, ".toml": _log}
"""The readers of files that hold one track; those of other formats: `insenv.logs.formats.TRACKS`."""


# The fingerprint of the file of a track, which changes with whatever the track is read from.


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, of the contents of an archive, or of a description of a log and the files that it names.

    Raises `InputError` for a file that cannot be read; a file that a description names is left to the reader of the log.
    """
    digest = hashlib.sha256(read_bytes(str(path), Path())[1])
    if path.suffix.lower() == ".toml":
        for file in _files_of(read_toml(path)):
            with suppress(InputError):
                digest.update(hashlib.sha256(read_bytes(file, path.resolve().parent)[1]).digest())
    return digest.hexdigest()


def _files_of(data: Mapping[str, Any]) -> Iterator[str]:
    """The files that a description of a log names."""
    for name, value in data.items():
        files = value.get("file") if isinstance(value, Mapping) else value if name == "flight" else None
        for file in files if isinstance(files, list) else [files]:
            if isinstance(file, str) and file:
                yield file
