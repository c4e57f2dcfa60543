"""Tracks for maps: KML, GPX, and NMEA sentences.

KML 2.2 with Google's tracks: the truth and each estimate with times, heading, and roll and pitch as extended data:

https://developers.google.com/kml/documentation/kmlreference#gxtrack.  A coordinate holds longitude, latitude (deg) and height
(m).  Angles hold the heading (deg); their tilt and roll are 0, because readers disagree about the signs: roll and pitch (deg),
positive right side down and nose up, stand in arrays of these names.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from functools import reduce
from math import atan2, degrees, hypot
from xml.etree import ElementTree

import numpy as np

from insenv.base.errors import InputError
from insenv.export.tracks import NamedTrack, date_of, tracks_of
from insenv.logs import GnssFixes, RecordedLog
from insenv.report.run_data import RunData

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_COLORS = ("ff404040", "ffb4771f", "ff0e7fff", "ff2ca02c", "ff2827d6")
"""aabbggrr: the truth, then the estimates in turn."""
_ANGLES = ("roll_deg", "pitch_deg")
"""Arrays of the extended data."""


def kml_text(report: RunData) -> str:
    """The tracks of a report.  Heights are above the ellipsoid.  Raises `InputError` if nothing has positions."""
    placed = [named for named in tracks_of(report) if named.placed]
    if not placed:
        raise InputError("format 'kml': neither truth nor estimate has positions")
    root = ElementTree.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "name").text = report.scenario
    ElementTree.SubElement(document, "description").text = report.title
    for number in range(len(placed)):
        color = _COLORS[0] if number == 0 else _COLORS[1 + (number - 1) % (len(_COLORS) - 1)]
        style = ElementTree.SubElement(document, "Style", {"id": f"line{number}"})
        line = ElementTree.SubElement(style, "LineStyle")
        ElementTree.SubElement(line, "color").text = color
        ElementTree.SubElement(line, "width").text = "2"
    schema = ElementTree.SubElement(document, "Schema", {"name": "attitude", "id": "attitude"})
    for name in _ANGLES:
        ElementTree.SubElement(schema, "gx:SimpleArrayField", {"name": name, "type": "float"})
    for number, named in enumerate(placed):
        _placemark(document, named, f"#line{number}")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _placemark(document: ElementTree.Element, named: NamedTrack, style: str) -> None:
    mark = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(mark, "name").text = named.name
    ElementTree.SubElement(mark, "styleUrl").text = style
    track = ElementTree.SubElement(mark, "gx:Track")
    ElementTree.SubElement(track, "altitudeMode").text = "absolute"
    of = named.track
    assert of.latitude is not None and of.longitude is not None and of.height is not None
    for time in of.time:
        date = date_of(float(time)).isoformat(timespec="milliseconds")
        ElementTree.SubElement(track, "when").text = date.replace("+00:00", "Z")
    for latitude, longitude, height in zip(np.degrees(of.latitude), np.degrees(of.longitude), of.height, strict=True):
        ElementTree.SubElement(track, "gx:coord").text = f"{longitude:.9f} {latitude:.9f} {height:.4f}"
    if of.q_nb is None:
        return
    angles = of.euler_deg()
    for heading in angles[:, 2]:
        ElementTree.SubElement(track, "gx:angles").text = f"{heading % 360.0:.4f} 0 0"
    data = ElementTree.SubElement(ElementTree.SubElement(track, "ExtendedData"), "SchemaData", {"schemaUrl": "#attitude"})
    for name, values in zip(_ANGLES, angles[:, :2].T, strict=True):
        array = ElementTree.SubElement(data, "gx:SimpleArrayData", {"name": name})
        for value in values:
            ElementTree.SubElement(array, "gx:value").text = f"{value:.4f}"


# GPX 1.1 (https://www.topografix.com/GPX/1/1/) by gpxpy: the truth and each estimate as a track.


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


# NMEA 0183 of a receiver's fixes: GGA, GST, and RMC and VTG where they have a velocity.
#
# Sentences follow one another as a receiver sends them, stamped with the time of validity in UTC from
# `insenv.export.tracks.EPOCH`.  The geoid separation is 0, so that the altitude of GGA is the height above the ellipsoid.

_KNOT = 1852.0 / 3600.0
_KMH = 1.0 / 3.6
_ERROR_M = 5.0
"""Range error of a single fix, m, by which the horizontal dilution of GGA stands for the stated accuracy."""
_SATELLITES = 10
_MOVING = 0.01
"""Speed (m/s) below which a course means nothing, and its field is empty."""


def nmea_text(log: RecordedLog) -> str:
    """The sentences of all fixes, each line with its checksum and CR LF.  Raises `InputError` for a log without fixes."""
    if log.gnss is None or not len(log.gnss.time):
        raise InputError("format 'nmea': the drive has no GNSS receiver, or no fix came")
    return "".join(f"${body}*{checksum(body):02X}\r\n" for body in _sentences(log.gnss))


def checksum(body: str) -> int:
    """Exclusive or of the characters between $ and *."""
    return reduce(lambda found, character: found ^ ord(character), body, 0)


def _sentences(gnss: GnssFixes) -> Iterator[str]:
    moving = gnss.velocity_n is not None
    for row, time in enumerate(gnss.time):
        date = date_of(round(float(time), 3))
        clock = f"{date:%H%M%S}.{date.microsecond // 1000:03d}"
        place = f"{_angle(float(gnss.latitude[row]), 2, 'NS')},{_angle(float(gnss.longitude[row]), 3, 'EW')}"
        north, east, down = (float(sigma) for sigma in gnss.position_sigma[row])
        dilution = max(hypot(north, east) / _ERROR_M, 0.1) if np.isfinite(north + east) else 99.9
        height = float(gnss.height[row])
        yield f"GPGGA,{clock},{place},1,{_SATELLITES:02d},{dilution:.1f},{height:.3f},M,0.0,M,,"
        if moving and gnss.velocity_n is not None:
            yield from _motion(gnss.velocity_n[row], clock, place, date)
        if np.isfinite(north + east + down):
            major, minor, turned = (north, east, 0.0) if north >= east else (east, north, 90.0)
            rms = hypot(north, east)
            yield f"GPGST,{clock},{rms:.3f},{major:.3f},{minor:.3f},{turned:.1f},{north:.3f},{east:.3f},{down:.3f}"


def _motion(velocity: np.ndarray, clock: str, place: str, date: datetime) -> Iterator[str]:
    """RMC and VTG."""
    speed = hypot(float(velocity[0]), float(velocity[1]))
    course = f"{degrees(atan2(float(velocity[1]), float(velocity[0]))) % 360.0:.2f}" if speed > _MOVING else ""
    yield f"GPRMC,{clock},A,{place},{speed / _KNOT:.3f},{course},{date:%d%m%y},,,A"
    yield f"GPVTG,{course},T,,M,{speed / _KNOT:.3f},N,{speed / _KMH:.3f},K,A"


def _angle(angle: float, digits: int, letters: str) -> str:
    """ddmm.mmmmmmm and the letter of the half; rad."""
    whole = round(abs(degrees(angle)) * 60.0 * 1e7)
    minutes = whole % (60 * 10**7)
    return f"{whole // (60 * 10**7):0{digits}d}{minutes // 10**7:02d}.{minutes % 10**7:07d},{letters[angle < 0]}"
