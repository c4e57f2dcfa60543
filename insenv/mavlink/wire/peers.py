"""The other ends of a link, and the bounded stores of what they sent and of what waits to be sent to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field

from insenv.mavlink.wire.frames import Statistics, split

INBOX_BYTES = 65536
"""Bytes of one peer that may wait to be looked at."""
OUTBOX_BYTES = 262144
"""Bytes that may wait for one peer that reads slowly: half a minute of a 9 kB/s telemetry, 5 s of all at 200 Hz."""


@dataclass(eq=False)
class Peer:
    """One other end.

    name: how it is told apart ("127.0.0.1:14550", the serial device).  fixed: named in the link's address, so it never
    expires.  live: it gets what is sent to all.  since, heard: clock times (s) of its first and last verified message, heard
    None before that.  received, sent, dropped: messages and frames.  system, component: what its last message says.
    sequence: of the next frame to it.
    """

    name: str
    key: Hashable
    since: float
    fixed: bool = False
    live: bool = False
    heard: float | None = None
    received: int = 0
    sent: int = 0
    dropped: int = 0
    system: int = 0
    component: int = 0
    sequence: int = 0
    frames: deque[bytes] = field(default_factory=deque, repr=False)
    outbox: deque[memoryview] = field(default_factory=deque, repr=False)
    waiting: int = field(default=0, repr=False)

    def push_frame(self, frame: bytes) -> bool:
        """Put a whole frame behind what waits to be sent; False when there is no room (the frame is then dropped)."""
        if self.waiting + len(frame) > OUTBOX_BYTES:
            return False
        self.outbox.append(memoryview(frame))
        self.waiting += len(frame)
        return True

    def next_frame(self, statistics: Statistics) -> bytes | None:
        """The next checked frame that it sent, or None."""
        raise NotImplementedError

    def has_input(self) -> bool:
        """Whether `next_frame` may find something."""
        raise NotImplementedError


@dataclass(eq=False)
class DatagramPeer(Peer):
    """A peer whose frames come in datagrams: each is taken apart on its own, so that a torn one spoils no other."""

    datagrams: deque[bytes] = field(default_factory=deque, repr=False)
    stored: int = field(default=0, repr=False)

    def take(self, datagram: bytes) -> bool:
        """Store a datagram; False when there is no room."""
        if self.stored + len(datagram) > INBOX_BYTES:
            return False
        self.datagrams.append(datagram)
        self.stored += len(datagram)
        return True

    def next_frame(self, statistics: Statistics) -> bytes | None:
        while not self.frames and self.datagrams:
            datagram = self.datagrams.popleft()
            self.stored -= len(datagram)
            found, used = split(datagram, statistics)
            statistics.skipped_bytes += len(datagram) - used
            self.frames.extend(found)
        return self.frames.popleft() if self.frames else None

    def has_input(self) -> bool:
        return bool(self.frames or self.datagrams)


@dataclass(eq=False)
class StreamPeer(Peer):
    """A peer whose frames come in a stream of bytes, torn anywhere."""

    inbox: bytearray = field(default_factory=bytearray, repr=False)
    fresh: bool = field(default=False, repr=False)

    def room(self) -> int:
        """Bytes that may be read now."""
        return INBOX_BYTES - len(self.inbox)

    def take(self, piece: bytes) -> None:
        """Store what was read."""
        self.inbox += piece
        self.fresh = True

    def next_frame(self, statistics: Statistics) -> bytes | None:
        if not self.frames and self.fresh:
            found, used = split(bytes(self.inbox), statistics)
            del self.inbox[:used]
            self.fresh = False
            self.frames.extend(found)
        return self.frames.popleft() if self.frames else None

    def has_input(self) -> bool:
        return bool(self.frames or self.fresh)
