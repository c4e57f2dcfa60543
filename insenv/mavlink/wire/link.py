"""A MAVLink link: send messages to every peer, receive verified messages, and never block.

A link owns its sockets.  It splits each peer's input separately, does a bounded amount of work per call and holds a
bounded number of peers.  It is for use by one thread.
"""

from __future__ import annotations

import select
import socket
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from insenv.base.errors import InputError
from insenv.logs.formats.tlog import sender
from insenv.mavlink.wire.frames import Message, Statistics, dialect, resequenced, split
from insenv.mavlink.wire.signing import Signing, Verdict

INBOX_BYTES = 65536
"""Largest number of unread bytes kept of one peer."""
OUTBOX_BYTES = 262144
"""Largest number of unsent bytes kept for one peer: 30 s of telemetry at 9 kB/s, 5 s of all messages at 200 Hz."""
FRESH_BYTES = 4096
"""Number of unsent bytes of one peer beyond which no more are kept of a protocol other than MAVLink."""
MESSAGES_PER_CALL = 64
"""Largest number of frames that one `receive` processes."""
MESSAGES_PER_PEER = 8
"""The same for one peer: 1600 per second at 200 Hz, more than tools send; a flood costs about 0.2 ms per call."""
MAX_ID = 255

Clock = Callable[[], float]


@dataclass(eq=False)
class Peer:
    """One peer of a link.

    name: "127.0.0.1:14550", or the serial device.  key: what identifies it.  fixed: named in the link's address, so
    that it never expires.  live: whether it gets what is sent to all.  device: the socket or serial line of a peer that
    sends a stream of bytes; None for one that sends datagrams.  since, heard: clock times (s) of its first and last
    verified message; heard is None before the first.  accepted: clock time (s) at which it last accepted bytes.
    received: messages; sent, dropped: frames.  system, component: as its last message states.  sequence: of the next
    frame sent to it.

    pieces: read and not yet split, `stored` bytes in all; rest: the start of a frame that the next piece of a stream
    completes; frames: checked and not yet processed; outbox: unsent, `waiting` bytes in all.
    """

    name: str
    key: Hashable
    since: float
    fixed: bool = False
    live: bool = False
    device: Any = None
    heard: float | None = None
    accepted: float = 0.0
    received: int = 0
    sent: int = 0
    dropped: int = 0
    system: int = 0
    component: int = 0
    sequence: int = 0
    pieces: deque[bytes] = field(default_factory=deque, repr=False)
    stored: int = field(default=0, repr=False)
    rest: bytes = field(default=b"", repr=False)
    frames: deque[bytes] = field(default_factory=deque, repr=False)
    outbox: deque[memoryview] = field(default_factory=deque, repr=False)
    waiting: int = field(default=0, repr=False)

    def take(self, piece: bytes) -> bool:
        """Store bytes that were read; False when the buffer is full."""
        if self.stored + len(piece) > INBOX_BYTES:
            return False
        self.pieces.append(piece)
        self.stored += len(piece)
        return True

    def next_frame(self, statistics: Statistics) -> bytes | None:
        """The next checked frame from this peer, or None.

        Each datagram is split on its own, so that a truncated one does not affect the others.
        """
        while not self.frames and self.pieces:
            piece = self.pieces.popleft()
            self.stored -= len(piece)
            piece = self.rest + piece
            frames, used = split(piece, statistics)
            self.frames.extend(frames)
            if self.device is not None:
                self.rest = piece[used:]
            else:
                statistics.skipped_bytes += len(piece) - used
        return self.frames.popleft() if self.frames else None

    def drain(self) -> bytes:
        """Remove and return the bytes that were read, of a peer that does not speak MAVLink."""
        data = b"".join(self.pieces)
        self.pieces.clear()
        self.stored = 0
        return data

    def has_input(self) -> bool:
        """Whether `next_frame` may return a frame."""
        return bool(self.frames or self.pieces)

    def queue(self, frame: bytes) -> bool:
        """Append a whole frame to the outbox; False when it is full, and the frame is then dropped."""
        if self.waiting + len(frame) > OUTBOX_BYTES:
            return False
        self.outbox.append(memoryview(frame))
        self.waiting += len(frame)
        return True


KINDS = ("udpout", "udpin", "tcpout", "tcpin", "serial")
LOOPBACK = "127.0.0.1"
BAUD = 57600
MAX_PORT = 65535


@dataclass(frozen=True)
class Address:
    """The address of a link.

    kind: one of `KINDS`.  host: name, IP address or serial device.  port: network port, or baud rate.
    """

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        where = f"{self.host}:{self.port}" if self.kind == "serial" else endpoint(self.host, self.port)
        return f"{self.kind}:{where}"


def endpoint(host: str, port: int) -> str:
    """``HOST:PORT``, an IPv6 host in brackets."""
    return f"{f'[{host}]' if ':' in host else host}:{port}"


def _form(kind: str) -> str:
    return "serial:DEVICE:BAUD" if kind == "serial" else f"{kind}:HOST:PORT"


def parse_address(text: str, baud: int = BAUD) -> Address:
    """Parse an address; an empty host is the loopback address 127.0.0.1, and a serial line without a baud rate has `baud`.

    Raises `InputError`.
    """
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        raise InputError(f"address {text!r}: must be {', '.join(map(_form, KINDS))}")
    host, colon, port = rest.rpartition(":")
    if kind == "serial":
        device, rate = (host, port) if colon and port.isdigit() else (rest, str(baud))
        no_rate = colon and device == rest and not Path(rest).exists()  # names of devices may hold colons
        if not device or no_rate or not 0 < int(rate) <= 100_000_000:
            raise InputError(f"address {text!r}: must be {_form(kind)}, such as serial:/dev/ttyUSB0:{baud}")
        return Address(kind, device, int(rate))
    lowest = 1 if kind.endswith("out") else 0
    if not port.isascii() or not port.isdigit() or not lowest <= int(port) <= MAX_PORT:
        raise InputError(f"address {text!r}: must be {_form(kind)} with a port from {lowest} to {MAX_PORT}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise InputError(f"address {text!r}: an IPv6 host is written in brackets, such as {kind}:[::1]:{port}")
    return Address(kind, host or LOOPBACK, int(port))


def resolve(address: Address, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    """Address family and socket address, IPv4 preferred.  Raises `InputError` when the host is unknown."""
    try:
        entries = socket.getaddrinfo(address.host, address.port, type=kind)
    except (OSError, UnicodeError) as error:
        raise InputError(f"address {address}: unknown host {address.host!r}: {error}") from None
    entries.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return entries[0][0], entries[0][4]


def check_sender(system: int, component: int) -> None:
    """Raise `InputError` unless both are from 1 to 255."""
    for name, value in (("system", system), ("component", component)):
        if not 1 <= value <= MAX_ID:
            raise InputError(f"{name} {value}: allowed is 1 to {MAX_ID}")


class Link(ABC):
    """Base class of the links, which `open_link` makes.

    address: with the actual port where port 0 was requested.  signing: None on an unsigned link.  system, component:
    the sender that messages state, 1 to 255.  clock: seconds.  number: the link number in its signatures, 0 to 255;
    None: that of `signing`.  statistics: counts.  Raises `InputError`: a wrong system or component, an unknown host, a
    port in use, a device that does not open.
    """

    def __init__(
        self, address: Address, signing: Signing | None, system: int, component: int, clock: Clock, number: int | None = None
    ) -> None:
        check_sender(system, component)
        self.address = address
        self.signing = signing
        self.statistics = Statistics()
        self.system, self.component, self.number = system, component, number
        self._clock = clock
        self._peers: list[Peer] = []
        self._turn = 0
        self._sequence = 0
        self._packer = dialect().MAVLink(None, srcSystem=system, srcComponent=component)
        self._decoder = dialect().MAVLink(None)
        self._open()

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The live peers, in the order of their arrival."""
        return tuple(peer for peer in self._peers if peer.live)

    # --- out -------------------------------------------------------------------------------------

    def send(self, message: Message) -> bytes:
        """Send to all live peers, and return the frame for a log.

        Raises `struct.error`, from pymavlink, for a value out of its field's range; messages made by
        `insenv.mavlink.messages.Fields` are within range.
        """
        return self._send(message, self.peers)

    def send_to(self, peer: Peer, message: Message) -> bytes:
        """Send an answer to one peer, live or not, and return the frame for a log."""
        return self._send(message, (peer,))

    def _send(self, message: Message, peers: tuple[Peer, ...]) -> bytes:
        # each peer and the log have a sequence of their own: an answer to one peer must not look like a loss to another
        self._packer.seq = self._sequence
        plain = message.pack(self._packer)
        by_sequence: dict[int, bytes] = {} if self.signing is not None else {self._sequence: plain}
        logged = self._framed(plain, self._sequence, by_sequence)
        self._sequence = (self._sequence + 1) % 256
        self.statistics.sent_messages += 1
        for peer in peers:
            frame = self._framed(plain, peer.sequence, by_sequence)
            peer.sequence = (peer.sequence + 1) % 256
            self._pass(peer, frame)
        return logged

    def send_bytes(self, frame: bytes, peer: Peer | None = None) -> None:
        """Send a frame of another protocol to one peer, or to all live ones.

        A frame is dropped for a peer that has not taken `FRESH_BYTES` yet: who begins to read late gets what is new.
        """
        self.statistics.sent_messages += 1
        for each in self.peers if peer is None else (peer,):
            self._pass(each, frame, keep=each.waiting <= FRESH_BYTES)

    def _pass(self, peer: Peer, frame: bytes, *, keep: bool = True) -> None:
        if keep and self._transmit(peer, frame):
            peer.sent += 1
            self.statistics.sent_frames += 1
            self.statistics.sent_bytes += len(frame)
        else:
            peer.dropped += 1
            self.statistics.dropped_frames += 1

    def _framed(self, plain: bytes, sequence: int, by_sequence: dict[int, bytes]) -> bytes:
        if sequence not in by_sequence:
            frame = resequenced(plain, sequence, signed=self.signing is not None)
            by_sequence[sequence] = frame if self.signing is None else self.signing.signed(frame, self.number)
        return by_sequence[sequence]

    # --- in --------------------------------------------------------------------------------------

    def receive(self) -> list[tuple[Peer, Message]]:
        """The messages received since the last call, each with its peer; does not block.

        They are complete, have a correct checksum and, on a signed link, a valid signature with a new signing time.
        There are at most `MESSAGES_PER_CALL`, and `MESSAGES_PER_PEER` of one peer; peers take turns.  Call it at every
        tick: it also accepts and drops peers and continues pending transmissions.
        """
        self._pump()
        messages: list[tuple[Peer, Message]] = []
        ready = deque(peer for peer in self._peers if peer.has_input())
        self._turn += 1
        ready.rotate(-self._turn)  # each call begins with another peer
        left = dict.fromkeys(ready, MESSAGES_PER_PEER)
        for _ in range(MESSAGES_PER_CALL):
            frame = None
            while ready and frame is None:
                peer = ready.popleft()
                frame = peer.next_frame(self.statistics)
            if frame is None:
                break
            left[peer] -= 1
            if left[peer]:
                ready.append(peer)
            message = self._verified(frame)
            if message is not None:
                self._heard(peer, message)
                messages.append((peer, message))
        return messages

    def receive_bytes(self) -> list[tuple[Peer, bytes]]:
        """The bytes received since the last call, each piece with its peer, of links for another protocol; does not block."""
        self._pump()
        return [(peer, peer.drain()) for peer in self._peers if peer.pieces]

    def _verified(self, frame: bytes) -> Message | None:
        if self.signing is not None:
            verdict = self.signing.verify(frame, ours=(self.system, self.component))
            if verdict is not Verdict.GOOD:
                setattr(self.statistics, verdict.value, getattr(self.statistics, verdict.value) + 1)
                return None
        elif sender(frame) == (self.system, self.component):
            self.statistics.reflected += 1
            return None
        try:
            return self._decoder.decode(bytearray(frame))
        except dialect().MAVError:
            self.statistics.undecodable += 1
            return None

    def _heard(self, peer: Peer, message: Message) -> None:
        now = self._clock()
        if not peer.live:
            peer.since, peer.sequence = now, self._sequence
        peer.heard, peer.live = now, True
        peer.received += 1
        peer.system, peer.component = message.get_srcSystem(), message.get_srcComponent()
        self.statistics.received_messages += 1

    def wait(self, timeout: float) -> None:
        """Wait until input may be available, or for `timeout` seconds."""
        if any(peer.has_input() for peer in self._peers):
            return
        sources = self._sources()
        if sources:
            select.select(sources, (), (), max(timeout, 0.0))
        else:
            time.sleep(max(timeout, 0.0))

    # --- defined by each kind of link ---------------------------------------------------------------

    @abstractmethod
    def _open(self) -> None:
        """Open the sockets or the device.  Raises `InputError`."""

    @abstractmethod
    def _sources(self) -> list[Any]:
        """The sockets or devices that `select` can watch for input."""

    @abstractmethod
    def _pump(self) -> None:
        """Read, accept, expire and flush: a bounded amount of work that does not block."""

    @abstractmethod
    def _transmit(self, peer: Peer, frame: bytes) -> bool:
        """Pass a frame to the operating system or queue it; False when it is dropped."""

    @abstractmethod
    def _close(self) -> None:
        """Close the sockets or the device."""

    def close(self) -> None:
        """Close the sockets and store the signing times."""
        try:
            self._close()
        finally:
            if self.signing is not None:
                self.signing.store()

    def __enter__(self) -> Link:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
