"""A MAVLink link: messages out to every peer, verified messages in, never waiting for anyone.

A link owns its sockets.  It takes datagrams one by one, keeps one parser a peer, does a bounded amount of work at each call,
and holds a bounded number of peers.  One thread uses it.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

from insenv.errors import InputError
from insenv.mavlink.wire.address import Address
from insenv.mavlink.wire.frames import Statistics, dialect, resequenced, sender
from insenv.mavlink.wire.peers import Peer
from insenv.mavlink.wire.signing import Signing, Verdict

MESSAGES_PER_CALL = 64
"""Frames that one `receive` looks at, at most."""
MESSAGES_PER_PEER = 8
"""And of one peer: 1600 a second at 200 Hz, more than tools send; decoding a flood takes about 0.2 ms of each call, no more."""
HIGHEST_ID = 255

Message = Any
"""A message object of pymavlink's `dialects.v20.common`."""
Clock = Callable[[], float]


class Link:
    """Base of the links; made by `open_link`.

    system, component: the sender that messages name.  statistics: counts.  peers: the live peers, in the order they came.
    """

    def __init__(self, address: Address, signing: Signing | None, system: int, component: int, clock: Clock) -> None:
        for name, value in (("system", system), ("component", component)):
            if not 1 <= value <= HIGHEST_ID:
                raise InputError(f"{name} {value}: allowed is 1 to {HIGHEST_ID}")
        self.address = address
        self.signing = signing
        self.statistics = Statistics()
        self.system, self.component = system, component
        self._clock = clock
        self._peers: list[Peer] = []
        self._turn = 0
        self._sequence = 0
        module = dialect()
        self._packer = module.MAVLink(None, srcSystem=system, srcComponent=component)
        self._decoder = module.MAVLink(None)
        self._error: type[Exception] = module.MAVError

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The live peers."""
        return tuple(peer for peer in self._peers if peer.live)

    # --- out -------------------------------------------------------------------------------------

    def send(self, message: Message) -> bytes:
        """Send to all live peers (to none, if there are none); the frame, for a log.

        Raises what pymavlink raises for a value beyond its field (`struct.error`): `insenv.mavlink.messages.fields` makes
        messages
        that fit.
        """
        return self._send(message, self.peers)

    def send_to(self, peer: Peer, message: Message) -> bytes:
        """Send to one peer, live or not: an answer; the frame, for a log."""
        return self._send(message, (peer,))

    def _send(self, message: Message, peers: tuple[Peer, ...]) -> bytes:
        # each peer, and the log, counts its own sequence, so that an answer to one is no lost message to another
        self._packer.seq = self._sequence
        plain = message.pack(self._packer)
        made: dict[int, bytes] = {} if self.signing is not None else {self._sequence: plain}
        frame = self._framed(plain, self._sequence, made)
        self._sequence = (self._sequence + 1) % 256
        self.statistics.sent_messages += 1
        for peer in peers:
            mine = self._framed(plain, peer.sequence, made)
            peer.sequence = (peer.sequence + 1) % 256
            if self._transmit(peer, mine):
                peer.sent += 1
                self.statistics.sent_frames += 1
                self.statistics.sent_bytes += len(mine)
            else:
                peer.dropped += 1
                self.statistics.dropped_frames += 1
        return frame

    def _framed(self, plain: bytes, sequence: int, made: dict[int, bytes]) -> bytes:
        if sequence not in made:
            frame = resequenced(plain, sequence, signed=self.signing is not None)
            made[sequence] = frame if self.signing is None else self.signing.signed(frame)
        return made[sequence]

    # --- in --------------------------------------------------------------------------------------

    def receive(self) -> list[tuple[Peer, Message]]:
        """What came, at most `MESSAGES_PER_CALL` messages and `MESSAGES_PER_PEER` of one peer, the peers in turns: whole, with
        the right checksum and, on a signed link, the right signature at a new signing time.  Never waits.  Call it at every
        tick: it also accepts and drops peers and goes on with what waits to be sent.
        """
        self._pump()
        messages: list[tuple[Peer, Message]] = []
        waiting = [peer for peer in self._peers if peer.has_input()]
        self._turn += 1  # another peer begins at each call
        at, taken = self._turn, 0
        looked: dict[Peer, int] = {}
        while waiting and taken < MESSAGES_PER_CALL:
            at %= len(waiting)
            peer = waiting[at]
            frame = peer.next_frame(self.statistics) if looked.get(peer, 0) < MESSAGES_PER_PEER else None
            if frame is None:
                del waiting[at]
                continue
            taken += 1
            looked[peer] = looked.get(peer, 0) + 1
            message = self._verified(frame)
            if message is not None:
                self._heard(peer, message)
                messages.append((peer, message))
            at += 1
        return messages

    def _verified(self, frame: bytes) -> Message | None:
        if self.signing is not None:
            verdict = self.signing.verify(frame, own=(self.system, self.component))
            if verdict is not Verdict.GOOD:
                setattr(self.statistics, verdict.value, getattr(self.statistics, verdict.value) + 1)
                return None
        elif sender(frame).system == self.system and sender(frame).component == self.component:
            self.statistics.reflected += 1
            return None
        try:
            return self._decoder.decode(bytearray(frame))
        except self._error:
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
        """Wait until there may be something to receive, or `timeout` seconds have passed."""
        if any(peer.has_input() for peer in self._peers):
            return
        sources = self._sources()
        if sources:
            select.select(sources, (), (), max(timeout, 0.0))
        else:
            time.sleep(max(timeout, 0.0))

    # --- what the kinds of links do ----------------------------------------------------------------

    def _sources(self) -> list[Any]:
        """What `select` can watch for input."""
        raise NotImplementedError

    def _pump(self) -> None:
        """Read, accept, expire, flush: a bounded amount of work that does not wait."""
        raise NotImplementedError

    def _transmit(self, peer: Peer, frame: bytes) -> bool:
        """Hand a frame to the system, or keep it to be sent; False when it is dropped."""
        raise NotImplementedError

    def _close(self) -> None:
        raise NotImplementedError

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
