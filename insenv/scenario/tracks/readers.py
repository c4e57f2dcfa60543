"""Files of tracks: CSV by a description of its columns, GPX, NMEA, KML, logs and results of runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import model_validator

from insenv.attitude import numeric
from insenv.base.errors import InputError, nearest
from insenv.base.installing import need
from insenv.base.toml import Section, key, read_toml
from insenv.scenario.tracks.points import Points

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

    from insenv.logs import RecordedLog


Column = str | int
Rows = list[tuple[float, float, float, float]]
"""Time s, latitude deg, longitude deg, height m or NaN."""


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
    position_unit: Literal["deg", "rad"] = key("deg", "unit of latitude and longitude")
    angle_unit: Literal["deg", "rad"] = key("deg", "unit of roll, pitch and heading")

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
    return ", ".join(sorted([*_READERS, *_WITH_TRACKS])) + ", or a flight log"


def points_of(path: Path, columns: Columns, height_offset_m: float = 0.0, track: Column | None = None) -> Points:
    """The points of a file.  track: the one that is taken of several, by name or number from 0; None: the first.

    Raises `InputError` for a file that cannot be read, and for a track that is not in it.
    """
    from insenv.logs.flight import is_flight_log

    suffix = path.suffix.lower()
    reader = _READERS.get(suffix)
    if reader is None and is_flight_log(path):
        reader = _log
    if reader is None and suffix not in _WITH_TRACKS:
        raise InputError(f"{path}: allowed is {formats()}")
    if reader is not None and track is not None:
        raise InputError(f"vehicle.track = {track!r}: allowed with {' and '.join(_WITH_TRACKS)}, not with {path}")
    try:
        found = _chosen(path, _WITH_TRACKS[suffix](path), track) if reader is None else reader(path, columns)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return replace(found, height=found.height + height_offset_m)


def _chosen(path: Path, tracks: Sequence[tuple[str, Rows]], track: Column | None) -> Points:
    """The points of one of the named tracks of a file, with a note if it is one of several and not chosen."""
    names = [name for name, _ in tracks]
    shown = ", ".join(map(repr, names))
    if isinstance(track, int):
        if not 0 <= track < len(tracks):
            raise InputError(f"vehicle.track = {track}: {path} has the tracks {shown}, numbered from 0")
        return _points(path, tracks[track][1])
    if track is not None:
        if names.count(track) > 1:
            raise InputError(
                f"vehicle.track = {track!r}: {names.count(track)} tracks of {path} have this name: number it from 0"
            )
        if track not in names:
            raise InputError(f"vehicle.track = {track!r}: no such track in {path}{nearest(track, names)}")
        return _points(path, tracks[names.index(track)][1])
    points = _points(path, tracks[0][1])
    if len(tracks) == 1:
        return points
    note = f"{path.name} has the tracks {shown}: the first is taken; vehicle.track chooses another"
    return replace(points, notes=(note, *points.notes))


def _csv(path: Path, columns: Columns) -> Points:
    from insenv.logs.readers import check_finite, read_table
    from insenv.logs.units import ANGLE_UNITS, TIME_UNITS

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


def _points(path: Path, rows: Rows) -> Points:
    """Points from rows; their heights are 0, with a note, if none has one.  Raises `InputError` if some have none."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 4)
    notes: tuple[str, ...] = ()
    unknown = np.flatnonzero(np.isnan(values[:, 3]))
    if 0 < len(unknown) < len(values):
        raise InputError(
            f"{path}: point {unknown[0] + 1} has no height, others have one: allowed are heights of all or of none"
        )
    if len(unknown):
        values[:, 3] = 0.0
        notes = (f"{path.name} has no heights: the track is at height_offset_m above the ellipsoid",)
    return Points(str(path), values[:, 0], np.radians(values[:, 1]), np.radians(values[:, 2]), values[:, 3], notes=notes)


def _height(given: float | None) -> float:
    return float("nan") if given is None else float(given)


def _gpx(path: Path) -> list[tuple[str, Rows]]:
    """The tracks with points; the segments of a track follow each other."""
    need(f"{path}: a GPX file", "gpxpy", extra="workbench")
    import gpxpy

    try:
        found = gpxpy.parse(path.read_text(encoding="utf-8-sig"))
    except (gpxpy.gpx.GPXException, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no GPX file: {error}") from None
    tracks = []
    for track in found.tracks:
        rows = []
        for number, (point, _, _) in enumerate(track.walk(), 1):
            if point.time is None:
                raise InputError(f"{path}: point {number} has no time: a planned route is no recorded track")
            rows.append((point.time.timestamp(), point.latitude, point.longitude, _height(point.elevation)))
        if rows:
            tracks.append((track.name or "", rows))
    if not tracks:
        raise InputError(f"{path}: no track with points")
    return tracks


def _nmea(path: Path, columns: Columns) -> Points:
    """Fixes of the sentences GGA, whose heights are above mean sea level and of the geoid; days follow from midnights."""
    need(f"{path}: an NMEA file", "pynmea2", extra="workbench")
    import pynmea2

    rows: Rows = []
    wrong, day = "", 0.0
    for number, line in enumerate(path.read_text(encoding="ascii", errors="replace").splitlines(), 1):
        start = line.find("$")
        if start < 0 or line[start + 3 : start + 6] != "GGA":
            continue
        try:
            fix = pynmea2.parse(line[start:], check=True)
        except (pynmea2.ParseError, ValueError) as error:
            wrong = wrong or f"{path}: line {number}: {error}"
            continue
        if not fix.gps_qual or fix.timestamp is None or not fix.lat or not fix.lon:
            continue
        stamp = fix.timestamp
        time = stamp.hour * 3600.0 + stamp.minute * 60.0 + stamp.second + stamp.microsecond * 1e-6 + day
        if rows and time < rows[-1][0] - 43200.0:
            day, time = day + 86400.0, time + 86400.0
        height = _height(fix.altitude) + float(fix.geo_sep or 0.0)
        rows.append((time, fix.latitude, fix.longitude, height))
    if wrong:
        raise InputError(wrong)
    if not rows:
        raise InputError(f"{path}: no sentence GGA with a fix")
    return _points(path, rows)


def _kml(path: Path) -> list[tuple[str, Rows]]:
    """The placemarks with a gx:Track, pairs of when and gx:coord; a LineString has no times and is no recorded track."""
    from xml.etree.ElementTree import ParseError, fromstring

    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise InputError(f"{path}: declares a document type: allowed is plain KML")
    try:
        root = fromstring(text)
    except ParseError as error:
        raise InputError(f"{path}: no KML file: {error}") from None
    tracks = []
    for mark in [each for each in root.iter() if each.tag.endswith("}Placemark")]:
        name = next((each.text for each in mark if each.tag.endswith("}name")), None)
        rows = [row for track in mark.iter() if track.tag.endswith("}Track") for row in _kml_rows(path, track)]
        if rows:
            tracks.append((name or "", rows))
    if not tracks:
        raise InputError(f"{path}: no gx:Track in a Placemark: only points with times are a recorded track")
    return tracks


def _kml_rows(path: Path, track: Element) -> Rows:
    """The points of a gx:Track."""
    times = [each.text or "" for each in track if each.tag.endswith("}when")]
    places = [(each.text or "").split() for each in track if each.tag.endswith("}coord")]
    if len(times) != len(places):
        raise InputError(f"{path}: {len(times)} times for {len(places)} places: allowed is one for each")
    rows = []
    for number, (stamp, place) in enumerate(zip(times, places, strict=True), 1):
        try:
            moment = datetime.fromisoformat(stamp.strip().replace("Z", "+00:00"))
            longitude, latitude, height = (float(part) for part in (*place, "nan")[:3])
        except ValueError:
            raise InputError(
                f"{path}: point {number}: {stamp!r} at {place!r}: allowed is a time and two or three numbers"
            ) from None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)
        rows.append((moment.timestamp(), latitude, longitude, height))
    return rows


def _log(path: Path, columns: Columns) -> Points:
    """The reference of a log, with its attitude if it has one, or else its fixes."""
    from insenv.logs import load

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


def _notes(log: RecordedLog, section: str) -> tuple[str, ...]:
    """What the log notes on the table that is the track, as rows that are left out."""
    begins = (f"{section}:", *(f"{source.file}:" for source in log.sources if source.section == section))
    return tuple(note for note in log.notes if note.startswith(begins))


def _run(path: Path, columns: Columns) -> Points:
    """The truth of the result file of a run."""
    names = ("time", "latitude", "longitude", "height", "q_nb")
    try:
        with np.load(path, allow_pickle=False) as found:
            time, latitude, longitude, height, q_nb = (found[f"truth/{name}"] for name in names)
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: no result of a run with its truth: {error}") from None
    unknown = np.flatnonzero(~np.all(np.isfinite(np.column_stack([latitude, longitude, height, q_nb])), axis=1))
    if unknown.size:
        raise InputError(
            f"{path}: no true position and attitude at point {unknown[0] + 1}: a replay has no truth, only what its log's "
            "reference covers; allowed is the result of a simulated run, or the log itself"
        )
    attitude = np.column_stack(numeric.to_euler(q_nb))
    return Points(str(path), time, latitude, longitude, height, attitude)


_READERS: dict[str, Callable[[Path, Columns], Points]] = {
    ".csv": _csv,
    ".txt": _csv,
    ".nmea": _nmea,
    ".npz": _run,
    ".toml": _log,
}
_WITH_TRACKS: dict[str, Callable[[Path], list[tuple[str, Rows]]]] = {".gpx": _gpx, ".kml": _kml}
"""Files that may hold several tracks: the readers of all, by name."""


# The fingerprint of the file of a track, which changes with whatever the track is read from.


def fingerprint(path: Path) -> str:
    """SHA-256 of a file, of the contents of an archive, or of a description of a log and the files that it names.

    Raises `InputError` for a file that cannot be read; a file that a description names is left to the reader of the log.
    """
    from insenv.logs.readers import read_bytes  # which needs scenarios

    digest = hashlib.sha256(read_bytes(str(path), Path())[1])
    if path.suffix.lower() == ".toml":
        for file in _files_of(read_toml(path)):
            with suppress(InputError):
                digest.update(hashlib.sha256(read_bytes(file, path.resolve().parent)[1]).digest())
    return digest.hexdigest()


def _files_of(data: Mapping[str, Any]) -> Iterator[str]:
    """The files that a description of a log names."""
    for name, value in data.items():
        found = value.get("file") if isinstance(value, Mapping) else value if name == "flight" else None
        for file in found if isinstance(found, list) else [found]:
            if isinstance(file, str) and file:
                yield file
