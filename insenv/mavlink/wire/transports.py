"""Links over TCP, as server or client, serial lines and UDP.

Frames that a peer does not read are kept in a bounded buffer; when it is full, whole frames are dropped for that peer
only.  A TCP peer that reads nothing for some time is disconnected.
"""

from __future__ import annotations

import ipaddress
import os
import select
import socket
import time
from abc import abstractmethod
from contextlib import suppress
from dataclasses import replace
from typing import Any

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.mavlink.wire.link import Clock, Link, Peer, endpoint, parse_address, resolve
from insenv.mavlink.wire.signing import Signing

MAX_CLIENTS = 16
STALLED_S = 30.0
"""A client that reads nothing for so long while frames are pending is disconnected."""
RETRY_S = 1.0
CONNECT_S = 5.0
ACCEPTS_PER_CALL = 8
READ_BYTES = 16384
"""Bytes read from one peer per call: some ten times what 64 messages consume."""


class _StreamLink(Link):
    """What TCP and serial lines share: exchange with the buffers of a peer."""

    @abstractmethod
    def _read(self, peer: Peer) -> bytes | None:
        """Read up to `READ_BYTES`: b"" when there are none, None when the peer is gone."""

    @abstractmethod
    def _write(self, peer: Peer, data: memoryview) -> int | None:
        """Write, and return the number of bytes accepted: None when the peer is gone."""

    @abstractmethod
    def _lost(self, peer: Peer) -> None:
        """Handle the loss of a peer."""

    def _transmit(self, peer: Peer, frame: bytes) -> bool:
        if peer not in self._peers or not peer.queue(frame):
            return False
        self._flush(peer)
        return True

    def _flush(self, peer: Peer) -> bool:
        """Send pending frames as far as they are accepted; False when the peer is gone."""
        while peer.outbox:
            data = peer.outbox[0]
            count = self._write(peer, data)
            if count is None:
                self._lost(peer)
                return False
            if count:
                peer.accepted = self._clock()
                peer.waiting -= count
            if count < len(data):
                peer.outbox[0] = data[count:]
                return True
            peer.outbox.popleft()
        return True

    def _pump(self) -> None:
        for peer in list(self._peers):
            if not peer.outbox:
                peer.accepted = self._clock()
            if not self._flush(peer):
                continue
            stalled = self._clock() - peer.accepted > STALLED_S
            piece = b"" if stalled or peer.has_input() else self._read(peer)
            if stalled or piece is None:
                self._lost(peer)
            elif piece:
                self.statistics.received_bytes += len(piece)
                peer.take(piece)

    def _add(self, name: str, device: Any, *, fixed: bool) -> None:
        now = self._clock()
        self._peers.append(Peer(name, name, now, fixed=fixed, live=True, sequence=self._sequence, device=device, accepted=now))

    def _sources(self) -> list[Any]:
        return [peer.device for peer in self._peers]

    def _close(self) -> None:
        for peer in list(self._peers):
            self._flush(peer)
            peer.device.close()
        self._peers.clear()


class _TcpLink(_StreamLink):
    def _read(self, peer: Peer) -> bytes | None:
        try:
            return peer.device.recv(READ_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def _write(self, peer: Peer, data: memoryview) -> int | None:
        try:
            return int(peer.device.send(data))
        except BlockingIOError:
            return 0
        except OSError:
            return None

    def _lost(self, peer: Peer) -> None:
        peer.device.close()
        peer.live = False
        if peer in self._peers:
            self._peers.remove(peer)

    def _connected(self, device: socket.socket, name: str, *, fixed: bool) -> None:
        device.setblocking(False)
        device.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._add(name, device, fixed=fixed)


class TcpServerLink(_TcpLink):
    """``tcpin``: every client that connects is a peer."""

    def _open(self) -> None:
        family, place = resolve(self.address, socket.SOCK_STREAM)
        try:
            both = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
            self._listener = socket.create_server(place, family=family, backlog=ACCEPTS_PER_CALL, dualstack_ipv6=both)
        except OSError as error:
            raise InputError(f"address {self.address}: {error.strerror or error}") from None
        self._listener.setblocking(False)
        self.address = replace(self.address, port=self._listener.getsockname()[1])

    def _pump(self) -> None:
        for _ in range(ACCEPTS_PER_CALL):
            try:
                device, source = self._listener.accept()
            except OSError:  # no client, or one that is gone already
                break
            if len(self._peers) >= MAX_CLIENTS:
                device.close()
                self.statistics.refused_peers += 1
                continue
            self._connected(device, endpoint(*source[:2]), fixed=False)
        super()._pump()

    def _sources(self) -> list[Any]:
        return [self._listener, *super()._sources()]

    def _close(self) -> None:
        super()._close()
        self._listener.close()


class TcpClientLink(_TcpLink):
    """``tcpout``: connects, and reconnects when the connection is lost."""

    def _open(self) -> None:
        self._family, self._place = resolve(self.address, socket.SOCK_STREAM)
        self._trial: socket.socket | None = None
        self._next = self._began = self._clock()
        self._pump()

    def _pump(self) -> None:
        if not self._peers:
            self._connect()
        super()._pump()

    def _connect(self) -> None:
        now = self._clock()
        if self._trial is None:
            if now < self._next:
                return
            self._next, self._began = now + RETRY_S, now
            self._trial = socket.socket(self._family, socket.SOCK_STREAM)
            self._trial.setblocking(False)
            self._trial.connect_ex(self._place)
        trial = self._trial
        try:
            failed = bool(trial.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR))
            # TCP can connect to itself where nobody listens
            failed = failed or trial.getpeername() == trial.getsockname()
        except OSError:  # not connected yet
            if now - self._began > CONNECT_S:
                self._give_up()
            return
        if failed:
            self._give_up()
            return
        self._trial = None
        self._connected(trial, endpoint(self.address.host, self.address.port), fixed=True)

    def _give_up(self) -> None:
        if self._trial is not None:
            self._trial.close()
            self._trial = None

    def _close(self) -> None:
        self._give_up()
        super()._close()


class SerialLink(_StreamLink):
    """``serial``: one permanent peer."""

    def _open(self) -> None:
        address = self.address
        need(f"address {address}", "serial", package="pyserial", extra="serial")
        import serial

        try:
            line = serial.Serial(address.host, address.port, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            raise InputError(f"address {address}: the device does not open: {error}") from None
        self._add(address.host, line, fixed=True)

    def _read(self, peer: Peer) -> bytes | None:
        with suppress(OSError):  # which pyserial's own exceptions are
            return bytes(peer.device.read(READ_BYTES))
        return b""

    def _write(self, peer: Peer, data: memoryview) -> int | None:
        with suppress(OSError):
            # pyserial would retry for ever while the line accepts nothing
            if os.name != "posix" or select.select((), (peer.device,), (), 0)[1]:
                return peer.device.write(data) or 0
        return 0

    def _sources(self) -> list[Any]:
        return super()._sources() if os.name == "posix" else []  # elsewhere select watches sockets only

    def _lost(self, peer: Peer) -> None:
        # a serial line cannot be disconnected: discard what is pending and continue
        peer.outbox.clear()
        peer.waiting, peer.accepted = 0, self._clock()


MAX_PEERS = 16
MAX_STRANGERS = 64
"""Largest number of senders that are not peers: no verified message, or no free place.  More replace the oldest."""
EXPIRY_S = 20.0
"""A peer that has been silent for so long is dropped: ground stations send a heartbeat each second."""
READS_PER_CALL = 512
MAX_DATAGRAM_BYTES = 4096
"""Bytes of the largest datagram accepted: routers put several frames into one."""
BUFFER_BYTES = 1 << 20


class DatagramLink(Link):
    """``udpin`` and ``udpout``.

    ``udpout`` has one fixed peer, and receives from others only where that is a broadcast or multicast address.
    """

    def _open(self) -> None:
        family, target = resolve(self.address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._connected = False
        self._by_key: dict[Any, Peer] = {}
        try:
            self._socket.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                self._socket.setsockopt(socket.SOL_SOCKET, option, BUFFER_BYTES)
            if self.address.kind == "udpin":
                self._socket.bind(target)
                self.address = replace(self.address, port=self._socket.getsockname()[1])
            else:
                self._aim(target)
        except OSError as error:
            self._socket.close()
            raise InputError(f"address {self.address}: {error.strerror or error}") from None

    def _aim(self, target: Any) -> None:
        if not ipaddress.ip_address(target[0].partition("%")[0]).is_multicast:
            try:
                # a connected socket receives from this place only
                self._socket.connect(target)
                self._connected = True
            except PermissionError:  # a broadcast address
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._add(endpoint(self.address.host, self.address.port), target, fixed=True)

    def _add(self, name: str, place: Any, *, fixed: bool = False) -> Peer:
        peer = self._by_key[place] = Peer(name, place, self._clock(), fixed=fixed, live=fixed)
        self._peers.append(peer)
        return peer

    def _transmit(self, peer: Peer, frame: bytes) -> bool:
        for _ in range(2):
            try:
                if self._connected:
                    self._socket.send(frame)
                else:
                    self._socket.sendto(frame, peer.key)  # type: ignore[call-overload]
            except ConnectionError:
                continue  # the report of an earlier datagram that was refused; this one has not been sent yet
            except OSError:
                return False  # a full buffer, or no network
            return True
        return False

    def _pump(self) -> None:
        self._expire()
        for _ in range(READS_PER_CALL):
            try:
                datagram, source = self._socket.recvfrom(MAX_DATAGRAM_BYTES + 1)
            except BlockingIOError:
                return
            except OSError:
                continue  # the report of a datagram that was refused
            self.statistics.received_bytes += len(datagram)
            if len(datagram) > MAX_DATAGRAM_BYTES:
                self.statistics.oversized += 1
                continue
            peer = self._peers[0] if self._connected else self._from(source)
            if not peer.take(datagram):
                self.statistics.overflowed += 1

    def _from(self, source: Any) -> Peer:
        if source in self._by_key:
            return self._by_key[source]
        strangers = [peer for peer in self._peers if not peer.live]
        if len(strangers) >= MAX_STRANGERS:
            self._forget(strangers[0])
            self.statistics.refused_peers += 1
        return self._add(endpoint(*source[:2]), source)

    def _heard(self, peer: Peer, message: Any) -> None:
        room = peer.live or sum(p.live for p in self._peers) < MAX_PEERS
        super()._heard(peer, message)
        if not room:
            # it is answered but gets no telemetry: present peers keep their places
            peer.live = False
            self.statistics.refused_peers += 1

    def _expire(self) -> None:
        now = self._clock()
        for peer in [p for p in self._peers if not p.fixed and now - (p.since if p.heard is None else p.heard) > EXPIRY_S]:
            self._forget(peer)

    def _forget(self, peer: Peer) -> None:
        self._peers.remove(peer)
        del self._by_key[peer.key]

    def _sources(self) -> list[Any]:
        return [self._socket]

    def _close(self) -> None:
        self._socket.close()


_LINKS: dict[str, type[Link]] = {
    "udpout": DatagramLink,
    "udpin": DatagramLink,
    "tcpin": TcpServerLink,
    "tcpout": TcpClientLink,
    "serial": SerialLink,
}


def open_link(
    address: str,
    *,
    signing: Signing | None = None,
    system: int = 1,
    component: int = 1,
    clock: Clock = time.monotonic,
    number: int | None = None,
) -> Link:
    """Open a link.

    address: ``udpout:HOST:PORT`` sends to one place; ``udpin:HOST:PORT`` to everyone who sends MAVLink to it;
    ``tcpin:HOST:PORT`` to every client; ``tcpout:HOST:PORT`` connects, and reconnects when the connection is lost;
    ``serial:DEVICE:BAUD``.  Without HOST: the loopback address.  Port 0 of an ``in`` address selects a free port
    (`link.address.port`).  signing: signs outgoing frames and rejects all that are not signed with the same key.
    system, component: the sender that messages state, 1 to 255.  clock: seconds, for the expiry of peers.  number: the
    link number in its signatures, where several links share one `signing`.  Raises `InputError`: a wrong address, an
    unknown host, a port in use, a device that does not open, pyserial not installed.
    """
    parsed = parse_address(address)
    return _LINKS[parsed.kind](parsed, signing, system, component, clock, number)
