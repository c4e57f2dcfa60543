"""Pending answers: a bounded queue for each peer, sent a few at a time so that the stream keeps its pace."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator

from insenv.mavlink.answers import Answers
from insenv.mavlink.messages.fields import Message

WAITING = 200
"""Largest number of pending answers for one peer; more are dropped and counted."""
AT_ONCE = 16
"""Largest number of answers that one `send` sends, to all peers together."""
PEERS = 64


class Outbox:
    """Pending answers by peer.

    A long answer (all parameters) is made while it is sent.  When it is requested again it restarts, so that each peer
    has at most one.  dropped: answers that did not fit.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._queues: dict[Hashable, deque[Message]] = {}
        self._long: dict[Hashable, Iterator[Message]] = {}
        self._turn: deque[Hashable] = deque()

    def put(self, peer: Hashable, messages: Answers) -> None:
        """Queue `messages` for `peer`."""
        if not isinstance(messages, (list, tuple)):
            if peer in self._turn or self._room():
                self._long[peer] = iter(messages)
                self._queue(peer)
            return
        for message in messages:
            if message is None:
                continue
            if (peer not in self._turn and not self._room()) or len(self._queue(peer)) >= WAITING:
                self.dropped += 1
            else:
                self._queue(peer).append(message)

    def send(self, send_to: Callable[[Hashable, Message], object]) -> int:
        """Send some answers, the peers in turn, and return their number."""
        sent = 0
        while self._turn and sent < AT_ONCE:
            peer = self._turn[0]
            message = self._next(peer)
            if message is None:
                self._turn.popleft()
                self._queues.pop(peer, None)
                continue
            send_to(peer, message)
            sent += 1
            self._turn.rotate(-1)
        return sent

    def _next(self, peer: Hashable) -> Message | None:
        queue = self._queues.get(peer)
        if queue:
            return queue.popleft()
        message = next(self._long[peer], None) if peer in self._long else None
        if message is None:
            self._long.pop(peer, None)
        return message

    def _queue(self, peer: Hashable) -> deque[Message]:
        if peer not in self._queues:
            self._queues[peer] = deque()
            self._turn.append(peer)
        return self._queues[peer]

    def _room(self) -> bool:
        return len(self._turn) < PEERS
