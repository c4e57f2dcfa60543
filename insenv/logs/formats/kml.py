"""KML 2.2 with Google's tracks: recorded tracks; the truth and each estimate with heading, roll and pitch.

https://developers.google.com/kml/documentation/kmlreference#gxtrack.  A coordinate holds longitude, latitude (deg) and height
(m).  Angles hold the heading (deg); their tilt and roll are 0, because readers disagree about the signs: roll and pitch (deg),
positive right side down and nose up, stand in arrays of these names.
"""

from __future__ import annotations

from datetime import datetime, timezone
from xml.etree.ElementTree import Element, ParseError, SubElement, fromstring, indent, tostring

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.logs.formats.contract import Drive, Files, Format, NamedTrack, date_of, track_of_points

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_COLORS = ("ff404040", "ffb4771f", "ff0e7fff", "ff2ca02c", "ff2827d6")
"""aabbggrr: the truth, then the estimates in turn."""
_ANGLES = ("roll_deg", "pitch_deg")
"""Arrays of the extended data."""


def read(label: str, data: bytes) -> list[NamedTrack]:
    """The placemarks with a gx:Track, pairs of when and gx:coord; a LineString has no times and is no recorded track."""
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise InputError(f"{label}: declares a document type: allowed is plain KML")
    try:
        root = fromstring(data)
    except ParseError as error:
        raise InputError(f"{label}: not a KML file: {error}") from None
    tracks = []
    for mark in [each for each in root.iter() if each.tag.endswith("}Placemark")]:
        name = next((each.text for each in mark if each.tag.endswith("}name")), None)
        points = [point for track in mark.iter() if track.tag.endswith("}Track") for point in _points(label, track)]
        if points:
            tracks.append(track_of_points(name or "", points))
    if not tracks:
        raise InputError(f"{label}: no gx:Track in a Placemark: only points with times are a recorded track")
    return tracks


def _points(label: str, track: Element) -> list[tuple[float, float, float, float]]:
    """Time s, latitude deg, longitude deg, height m or NaN of the points of a gx:Track."""
    times = [each.text or "" for each in track if each.tag.endswith("}when")]
    places = [(each.text or "").split() for each in track if each.tag.endswith("}coord")]
    if len(times) != len(places):
        raise InputError(f"{label}: {len(times)} times for {len(places)} places: allowed is one for each")
    points = []
    for number, (stamp, place) in enumerate(zip(times, places, strict=True), 1):
        try:
            moment = datetime.fromisoformat(stamp.strip().replace("Z", "+00:00"))
            longitude, latitude, height = (float(part) for part in (*place, "nan")[:3])
        except ValueError:
            raise InputError(
                f"{label}: point {number}: {stamp!r} at {place!r}: allowed is a time and two or three numbers"
            ) from None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)
        points.append((moment.timestamp(), latitude, longitude, height))
    return points


def write(drive: Drive) -> Files:
    """NAME.kml: the tracks with positions.  Heights are above the ellipsoid."""
    placed = drive.placed("kml")
    root = Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
    document = SubElement(root, "Document")
    _text(document, "name", drive.title)
    _text(document, "description", drive.description)
    for number in range(len(placed)):
        line = SubElement(SubElement(document, "Style", {"id": f"line{number}"}), "LineStyle")
        _text(line, "color", _COLORS[0] if number == 0 else _COLORS[1 + (number - 1) % (len(_COLORS) - 1)])
        _text(line, "width", "2")
    schema = SubElement(document, "Schema", {"name": "attitude", "id": "attitude"})
    for name in _ANGLES:
        SubElement(schema, "gx:SimpleArrayField", {"name": name, "type": "float"})
    for number, (track, place) in enumerate(placed):
        mark = SubElement(document, "Placemark")
        _text(mark, "name", track.name)
        _text(mark, "styleUrl", f"#line{number}")
        _write_track(SubElement(mark, "gx:Track"), track, place)
    indent(root)
    return {f"{drive.name}.kml": tostring(root, encoding="unicode", xml_declaration=True) + "\n"}


def _write_track(element: Element, track: NamedTrack, place: tuple[Array, Array, Array]) -> None:
    _text(element, "altitudeMode", "absolute")
    for time in track.time:
        _text(element, "when", date_of(float(time)).isoformat(timespec="milliseconds").replace("+00:00", "Z"))
    for latitude, longitude, height in zip(np.degrees(place[0]), np.degrees(place[1]), place[2], strict=True):
        _text(element, "gx:coord", f"{longitude:.9f} {latitude:.9f} {height:.4f}")
    if track.q_nb is None:
        return
    roll, pitch, heading = np.degrees(np.stack(attitude.numeric.to_euler(track.q_nb)))
    for angle in heading:
        _text(element, "gx:angles", f"{angle % 360.0:.4f} 0 0")
    data = SubElement(SubElement(element, "ExtendedData"), "SchemaData", {"schemaUrl": "#attitude"})
    for name, values in zip(_ANGLES, (roll, pitch), strict=True):
        array = SubElement(data, "gx:SimpleArrayData", {"name": name})
        for value in values:
            _text(array, "gx:value", f"{value:.4f}")


def _text(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text


FORMAT = Format(name="kml", suffixes=(".kml",), read_tracks=read, several=True, write=write, needs_report=True)
