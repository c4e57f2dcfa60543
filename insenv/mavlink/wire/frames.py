"""MAVLink frames: find and check them in bytes, and give them another sequence number.

A frame that `split` returns is complete, has a known message number and a correct checksum; pymavlink decodes it afterwards.
Input is untrusted, so the work spent on invalid bytes is bounded.

Their layout: `insenv.logs.formats.tlog`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import Any

from insenv.logs.formats.tlog import HEADER_V2, MAGIC, SIGNED, V2, header_size, layout

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


MAX_WRONG_FRAMES = 16
"""Frames with a wrong checksum after which the rest of a piece is discarded."""


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
        magic = MAGIC.search(piece, at)
        if magic is None:
            break
        start = magic.start()
        statistics.skipped_bytes += start - at
        at = start
        if end - start < header_size(piece[start]):
            return frames, start
        flags, number, body, follows = layout(piece, start)
        if flags & ~SIGNED or number not in extra:
            statistics.unknown += 1
        elif end < follows:
            return frames, start
        elif checksum(piece[start + 1 : body] + bytes((extra[number],))) != int.from_bytes(piece[body : body + 2], "little"):
            statistics.wrong_checksum += 1
            wrong += 1
        else:
            frames.append(piece[start:follows])
            at = follows
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
