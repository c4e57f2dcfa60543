"""Peers of a link, with bounded buffers of what they sent and of what is to be sent to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field

from insenv.mavlink.wire.frames import Statistics, split

INBOX_BYTES = 65536
"""Largest number of unread bytes kept of one peer."""
OUTBOX_BYTES = 262144
"""Largest number of unsent bytes kept for one peer: 30 s of telemetry at 9 kB/s, 5 s of all messages at 200 Hz."""


@dataclass(eq=False)
class Peer:
    """One peer of a link.

    name: "127.0.0.1:14550", or the serial device.  key: what identifies it.  fixed: named in the link's address, so
    that it never expires.  live: whether it gets what is sent to all.  since, heard: clock times (s) of its first and
    last verified message; heard is None before the first.  received: messages; sent, dropped: frames.  system,
    component: as its last message states.  sequence: of the next frame sent to it.  frames: checked and not yet read;
    outbox: unsent, `waiting` bytes in all.
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
        """Append a whole frame to the outbox; False when it is full, and the frame is then dropped."""
        if self.waiting + len(frame) > OUTBOX_BYTES:
            return False
        self.outbox.append(memoryview(frame))
        self.waiting += len(frame)
        return True

    def next_frame(self, statistics: Statistics) -> bytes | None:
        """The next checked frame from this peer, or None."""
        raise NotImplementedError

    def has_input(self) -> bool:
        """Whether `next_frame` may return a frame."""
        raise NotImplementedError


@dataclass(eq=False)
class DatagramPeer(Peer):
    """A peer that sends datagrams: each is split on its own, so that a truncated one does not affect the others."""

    datagrams: deque[bytes] = field(default_factory=deque, repr=False)
    stored: int = field(default=0, repr=False)

    def take(self, datagram: bytes) -> bool:
        """Store a datagram; False when the buffer is full."""
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
    """A peer that sends a stream of bytes, in pieces of any length."""

    inbox: bytearray = field(default_factory=bytearray, repr=False)
    fresh: bool = field(default=False, repr=False)

    def room(self) -> int:
        """The number of bytes that may be read now."""
        return INBOX_BYTES - len(self.inbox)

    def take(self, piece: bytes) -> None:
        """Store bytes that were read."""
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
