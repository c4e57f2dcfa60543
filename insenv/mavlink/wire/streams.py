"""Links over streams of bytes: TCP, as server or client, and serial lines.

What a peer does not read waits in a bounded store; then whole frames are dropped, for that peer alone.  A TCP peer that has
taken nothing for some time is disconnected.
"""

from __future__ import annotations

import os
import select
import socket
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any

from insenv.errors import InputError
from insenv.installing import install_extra
from insenv.mavlink.wire.address import Address, resolve
from insenv.mavlink.wire.link import Clock, Link
from insenv.mavlink.wire.peers import Peer, StreamPeer
from insenv.mavlink.wire.signing import Signing

MOST_CLIENTS = 16
STALLED_S = 30.0
"""A client that has taken nothing for so long, with something waiting, is disconnected."""
RETRY_S = 1.0
CONNECT_S = 5.0
ACCEPTS_PER_CALL = 8
READ_BYTES = 16384
"""Bytes read from one peer at one call: no more than what 64 messages a call use up, some tenfold."""


@dataclass(eq=False)
class _End(StreamPeer):
    """A peer with its socket or line, and when it last took something (clock, s)."""

    device: Any = None
    took: float = 0.0


class _StreamLink(Link):
    """What TCP and serial lines share: reading into and writing from a peer's stores."""

    @abstractmethod
    def _read(self, end: _End, size: int) -> bytes | None:
        """Up to `size` bytes, b"" when there are none now, None when it is gone."""

    @abstractmethod
    def _write(self, end: _End, data: memoryview) -> int | None:
        """How many bytes were taken, None when it is gone."""

    @abstractmethod
    def _lost(self, end: _End) -> None:
        """The other end is gone."""

    def _transmit(self, peer: Peer, frame: bytes) -> bool:
        assert isinstance(peer, _End)
        if peer not in self._peers or not peer.push_frame(frame):
            return False
        self._flush(peer)
        return True

    def _flush(self, end: _End) -> bool:
        """Send what waits, as far as it is taken; False when the other end is gone."""
        while end.outbox:
            data = end.outbox[0]
            taken = self._write(end, data)
            if taken is None:
                self._lost(end)
                return False
            if taken:
                end.took = self._clock()
                end.waiting -= taken
            if taken < len(data):
                end.outbox[0] = data[taken:]
                return True
            end.outbox.popleft()
        return True

    def _exchange(self, end: _End) -> None:
        if not end.outbox:
            end.took = self._clock()
        if not self._flush(end):
            return
        if self._clock() - end.took > STALLED_S:
            self._lost(end)
            return
        size = min(READ_BYTES, end.room())
        if size > 0 and not end.has_input():
            piece = self._read(end, size)
            if piece is None:
                self._lost(end)
            elif piece:
                self.statistics.received_bytes += len(piece)
                end.take(piece)

    def _sources(self) -> list[Any]:
        return [peer.device for peer in self._peers if isinstance(peer, _End)]


class _TcpLink(_StreamLink):
    def _read(self, end: _End, size: int) -> bytes | None:
        try:
            return end.device.recv(size) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def _write(self, end: _End, data: memoryview) -> int | None:
        try:
            return end.device.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return None

    def _lost(self, end: _End) -> None:
        end.device.close()
        end.live = False
        if end in self._peers:
            self._peers.remove(end)

    def _joined(self, device: socket.socket, name: str, *, fixed: bool) -> None:
        device.setblocking(False)
        device.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        now = self._clock()
        peer = _End(name, name, now, fixed=fixed, live=True, sequence=self._sequence, device=device, took=now)
        self._peers.append(peer)

    def _close_peers(self) -> None:
        for peer in list(self._peers):
            assert isinstance(peer, _End)
            self._flush(peer)
            peer.device.close()
        self._peers.clear()


class TcpServerLink(_TcpLink):
    """``tcpin``: every client that connects is a peer."""

    def __init__(self, address: Address, signing: Signing | None, system: int, component: int, clock: Clock) -> None:
        super().__init__(address, signing, system, component, clock)
        family, place = resolve(address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            self._listener.setblocking(False)
            if hasattr(socket, "SO_EXCLUSIVEADDRUSE"):  # Windows, where the other option lets two servers share a port
                self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
            else:
                self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind(place)
            self._listener.listen(ACCEPTS_PER_CALL)
            self.address = replace(address, port=self._listener.getsockname()[1])
        except OSError as error:
            self._listener.close()
            raise InputError(f"address {address}: {error.strerror or error}") from None

    def _pump(self) -> None:
        for _ in range(ACCEPTS_PER_CALL):
            try:
                device, source = self._listener.accept()
            except OSError:  # nobody, or gone again
                break
            if len(self._peers) >= MOST_CLIENTS:
                device.close()
                self.statistics.refused_peers += 1
                continue
            host = f"[{source[0]}]" if ":" in source[0] else source[0]
            self._joined(device, f"{host}:{source[1]}", fixed=False)
        for peer in list(self._peers):
            assert isinstance(peer, _End)
            self._exchange(peer)

    def _sources(self) -> list[Any]:
        return [self._listener, *super()._sources()]

    def _close(self) -> None:
        self._close_peers()
        self._listener.close()


class TcpClientLink(_TcpLink):
    """``tcpout``: connects, and again when the connection is lost."""

    def __init__(self, address: Address, signing: Signing | None, system: int, component: int, clock: Clock) -> None:
        super().__init__(address, signing, system, component, clock)
        self._family, self._place = resolve(address, socket.SOCK_STREAM)
        self._trial: socket.socket | None = None
        self._next = self._began = self._clock()
        self._pump()

    def _pump(self) -> None:
        if not self._peers:
            self._connect()
        for peer in list(self._peers):
            assert isinstance(peer, _End)
            self._exchange(peer)

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
        if trial.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._give_up()
            return
        try:
            trial.getpeername()
        except OSError:  # not yet
            if now - self._began > CONNECT_S:
                self._give_up()
            return
        if trial.getpeername() == trial.getsockname():  # TCP can meet itself where nobody listens
            self._give_up()
            return
        self._trial = None
        self._joined(trial, str(self.address).partition(":")[2], fixed=True)

    def _give_up(self) -> None:
        if self._trial is not None:
            self._trial.close()
            self._trial = None

    def _close(self) -> None:
        self._give_up()
        self._close_peers()


class SerialLink(_StreamLink):
    """``serial``: one peer, for ever."""

    def __init__(self, address: Address, signing: Signing | None, system: int, component: int, clock: Clock) -> None:
        super().__init__(address, signing, system, component, clock)
        try:
            import serial
        except ModuleNotFoundError:
            message = f"address {address}: pyserial is not installed: {install_extra('serial')}"
            raise InputError(message) from None
        try:
            line = serial.Serial(address.host, address.port, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            raise InputError(f"address {address}: the device does not open: {error}") from None
        self._gone: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        self._peers.append(_End(address.host, address.host, clock(), fixed=True, live=True, device=line, took=clock()))

    def _pump(self) -> None:
        for peer in self._peers:
            assert isinstance(peer, _End)
            self._exchange(peer)

    def _read(self, end: _End, size: int) -> bytes | None:
        try:
            return end.device.read(size)
        except self._gone:
            return b""

    def _write(self, end: _End, data: memoryview) -> int | None:
        try:
            # where nothing can be written now, pyserial tries on and on
            if os.name == "posix" and not select.select((), (end.device,), (), 0)[1]:
                return 0
            return end.device.write(data) or 0
        except self._gone:
            return 0

    def _sources(self) -> list[Any]:
        return super()._sources() if os.name == "posix" else []  # elsewhere only sockets can be watched

    def _lost(self, end: _End) -> None:
        # a line has nobody at its end to disconnect: what waits is thrown away, and it goes on
        end.outbox.clear()
        end.waiting, end.took = 0, self._clock()

    def _close(self) -> None:
        for peer in self._peers:
            assert isinstance(peer, _End)
            peer.device.close()
