"""GPX 1.1 (https://www.topografix.com/GPX/1/1/) by gpxpy: recorded tracks, and the truth and each estimate as a track."""

from __future__ import annotations

import numpy as np

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.logs.formats.contract import Drive, Files, Format, NamedTrack, date_of, track_of_points


def read(label: str, data: bytes) -> list[NamedTrack]:
    """The tracks with points; the segments of a track follow each other."""
    need(f"{label}: a GPX file", "gpxpy", extra="workbench")
    import gpxpy

    try:
        document = gpxpy.parse(data.decode("utf-8-sig"))
    except (gpxpy.gpx.GPXException, UnicodeDecodeError) as error:
        raise InputError(f"{label}: not a GPX file: {error}") from None
    tracks = []
    for track in document.tracks:
        points = []
        for number, (point, _, _) in enumerate(track.walk(), 1):
            if point.time is None:
                raise InputError(f"{label}: point {number} has no time: a planned route is not a recorded track")
            height = float("nan") if point.elevation is None else float(point.elevation)
            points.append((point.time.timestamp(), point.latitude, point.longitude, height))
        if points:
            tracks.append(track_of_points(track.name or "", points))
    if not tracks:
        raise InputError(f"{label}: no track with points")
    return tracks


def write(drive: Drive) -> Files:
    """NAME.gpx: the tracks with positions.  Heights are above the ellipsoid."""
    from gpxpy import gpx

    document = gpx.GPX()
    document.creator, document.name, document.description = "insenv", drive.title, drive.description
    for named, (latitude, longitude, height) in drive.placed("gpx"):
        track, segment = gpx.GPXTrack(name=named.name), gpx.GPXTrackSegment()
        for time, north, east, up in zip(named.time, np.degrees(latitude), np.degrees(longitude), height, strict=True):
            segment.points.append(gpx.GPXTrackPoint(float(north), float(east), float(up), date_of(float(time))))
        track.segments.append(segment)
        document.tracks.append(track)
    return {f"{drive.name}.gpx": document.to_xml(version="1.1")}


FORMAT = Format(
    name="gpx",
    suffixes=(".gpx",),
    read_tracks=read,
    several=True,
    write=write,
    needs_report=True,
    module="gpxpy",
    extra="workbench",
)
