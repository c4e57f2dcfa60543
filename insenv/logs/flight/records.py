"""Records of a MAVLink telemetry log: a time (microseconds, 64 bits, big-endian) and a frame; broken bytes are skipped."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

V1, V2, SIGNED = 0xFE, 0xFD, 0x01
STAMP = 8
_MAGIC = re.compile(b"[\xfd\xfe]")


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
            magic = data[at + STAMP]
            head = 10 if magic == V2 else 6
            begin = at + STAMP
            if magic not in (V1, V2) or begin + head > end:
                at = self._resynchronised(at)
                continue
            if magic == V2:
                system, component = data[begin + 5], data[begin + 6]
                number = int.from_bytes(data[begin + 7 : begin + 10], "little")
                signature = 13 if data[begin + 2] & SIGNED else 0
            else:
                system, component, number, signature = data[begin + 3], data[begin + 4], data[begin + 5], 0
            body = begin + head + data[begin + 1]
            follows = body + 2 + signature
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
                yield Record(int.from_bytes(data[at:begin], "big"), system, component, number, data[begin + head : body])
            at = follows
        self.skipped += max(end - at, 0)

    def _resynchronised(self, at: int) -> int:
        """Offset at which the next record may begin: eight bytes before the next magic byte."""
        found = _MAGIC.search(self.data, at + STAMP + 1)
        after = len(self.data) if found is None else found.start() - STAMP
        self.skipped += after - at
        return after
