"""Links over UDP: to one place, or to everyone who sends MAVLink to our port."""

from __future__ import annotations

import ipaddress
import socket
from contextlib import suppress
from dataclasses import replace
from typing import Any

from insenv.base.errors import InputError
from insenv.mavlink.wire.address import endpoint, resolve
from insenv.mavlink.wire.link import Link
from insenv.mavlink.wire.peers import DatagramPeer, Peer

MOST_PEERS = 16
MOST_STRANGERS = 64
"""Largest number of senders that are not peers: no verified message, or no free place.  More replace the oldest."""
EXPIRY_S = 20.0
"""A peer that has been silent for so long is dropped: ground stations send a heartbeat each second."""
READS_PER_CALL = 512
LARGEST = 4096
"""Bytes of the largest datagram accepted: routers put several frames into one."""
BUFFER_BYTES = 1 << 20


class DatagramLink(Link):
    """``udpin`` and ``udpout``.

    ``udpout`` has one fixed peer, and receives from others only where that is a broadcast or multicast address.
    """

    def _open(self) -> None:
        address = self.address
        family, target = resolve(address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._connected = False
        self._by_key: dict[Any, DatagramPeer] = {}
        self._fixed: DatagramPeer | None = None
        try:
            self._socket.setblocking(False)
            for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
                self._socket.setsockopt(socket.SOL_SOCKET, option, BUFFER_BYTES)
            if address.kind == "udpin":
                self._socket.bind(target)
                self.address = replace(address, port=self._socket.getsockname()[1])
            else:
                self._aim(target)
        except OSError as error:
            self._socket.close()
            raise InputError(f"address {address}: {error.strerror or error}") from None

    def _aim(self, target: Any) -> None:
        if not ipaddress.ip_address(target[0].partition("%")[0]).is_multicast:
            try:
                # a connected socket receives from this place only
                self._socket.connect(target)
                self._connected = True
            except PermissionError:  # a broadcast address
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        peer = DatagramPeer(endpoint(self.address.host, self.address.port), target, self._clock(), fixed=True, live=True)
        self._peers.append(peer)
        self._by_key[target] = self._fixed = peer

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
                datagram, source = self._socket.recvfrom(LARGEST + 1)
            except BlockingIOError:
                return
            except OSError:
                continue  # the report of a datagram that was refused
            self.statistics.received_bytes += len(datagram)
            if len(datagram) > LARGEST:
                self.statistics.oversized += 1
                continue
            peer = self._fixed if self._fixed is not None and self._connected else self._from(source)
            if not peer.take(datagram):
                self.statistics.overflowed += 1

    def _from(self, source: Any) -> DatagramPeer:
        known = self._by_key.get(source)
        if known is not None:
            return known
        strangers = [peer for peer in self._peers if not peer.live]
        if len(strangers) >= MOST_STRANGERS:
            self._forget(strangers[0])
            self.statistics.refused_peers += 1
        peer = DatagramPeer(endpoint(*source[:2]), source, self._clock())
        self._peers.append(peer)
        self._by_key[source] = peer
        return peer

    def _heard(self, peer: Peer, message: Any) -> None:
        room = peer.live or sum(p.live for p in self._peers) < MOST_PEERS
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
        with suppress(KeyError):
            del self._by_key[peer.key]

    def _sources(self) -> list[Any]:
        return [self._socket]

    def _close(self) -> None:
        self._socket.close()
