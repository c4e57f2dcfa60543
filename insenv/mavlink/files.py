"""The files that clients read by FILE_TRANSFER_PROTOCOL: names, units and ranges of the parameters (component metadata).

Everything else is refused at once, so that clients do not wait.  There are no sessions to keep: the files never change, and
a session number is that of the file.  A reply has the next sequence number of its request.
https://mavlink.io/en/services/component_information.html, https://mavlink.io/en/services/ftp.html
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
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
    bounds = {"min": parameter.lower, "max": parameter.upper} if parameter.acts != NEVER else {}
    return {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.meaning,
        "longDesc": f"{parameter.meaning}. Takes effect: {parameter.acts}.",
        "group": parameter.name.partition("_")[0],
        "decimalPlaces": 7,
        "readOnly": parameter.acts == NEVER,
        **({"units": parameter.unit} if parameter.unit else {}),
        **{key: value for key, value in bounds.items() if abs(value) < _LIMIT},
    }


def _document(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("ascii")


_HEADER, _SIZE = struct.Struct("<HBBBBBxI"), 251
"""Sequence, session, opcode, size, opcode of the request, whether a burst is complete, offset; bytes of a payload."""
MAX_DATA_BYTES = _SIZE - _HEADER.size
"""Bytes of data in a reply."""
MAX_BURST_REPLIES = 60
"""Replies to one request for a burst; the client asks for the rest."""
TERMINATE, RESET, LIST, OPEN, READ, CRC, BURST_READ = 1, 2, 3, 4, 5, 14, 15
ACK, NAK = 128, 129
INVALID_SESSION, END, UNKNOWN_COMMAND, NOT_FOUND, READ_ONLY = 4, 6, 7, 10, 9
_WRITES = (6, 7, 8, 9, 10, 11, 12, 13)


def replies(files: Mapping[str, bytes], request: bytes) -> Iterator[bytes]:
    """The payloads (251 bytes) that answer one request; none for an answer or a request for nothing."""
    sequence, session, opcode, size, _, _, offset = _HEADER.unpack_from(request)
    if opcode >= ACK or opcode == 0:
        return
    text = request[_HEADER.size : _HEADER.size + size].split(b"\0")[0].decode("ascii", "replace")
    name = "/" + text.partition("?")[0].lstrip("/")

    def reply(
        data: bytes, number: int = 0, *, kind: int = ACK, session: int = session, offset: int = 0, last: bool = False
    ) -> bytes:
        header = _HEADER.pack((sequence + 1 + number) % 65536, session, kind, len(data), opcode, last, offset)
        return (header + data).ljust(_SIZE, b"\0")

    def refused(error: int, number: int = 0) -> bytes:
        return reply(bytes((error,)), number, kind=NAK)

    if opcode in (TERMINATE, RESET):
        yield reply(b"")
    elif opcode == LIST:
        listed = b"".join(f"F{path[1:]}\t{len(files[path])}\0".encode() for path in list(files)[offset:])
        if listed and name == "/":
            yield reply(listed)
        else:
            yield refused(END if listed or offset else NOT_FOUND)
    elif opcode in (OPEN, CRC):
        if name not in files:
            yield refused(NOT_FOUND)
        elif opcode == CRC:
            yield reply(checksum(files[name]).to_bytes(4, "little"))
        else:
            yield reply(len(files[name]).to_bytes(4, "little"), session=list(files).index(name))
    elif opcode in (READ, BURST_READ) and session >= len(files):
        yield refused(INVALID_SESSION)
    elif opcode in (READ, BURST_READ):
        content, length = list(files.values())[session], min(size or MAX_DATA_BYTES, MAX_DATA_BYTES)
        count = MAX_BURST_REPLIES if opcode == BURST_READ else 1
        for number in range(count):
            part = content[offset : offset + length]
            if not part:
                yield refused(END, number)
                return
            yield reply(part, number, offset=offset, last=number == count - 1)
            offset += len(part)
    else:
        yield refused(READ_ONLY if opcode in _WRITES else UNKNOWN_COMMAND)
