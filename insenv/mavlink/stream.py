"""The stream: a vehicle on a link, paced by the wall clock."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

from insenv.logs.formats.tlog import TlogWriter
from insenv.mavlink.commands import Outbox, answers, parameter_frames
from insenv.mavlink.messages.fields import Message
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire import Link
from insenv.mavlink.wire.frames import Statistics, resequenced
from insenv.mavlink.wire.link import Peer

# Pacing: when the next sample is due on the wall clock, and how late it is.
#
# Each sample has an absolute deadline, so that errors of sleeping do not accumulate.  A stream that falls behind catches
# up in bursts with pauses, so as not to overrun the receivers' buffers (a default UDP buffer holds 256 small messages).
# One that falls behind by more than `GIVE_UP_S` restarts its deadlines, and the simulation loses that time.

GIVE_UP_S = 5.0
BURST_MESSAGES = 90
"""Largest number of messages sent without a pause."""
BURST_PAUSE_S = 0.005
SLICE_S = 0.02
_LATEST = 20_000  # samples whose lateness is kept


class Pacer:
    """Deadlines of samples.

    interval: simulated time per sample (s).  speed: simulated seconds per second; 0: no deadlines.  clock, sleep: for
    tests.  slips: how often the deadlines were restarted.  slipped: seconds lost by that.
    """

    def __init__(
        self,
        interval: float,
        speed: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._interval, self._clock, self._sleep = interval, clock, sleep
        self.slips, self.slipped = 0, 0.0
        self._lateness: deque[float] = deque(maxlen=_LATEST)
        self.restart(speed)

    def restart(self, speed: float) -> None:
        """Restart the deadlines at this speed: the next sample is due one interval from now."""
        self.speed = speed
        self._begun = self._clock()
        self._samples = self._burst = 0

    def change(self, speed: float) -> None:
        """Continue at another speed: the part of the sample that has passed counts, so that changes never delay a sample."""
        passed = (self._clock() - self._begun) * self.speed / self._interval - self._samples
        part = min(max(passed, 0.0), 1.0) if self.speed > 0.0 and speed > 0.0 else 0.0
        self.restart(speed)
        if part:
            self._begun -= part * self._interval / speed

    def wait(self, meanwhile: Callable[[], bool]) -> bool:
        """Wait for the next deadline, and call `meanwhile` every `SLICE_S` until then.

        False when `meanwhile` returned False, which ends the wait: the sample is still due.
        """
        if self.speed == 0.0:
            return True
        self._samples += 1
        deadline = self._begun + self._samples * self._interval / self.speed
        left = deadline - self._clock()
        if left <= 0.0:
            self._lateness.append(-left)
            if -left > GIVE_UP_S:
                self.slips += 1
                self.slipped += -left
                self.restart(self.speed)
            return True
        self._burst = 0
        while left > SLICE_S:
            self._sleep(SLICE_S)
            if not meanwhile():
                self._samples -= 1
                return False
            left = deadline - self._clock()
        if left > 0.0:
            self._sleep(left)
        self._lateness.append(max(0.0, self._clock() - deadline))
        return True

    def sent(self, messages: int) -> None:
        """Count messages that were sent, and pause after `BURST_MESSAGES`."""
        if self.speed == 0.0:
            return
        self._burst += messages
        if self._burst >= BURST_MESSAGES:
            self._burst = 0
            self._sleep(BURST_PAUSE_S)

    def lateness(self, share: float) -> float:
        """Quantile (s) of the lateness of the latest samples; 0 before the first."""
        latest = sorted(self._lateness)
        return latest[min(len(latest) - 1, int(share * len(latest)))] if latest else 0.0


HEARTBEAT_S = 1.0
"""Largest wall time between HEARTBEATs, even when the simulation is paused or slow: clients time out after 3 s."""
PAUSE_S = 0.01
SERVE_EVERY = 10
"""Samples between two calls of `serve` at full speed."""
WATCH_S = 1.0
"""Wall time between two calls of a watcher: drawing a dashboard takes some 10 ms, which delays samples."""

Watch = Callable[["Stream"], None]
Stop = Callable[[], bool]
"""Whether to end; called at each sample and every `SLICE_S` of a longer wait."""


def never() -> bool:
    """Never end."""
    return False


class Recorder:
    """A telemetry log of a vehicle: its parameters, then messages sent, numbered consecutively, and messages received.

    count: number of the vehicle's own messages in the log.
    """

    def __init__(self, vehicle: Vehicle, log: TlogWriter | None) -> None:
        self.count = 0
        self._vehicle, self._log = vehicle, log

    def begin(self) -> None:
        """Begin the log with the parameters: a reader needs the lever arm of the antenna and the data sheet of the unit."""
        if self._log is not None and not self.count:
            for frame in parameter_frames(self._vehicle):
                self._write(frame)
                self.count += 1

    def sent(self, message: Message) -> None:
        """Write a message that a link has packed.  The log has a sequence of its own: answers to a peer leave no gap in it."""
        if self._log is not None:
            self._write(resequenced(bytes(message.get_msgbuf()), self.count % 256, signed=False))
            self.count += 1

    def received(self, message: Message, link: int) -> None:
        """Write a message that came over a link, by its number."""
        self._write(bytes(message.get_msgbuf()), link)

    def _write(self, frame: bytes, link: int = 0) -> None:
        if self._log is not None:
            self._log.write(self._vehicle.view.unix_us, frame, link)


class Stream:
    """A vehicle on one link or several.

    recorder: writes a telemetry log of all that is sent and received (`Recorder`).  sent, received: number of messages by
    name, answers included; a message counts once, for any number of clients.  interrupted: whether it was ended from outside.
    """

    def __init__(self, vehicle: Vehicle, link: Link | Sequence[Link], recorder: TlogWriter | None = None) -> None:
        self.vehicle = vehicle
        self.links = (link,) if isinstance(link, Link) else tuple(link)
        self.sent: Counter[str] = Counter()
        self.received: Counter[str] = Counter()
        self.outbox = Outbox()
        self.pacer = Pacer(vehicle.simulation.interval, vehicle.speed)
        self.interrupted = False
        self.log = Recorder(vehicle, recorder)
        self._begun = self._watched_at = time.monotonic()
        self._cpu = time.process_time()
        self._heartbeat_at = float("-inf")
        self._known_peers = 0
        self._stop: Stop = never

    def run(self, duration_s: float | None = None, watch: Watch | None = None, stop: Stop = never) -> None:
        """Stream for `duration_s` simulated seconds, until `stop` or Ctrl-C, and call `watch` every `WATCH_S`."""
        simulation = self.vehicle.simulation
        last = None if duration_s is None else simulation.samples + round(duration_s / simulation.interval)
        self._begun, self._cpu = time.monotonic(), time.process_time()
        self.pacer.restart(self.vehicle.speed)
        self._stop = stop
        try:
            self.log.begin()
            while (last is None or simulation.samples < last) and not stop():
                self.tick()
                if time.monotonic() - self._watched_at > WATCH_S:
                    self._watched_at = time.monotonic()
                    self.vehicle.view.load = min(self.cpu_share, 1.0)
                    if watch is not None:
                        watch(self)
            self.interrupted = self.interrupted or stop()
            self.serve()
            for _ in range(100):  # the remaining answers
                if not self.outbox.send(self._send_to):
                    break
        except KeyboardInterrupt:
            self.interrupted = True

    def tick(self) -> None:
        """Advance by one sample at its time, or wait briefly when paused, and answer received messages.

        A pause or another speed that is received meanwhile acts at once: the sample is then left to the next call.
        """
        vehicle, pacer = self.vehicle, self.pacer
        if vehicle.paused:
            time.sleep(PAUSE_S)
            self.serve()
            pacer.restart(vehicle.speed)
            return
        if vehicle.speed != pacer.speed:
            pacer.change(vehicle.speed)
        if not pacer.wait(self._serve_while_waiting):
            return
        sent = self.advance()
        if vehicle.speed > 0.0 or vehicle.simulation.samples % SERVE_EVERY == 0:
            self.serve()
        pacer.sent(sent)

    def advance(self) -> int:
        """Advance by one sample, send what is due, and return the number of messages."""
        messages = self.vehicle.step()
        for message in messages:
            self.send(message)
        return len(messages)

    def _serve_while_waiting(self) -> bool:
        """Serve, and return whether the deadline still holds."""
        self.serve()
        return self.vehicle.speed == self.pacer.speed and not self.vehicle.paused and not self._stop()

    def serve(self) -> None:
        """Receive, send pending answers, and send HEARTBEAT when it is due.  Does not block."""
        for number, link in enumerate(self.links):
            for peer, message in link.receive():
                self.received[message.get_type()] += 1
                self.log.received(message, number)
                self.outbox.put((link, peer), answers(self.vehicle, message))
        self.outbox.send(self._send_to)
        peers = len(self.peers)
        if time.monotonic() - self._heartbeat_at >= HEARTBEAT_S or peers > self._known_peers:
            self.send(self.vehicle.make("HEARTBEAT"))
            for text in self.vehicle.texts() if self.vehicle.paused else ():
                self.send(text)
        self._known_peers = peers

    def send(self, message: Message) -> None:
        """Send to all peers."""
        if message.get_type() == "HEARTBEAT":
            self._heartbeat_at = time.monotonic()
        for link in self.links:
            link.send(message)
        self._account(message)

    def _send_to(self, receiver: Any, message: Message) -> None:
        link, peer = receiver
        link.send_to(peer, message)
        self._account(message)

    def _account(self, message: Message) -> None:
        self.sent[message.get_type()] += 1
        self.log.sent(message)

    @property
    def all_links(self) -> tuple[Link, ...]:
        """The links, those that do not carry MAVLink included."""
        return self.links

    @property
    def peers(self) -> tuple[Peer, ...]:
        """The live peers of all links."""
        return tuple(peer for link in self.all_links for peer in link.peers)

    @property
    def statistics(self) -> Statistics:
        """Counts of all links together; a message sent over several of them counts once."""
        return replace(Statistics.total(link.statistics for link in self.all_links), sent_messages=sum(self.sent.values()))

    @property
    def wall_s(self) -> float:
        """Wall time (s) since the stream began."""
        return time.monotonic() - self._begun

    @property
    def cpu_share(self) -> float:
        """Share of one core that this process has used since the stream began."""
        return (time.process_time() - self._cpu) / max(self.wall_s, 1e-9)

    def summary(self) -> dict[str, Any]:
        """Counts and timing of the stream, as a JSON document."""
        view, simulation = self.vehicle.view, self.vehicle.simulation
        return {
            "scenario": simulation.plant.scenario.name,
            "estimator": simulation.estimator.id,
            "state": view.state,
            "simulated_s": simulation.time,
            "wall_s": self.wall_s,
            "cpu_share": self.cpu_share,
            "interrupted": self.interrupted,
            "sent": dict(sorted(self.sent.items())),
            "received": dict(sorted(self.received.items())),
            "link": asdict(self.statistics),
            "links": [
                {"address": str(link.address), "clients": [peer.name for peer in link.peers], **asdict(link.statistics)}
                for link in self.all_links
            ],
            "clients": [peer.name for peer in self.peers],
            "lateness_ms": {"p50": self.pacer.lateness(0.5) * 1e3, "p99": self.pacer.lateness(0.99) * 1e3},
            "slips": self.pacer.slips,
            "slipped_s": self.pacer.slipped,
            "bridged_samples": simulation.bridged,
            "saturated": dict(sorted(view.fields.saturated.items())),
            "refused": dict(sorted(view.fields.refused.items())),
            "answers_dropped": self.outbox.dropped,
        }
