"""GPX 1.1 (https://www.topografix.com/GPX/1/1/) by gpxpy: the truth and each estimate as a track."""

from __future__ import annotations

import numpy as np

from insenv.base.errors import InputError
from insenv.export.tracks import date_of, tracks_of
from insenv.report.run_data import RunData


def gpx_text(report: RunData) -> str:
    """The tracks of a report.  Heights are above the ellipsoid.

    Raises `InputError` if nothing has positions.
    """
    from gpxpy import gpx

    document = gpx.GPX()
    document.creator, document.name, document.description = "insenv", report.scenario, report.title
    for named in tracks_of(report):
        if not named.placed:
            continue
        track, segment = gpx.GPXTrack(name=named.name), gpx.GPXTrackSegment()
        assert named.track.latitude is not None and named.track.longitude is not None and named.track.height is not None
        place = (np.degrees(named.track.latitude), np.degrees(named.track.longitude), named.track.height)
        for time, latitude, longitude, height in zip(named.track.time, *place, strict=True):
            date = date_of(float(time))
            segment.points.append(gpx.GPXTrackPoint(float(latitude), float(longitude), float(height), date))
        track.segments.append(segment)
        document.tracks.append(track)
    if not document.tracks:
        raise InputError("format 'gpx': neither truth nor estimate has positions")
    return document.to_xml(version="1.1")
