"""Files of tracks: CSV by a description of its columns, GPX, NMEA, KML, logs and results of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Literal

import numpy as np

from insenv.attitude.numeric import to_euler
from insenv.errors import InputError
from insenv.files.toml import Section, key
from insenv.installing import need
from insenv.tracks.points import Points

Column = str | int
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}


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


def formats() -> str:
    """The suffixes of the files that can be read."""
    return ", ".join(sorted(_READERS)) + ", or a flight log"


def points_of(path: Path, columns: Columns, height_offset_m: float = 0.0) -> Points:
    """The points of a file.  Raises `InputError` for a file that cannot be read."""
    from insenv.logs.flight import is_flight_log

    reader = _READERS.get(path.suffix.lower())
    if reader is None and is_flight_log(path):
        reader = _log
    if reader is None:
        raise InputError(f"{path}: allowed is {formats()}")
    try:
        found = reader(path, columns)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return replace(found, height=found.height + height_offset_m)


def _csv(path: Path, columns: Columns) -> Points:
    from insenv.logs.readers import check_finite, read_table

    attitude = [each for each in (columns.roll, columns.pitch, columns.heading) if each is not None]
    if len(attitude) not in (0, 3):
        raise InputError(f"{path}: columns of {len(attitude)} angles: allowed are roll, pitch and heading, or none of them")
    place = [columns.latitude, columns.longitude, columns.height]
    table = read_table(str(path), path.read_bytes(), [columns.time, *place, *attitude])
    check_finite(table, ())
    degrees = np.pi / 180.0 if columns.position_unit == "deg" else 1.0
    turned = np.pi / 180.0 if columns.angle_unit == "deg" else 1.0
    return Points(
        str(path),
        table.column(columns.time) * _TIMES[columns.time_unit],
        table.column(columns.latitude) * degrees,
        table.column(columns.longitude) * degrees,
        table.column(columns.height),
        table.columns(attitude) * turned if attitude else None,
    )


def _points(path: Path, rows: list[tuple[float, float, float, float]]) -> Points:
    """Points from rows of time s, latitude deg, longitude deg, height m."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Points(str(path), values[:, 0], np.radians(values[:, 1]), np.radians(values[:, 2]), values[:, 3])


def _gpx(path: Path, columns: Columns) -> Points:
    need(f"{path}: a GPX file", "gpxpy", extra="workbench")
    import gpxpy

    try:
        found = gpxpy.parse(path.read_text(encoding="utf-8-sig"))
    except (gpxpy.gpx.GPXException, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no GPX file: {error}") from None
    rows = []
    for number, (point, _, _, _) in enumerate(found.walk(), 1):
        if point.time is None:
            raise InputError(f"{path}: point {number} has no time: a planned route is no recorded track")
        rows.append((point.time.timestamp(), point.latitude, point.longitude, point.elevation or 0.0))
    return _points(path, rows)


def _nmea(path: Path, columns: Columns) -> Points:
    """Fixes of the sentences GGA, whose heights are above mean sea level and of the geoid; days follow from midnights."""
    need(f"{path}: an NMEA file", "pynmea2", extra="workbench")
    import pynmea2

    rows: list[tuple[float, float, float, float]] = []
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
        height = float(fix.altitude or 0.0) + float(fix.geo_sep or 0.0)
        rows.append((time, fix.latitude, fix.longitude, height))
    if wrong:
        raise InputError(wrong)
    if not rows:
        raise InputError(f"{path}: no sentence GGA with a fix")
    return _points(path, rows)


def _kml(path: Path, columns: Columns) -> Points:
    """The first gx:Track, pairs of when and gx:coord; a LineString has no times and is no recorded track."""
    from xml.etree.ElementTree import ParseError, fromstring

    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise InputError(f"{path}: declares a document type: allowed is plain KML")
    try:
        root = fromstring(text)
    except ParseError as error:
        raise InputError(f"{path}: no KML file: {error}") from None
    track = next((each for each in root.iter() if each.tag.endswith("}Track")), None)
    if track is None:
        raise InputError(f"{path}: no gx:Track: only points with times are a recorded track")
    times = [each.text or "" for each in track if each.tag.endswith("}when")]
    places = [(each.text or "").split() for each in track if each.tag.endswith("}coord")]
    if len(times) != len(places):
        raise InputError(f"{path}: {len(times)} times for {len(places)} places: allowed is one for each")
    rows = []
    for number, (stamp, place) in enumerate(zip(times, places, strict=True), 1):
        try:
            moment = datetime.fromisoformat(stamp.strip().replace("Z", "+00:00"))
            longitude, latitude, height = (float(part) for part in (*place, "0")[:3])
        except ValueError:
            raise InputError(
                f"{path}: point {number}: {stamp!r} at {place!r}: allowed is a time and two or three numbers"
            ) from None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)
        rows.append((moment.timestamp(), latitude, longitude, height))
    return _points(path, rows)


def _log(path: Path, columns: Columns) -> Points:
    """The reference of a log, with its attitude if it has one, or else its fixes."""
    from insenv.logs import load

    log = load(path)
    known, attitude = log.reference, None
    if known is not None and known.latitude is not None and known.longitude is not None and known.height is not None:
        if known.roll is not None and known.pitch is not None and known.heading is not None:
            attitude = np.column_stack([known.roll, known.pitch, known.heading])
        place = (known.latitude, known.longitude, known.height)
        return Points(str(path), known.time, *place, attitude)
    if log.gnss is None:
        raise InputError(f"{path}: the log has neither a reference with positions nor fixes, and so no track")
    return Points(str(path), log.gnss.time, log.gnss.latitude, log.gnss.longitude, log.gnss.height)


def _run(path: Path, columns: Columns) -> Points:
    """The truth of the result file of a run."""
    names = ("time", "latitude", "longitude", "height", "q_nb")
    try:
        with np.load(path, allow_pickle=False) as found:
            time, latitude, longitude, height, q_nb = (found[f"truth/{name}"] for name in names)
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: no result of a run with its truth: {error}") from None
    attitude = np.column_stack(to_euler(q_nb))
    return Points(str(path), time, latitude, longitude, height, attitude)


_READERS: dict[str, Callable[[Path, Columns], Points]] = {
    ".csv": _csv,
    ".txt": _csv,
    ".gpx": _gpx,
    ".nmea": _nmea,
    ".kml": _kml,
    ".npz": _run,
    ".toml": _log,
}
