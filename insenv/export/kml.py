"""KML 2.2 with Google's tracks: the truth and each estimate with times, heading, and roll and pitch as extended data.

https://developers.google.com/kml/documentation/kmlreference#gxtrack.  A coordinate holds longitude, latitude (deg) and height
(m).  Angles hold the heading (deg); their tilt and roll are 0, because readers disagree about the signs: roll and pitch (deg),
positive right side down and nose up, stand in arrays of these names.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from insenv.base.errors import InputError
from insenv.export.tracks import NamedTrack, date_of, tracks_of
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
