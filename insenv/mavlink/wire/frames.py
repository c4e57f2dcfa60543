"""MAVLink frames: find and check them in bytes, and give them another sequence number.

A frame that `split` returns is complete, has a known message number and a correct checksum; pymavlink decodes it afterwards.
Input is untrusted, so the work spent on invalid bytes is bounded.

Layout of MAVLink 2: magic 0xFD, payload length, incompatibility flags, compatibility flags, sequence, system,
component, message number (3 bytes, little-endian), payload, checksum (2 bytes, over everything but the magic, and over
the message's CRC_EXTRA byte) and, if the first incompatibility flag is set, a 13-byte signature.  MAVLink 1: 0xFE,
length, sequence, system, component, message number.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

from insenv.base.output import cannot_write, check_output_file

Message = Any
"""A message object of pymavlink."""


@lru_cache(maxsize=1)
def dialect() -> Any:
    """pymavlink's module of the development messages, which include the common ones; MAVLink 2 in any environment."""
    from pymavlink.dialects.v20 import development

    return development


def message_class(name: str) -> Any:
    """The class of a message by name."""
    return getattr(dialect(), f"MAVLink_{name.lower()}_message")


V2 = 0xFD
"""The magic of MAVLink 2; that of MAVLink 1 is 0xFE."""
SIGNED = 0x01
"""The incompatibility flag of a signed frame, the only one supported."""
SIGNATURE = 13
"""Bytes of link number, time stamp and hash together."""
HEADER_V1, HEADER_V2, CHECKSUM = 6, 10, 2
MAX_WRONG_FRAMES = 16
"""Frames with a wrong checksum after which the rest of a piece is discarded."""

_MAGIC = re.compile(b"[\xfd\xfe]")


@dataclass
class Statistics:
    """Counts since a link was opened.

    sent_messages: messages packed, for any number of peers.  sent_frames, sent_bytes: passed to the operating system,
    summed over peers.  dropped_frames: not sent because a peer reads too slowly or a system buffer is full.
    received_messages: verified and returned.  received_bytes: all bytes read.  Rejected: wrong_checksum; unknown
    (message number or incompatibility flag: such frames cannot be checked); undecodable; unsigned; wrongly_signed;
    replayed (a signing time not newer than the last); stale (too old for a new sender); early (a signing time more than
    a day ahead of our clock); reflected (our own frames,
    returned to us); oversized (datagrams larger than any of MAVLink); skipped_bytes (between frames); overflowed
    (datagrams of a peer that sends faster than it is read); refused_peers (too many peers).
    """

    sent_messages: int = 0
    sent_frames: int = 0
    sent_bytes: int = 0
    dropped_frames: int = 0
    received_messages: int = 0
    received_bytes: int = 0
    wrong_checksum: int = 0
    unknown: int = 0
    undecodable: int = 0
    unsigned: int = 0
    wrongly_signed: int = 0
    replayed: int = 0
    stale: int = 0
    early: int = 0
    reflected: int = 0
    oversized: int = 0
    skipped_bytes: int = 0
    overflowed: int = 0
    refused_peers: int = 0

    @classmethod
    def total(cls, parts: Iterable[Statistics]) -> Statistics:
        """The sums over several links."""
        return cls(*(sum(counts) for counts in zip(*(astuple(part) for part in parts), strict=True)))


@lru_cache(maxsize=1)
def _tools() -> tuple[dict[int, int], Callable[[bytes], int]]:
    """CRC_EXTRA by message number, and the checksum function."""
    from fastcrc import crc16

    kinds = dialect().mavlink_map.values()
    return {kind.id: kind.crc_extra for kind in kinds}, crc16.mcrf4xx


def sender(frame: bytes) -> tuple[int, int]:
    """System and component that a frame states."""
    return (frame[5], frame[6]) if frame[0] == V2 else (frame[3], frame[4])


def is_signed(frame: bytes) -> bool:
    """Whether the frame carries a signature, valid or not."""
    return frame[0] == V2 and bool(frame[2] & SIGNED)


def split(piece: bytes, statistics: Statistics) -> tuple[list[bytes], int]:
    """The checked frames in `piece`, in order, and the number of bytes consumed.

    The remaining bytes may be the start of an incomplete frame: a stream keeps them, a datagram discards them.  After
    an invalid frame the search continues one byte after its magic, so that a lost byte costs one frame.
    """
    extra, checksum = _tools()
    frames: list[bytes] = []
    end, at, wrong = len(piece), 0, 0
    while wrong < MAX_WRONG_FRAMES:
        magic = _MAGIC.search(piece, at)
        if magic is None:
            break
        start = magic.start()
        statistics.skipped_bytes += start - at
        at = start
        version_2 = piece[start] == V2
        header = HEADER_V2 if version_2 else HEADER_V1
        if end - start < header:
            return frames, start
        flags = piece[start + 2] if version_2 else 0
        number = int.from_bytes(piece[start + 7 : start + 10], "little") if version_2 else piece[start + 5]
        body = start + header + piece[start + 1]
        size = body - start + CHECKSUM + (SIGNATURE if flags & SIGNED else 0)
        if flags & ~SIGNED or number not in extra:
            statistics.unknown += 1
        elif end - start < size:
            return frames, start
        elif checksum(piece[start + 1 : body] + bytes((extra[number],))) != int.from_bytes(piece[body : body + 2], "little"):
            statistics.wrong_checksum += 1
            wrong += 1
        else:
            frames.append(piece[start : start + size])
            at = start + size
            continue
        statistics.skipped_bytes += 1
        at = start + 1
    statistics.skipped_bytes += end - at
    return frames, end


def resequenced(frame: bytes, sequence: int, *, signed: bool) -> bytes:
    """An unsigned MAVLink 2 frame with another sequence number, the signed flag set or cleared, and a new checksum."""
    extra, checksum = _tools()
    changed = bytearray(frame[: HEADER_V2 + frame[1]])
    changed[2] = SIGNED if signed else 0
    changed[4] = sequence
    body = bytes(changed)
    number = int.from_bytes(body[7:10], "little")
    return body + checksum(body[1:] + bytes((extra[number],))).to_bytes(2, "little")


# Write telemetry logs (tlog) as ground stations write and read them.
#
# A record is the Unix time in microseconds, a big-endian unsigned 64-bit number whose two lowest bits hold the link
# number, followed by the frame.  `insenv.logs.formats.telemetry` reads these files.

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
