"""Component metadata: names, units and ranges of the parameters, as files that ground stations read by FTP.

https://mavlink.io/en/services/component_information.html
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable
from typing import Any

from insenv.mavlink.parameters import NEVER, Parameter

GENERAL, PARAMETERS = "/general.json", "/parameter.json"
_TYPE_PARAMETER = 1
_LIMIT = 1e30
_CHECKSUM_ALL = 0xFFFFFFFF


def metadata(parameters: Iterable[Parameter]) -> dict[str, bytes]:
    """The files by name: the general one, which lists the others, and that of the parameters."""
    listed = _document({"version": 1, "parameters": [_described(parameter) for parameter in parameters]})
    entry = {"type": _TYPE_PARAMETER, "uri": f"mftp://{PARAMETERS}", "fileCrc": checksum(listed)}
    return {GENERAL: _document({"version": 1, "metadataTypes": [entry]}), PARAMETERS: listed}


def checksum(data: bytes) -> int:
    """The 32-bit checksum of MAVLink FTP: that of zip without its inversions of the start and the end."""
    return zlib.crc32(data, _CHECKSUM_ALL) ^ _CHECKSUM_ALL


def _described(parameter: Parameter) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.meaning,
        "longDesc": f"{parameter.meaning}. Takes effect: {parameter.acts}.",
        "group": parameter.name.partition("_")[0],
        "decimalPlaces": 7,
        "readOnly": parameter.acts == NEVER,
    }
    if parameter.unit:
        found["units"] = parameter.unit
    if parameter.acts != NEVER:
        found |= {key: value for key, value in (("min", parameter.lower), ("max", parameter.upper)) if abs(value) < _LIMIT}
    return found


def _document(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("ascii")
