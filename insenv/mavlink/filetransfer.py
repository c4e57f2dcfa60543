"""FILE_TRANSFER_PROTOCOL: read the vehicle's few files; everything else is refused at once, so that clients do not wait.

There are no sessions to keep: the files never change, and a session number is that of the file.  A reply has the next
sequence number of its request.  https://mavlink.io/en/services/ftp.html
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from insenv.mavlink.vehicle import checksum

HEADER, SIZE = 12, 251
LONGEST = SIZE - HEADER
"""Bytes of data in a reply."""
BURST = 60
"""Replies to one request for a burst; the client asks for the rest."""
TERMINATE, RESET, LIST, OPEN, READ, CRC, BURST_READ = 1, 2, 3, 4, 5, 14, 15
ACK, NAK = 128, 129
INVALID_SESSION, END, UNKNOWN_COMMAND, NOT_FOUND, READ_ONLY = 4, 6, 7, 10, 9
_WRITES = (6, 7, 8, 9, 10, 11, 12, 13)


def replies(files: Mapping[str, bytes], request: bytes) -> Iterator[bytes]:
    """The payloads (251 bytes) that answer one request; none for an answer or a request for nothing."""
    opcode, session = request[3], request[2]
    if opcode >= ACK or opcode == 0:
        return
    offset = int.from_bytes(request[8:12], "little")
    data = request[HEADER : HEADER + request[4]]
    name = _name(data)
    if opcode in (TERMINATE, RESET):
        yield _reply(request, 0, ACK)
    elif opcode == LIST:
        listed = b"".join(f"F{path[1:]}\t{len(files[path])}\0".encode() for path in list(files)[offset:])
        yield (
            _reply(request, 0, ACK, listed)
            if listed and name == "/"
            else _refused(request, 0, END if listed or offset else NOT_FOUND)
        )
    elif opcode in (OPEN, CRC):
        if name not in files:
            yield _refused(request, 0, NOT_FOUND)
        elif opcode == CRC:
            yield _reply(request, 0, ACK, checksum(files[name]).to_bytes(4, "little"))
        else:
            yield _reply(request, 0, ACK, len(files[name]).to_bytes(4, "little"), session=list(files).index(name))
    elif opcode in (READ, BURST_READ):
        yield from _read(files, request, session, offset)
    else:
        yield _refused(request, 0, READ_ONLY if opcode in _WRITES else UNKNOWN_COMMAND)


def _read(files: Mapping[str, bytes], request: bytes, session: int, offset: int) -> Iterator[bytes]:
    if session >= len(files):
        yield _refused(request, 0, INVALID_SESSION)
        return
    content = list(files.values())[session]
    size = min(request[4] or LONGEST, LONGEST)
    count = BURST if request[3] == BURST_READ else 1
    for number in range(count):
        part = content[offset : offset + size]
        if not part:
            yield _refused(request, number, END)
            return
        offset += len(part)
        yield _reply(request, number, ACK, part, offset=offset - len(part), complete=number == count - 1)


def _name(data: bytes) -> str:
    text = data.split(b"\0")[0].decode("ascii", "replace").partition("?")[0]
    return "/" + text.lstrip("/")


def _refused(request: bytes, number: int, error: int) -> bytes:
    return _reply(request, number, NAK, bytes((error,)))


def _reply(
    request: bytes, number: int, opcode: int, data: bytes = b"", *, session: int | None = None, offset: int = 0,
    complete: bool = False,
) -> bytes:  # fmt: skip
    reply = bytearray(SIZE)
    reply[0:2] = ((int.from_bytes(request[0:2], "little") + 1 + number) % 65536).to_bytes(2, "little")
    reply[2] = request[2] if session is None else session
    reply[3], reply[4], reply[5], reply[6] = opcode, len(data), request[3], complete
    reply[8:12] = offset.to_bytes(4, "little")
    reply[HEADER : HEADER + len(data)] = data
    return bytes(reply)
