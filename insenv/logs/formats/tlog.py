"""The records of MAVLink telemetry logs (.tlog), read and written as ground stations do, and the layout of the frames in them.

A record is the Unix time in microseconds, a big-endian unsigned 64-bit number whose two lowest bits hold the link number,
followed by a frame.

Layout of MAVLink 2: magic 0xFD, payload length, incompatibility flags, compatibility flags, sequence, system,
component, message number (3 bytes, little-endian), payload, checksum (2 bytes, over everything but the magic, and over
the message's CRC_EXTRA byte) and, if the first incompatibility flag is set, a 13-byte signature.  MAVLink 1: 0xFE,
length, sequence, system, component, message number.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

from insenv.base.output import cannot_write, check_output_file

V1, V2 = 0xFE, 0xFD
"""The magic bytes of MAVLink 1 and 2."""
MAGIC = re.compile(b"[\xfd\xfe]")
SIGNED = 0x01
"""The incompatibility flag of a signed frame, the only one supported."""
SIGNATURE = 13
"""Bytes of link number, time stamp and hash together."""
HEADER_V1, HEADER_V2, CHECKSUM = 6, 10, 2
STAMP = 8
"""Bytes of the time before a frame."""


def header_size(magic: int) -> int:
    """Bytes from the magic to the payload."""
    return HEADER_V2 if magic == V2 else HEADER_V1


def layout(data: bytes, start: int) -> tuple[int, int, int, int]:
    """Incompatibility flags and message number of the frame with its magic at `start`, the ends of its payload and of itself.

    Its header must be in the data.
    """
    if data[start] == V2:
        flags, number = data[start + 2], int.from_bytes(data[start + 7 : start + 10], "little")
        end = start + HEADER_V2 + data[start + 1]
    else:
        flags, number, end = 0, data[start + 5], start + HEADER_V1 + data[start + 1]
    return flags, number, end, end + CHECKSUM + (SIGNATURE if flags & SIGNED else 0)


def sender(data: bytes, start: int = 0) -> tuple[int, int]:
    """System and component that the frame at `start` states."""
    return (data[start + 5], data[start + 6]) if data[start] == V2 else (data[start + 3], data[start + 4])


@dataclass(frozen=True)
class Record:
    """A record: time (us of Unix time), sender, number of the message, payload."""

    time_us: int
    system: int
    component: int
    number: int
    payload: bytes


@lru_cache(maxsize=1)
def messages() -> Any:
    """The messages by number."""
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega.mavlink_map


class TelemetryLog:
    """The records of a log, in order.

    records: number of records; skipped: bytes that belong to none; wrong: frames with a wrong checksum; unknown: frames of
    unknown messages, whose checksum cannot be verified.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.records = self.skipped = self.wrong = self.unknown = 0

    def __iter__(self) -> Iterator[Record]:
        from fastcrc import crc16

        data, end, at = self.data, len(self.data), 0
        extras = {number: kind.crc_extra for number, kind in messages().items()}
        while at + STAMP < end:
            begin = at + STAMP
            if data[begin] not in (V1, V2) or begin + header_size(data[begin]) > end:
                at = self._resynchronised(at)
                continue
            _, number, body, follows = layout(data, begin)
            if follows > end:
                at = self._resynchronised(at)
                continue
            extra = extras.get(number)
            if extra is None:
                if follows + STAMP < end and data[follows + STAMP] not in (V1, V2):
                    at = self._resynchronised(at)
                    continue
                self.unknown += 1
            elif crc16.mcrf4xx(data[begin + 1 : body] + bytes((extra,))) != int.from_bytes(data[body : body + 2], "little"):
                self.wrong += 1
                at = self._resynchronised(at)
                continue
            else:
                self.records += 1
                payload = data[begin + header_size(data[begin]) : body]
                yield Record(int.from_bytes(data[at:begin], "big"), *sender(data, begin), number, payload)
            at = follows
        self.skipped += max(end - at, 0)

    def _resynchronised(self, at: int) -> int:
        """Offset at which the next record may begin: eight bytes before the next magic byte."""
        magic = MAGIC.search(self.data, at + STAMP + 1)
        after = len(self.data) if magic is None else magic.start() - STAMP
        self.skipped += after - at
        return after


_LINK_BITS = 0b11


class TlogWriter:
    """A log that is written to ``PATH.part`` and renamed to PATH when closed.

    PATH is therefore never incomplete; after a crash ``PATH.part`` is readable up to its last whole record.  An
    existing PATH is replaced.  frames: the number written.  Raises `InputError` when the file cannot be created or
    written, `InsenvError` when the disk is full.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.frames = 0
        check_output_file(self.path)
        self._part = self.path.with_name(self.path.name + ".part")
        with self._explained():
            self._file = self._part.open("wb", buffering=1 << 16)

    def write(self, unix_us: int, frame: bytes, link: int = 0) -> None:
        """Append a frame sent or received at `unix_us` (Unix time, microseconds) over `link` (0 to 3)."""
        with self._explained():
            self._file.write((unix_us & ~_LINK_BITS | link & _LINK_BITS).to_bytes(8, "big") + frame)
        self.frames += 1

    def flush(self) -> None:
        """Pass all that is buffered to the operating system."""
        with self._explained():
            self._file.flush()

    def close(self) -> None:
        """Complete the log and rename it; a second call does nothing."""
        if not self._file.closed:
            with self._explained():
                self._file.close()
                os.replace(self._part, self.path)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Close the file and raise an error that names it where an operation of the block fails."""
        try:
            yield
        except OSError as error:
            with suppress(OSError, AttributeError):
                self._file.close()
            raise cannot_write(self.path, error) from None

    def __enter__(self) -> TlogWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
