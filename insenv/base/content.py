"""What the bytes or the values of a file are, for the message to someone who gave the wrong file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

ARCHIVE, BINARY, EMPTY, TABLE, UTF16 = "an archive", "a binary file", "empty", "a table of numbers", "text in UTF-16"
NMEA, GPX, KML, OTHER = "sentences of NMEA 0183", "a GPX file", "a KML file", "text"
_ARCHIVES = (b"\x1f\x8b", b"PK\x03\x04", b"\xfd7zXZ\x00", b"BZh", b"7z\xbc\xaf")
_SEPARATORS = re.compile(r"[,;\t]| +")
_SENTENCE = re.compile(r"[$!][A-Z]{5},[^\n]*\*[0-9A-Fa-f]{2}\s")
_HEAD = 2000
"""Characters in which the first element of a markup file begins."""
_LINES = 20
_BYTES = 65536


def content_of(raw: bytes) -> str:
    """What the bytes plainly are, one of the constants above; `OTHER` for text that is none of them."""
    if not raw.strip():
        return EMPTY
    if raw.startswith(_ARCHIVES):
        return ARCHIVE
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return UTF16
    if b"\0" in raw or _share_of_controls(raw) > 0.02:
        return BINARY
    text = raw[:_BYTES].decode("utf-8-sig", errors="replace").lstrip()
    if text.startswith("<"):
        return next((content for tag, content in (("<gpx", GPX), ("<kml", KML)) if tag in text[:_HEAD]), OTHER)
    if _SENTENCE.match(text):
        return NMEA
    return TABLE if _has_row_of_numbers(text) else OTHER


def _share_of_controls(raw: bytes) -> float:
    """Share of the bytes that no text has, in any encoding of 8 bits."""
    part = raw[:_BYTES]
    return sum(byte < 32 and byte not in b"\t\n\r\f\x1b" for byte in part) / len(part)


def _has_row_of_numbers(text: str) -> bool:
    for line in [line.strip() for line in text.splitlines() if line.strip()][:_LINES]:
        fields = [field for field in _SEPARATORS.split(line) if field]
        if len(fields) > 1 and all(map(_is_number, fields)):
            return True
    return False


def _is_number(text: str) -> bool:
    try:
        float(text.strip('"'))
    except ValueError:
        return False
    return True


def is_scenario(data: Mapping[str, Any]) -> bool:
    """Whether the file has a key that a scenario must have and a description of a log may not."""
    return "vehicle" in data or "duration_s" in data


def is_log(data: Mapping[str, Any]) -> bool:
    """Whether the file names a flight log or the file of the inertial samples, as a scenario may not."""
    imu = data.get("imu")
    return "flight" in data or (isinstance(imu, Mapping) and "file" in imu)
