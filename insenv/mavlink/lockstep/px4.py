"""Lockstep with PX4: the simulator listens on TCP 4560, sends HIL_SENSOR and receives HIL_ACTUATOR_CONTROLS.

PX4 has no clock of its own in this mode: the time of HIL_SENSOR is its time.  While it starts, PX4 reads sensors and
answers nothing, so the first steps do not wait for it but follow the wall clock.  From its first answer with the
lockstep flag (bit 0) on, each step whose answer is due waits for it (`Cadence`), and the pair runs as fast as it can, or
at the speed that was asked for.
https://docs.px4.io/main/en/simulation/
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from copy import copy
from typing import Any

from insenv.base.errors import InputError
from insenv.mavlink.lockstep.contract import Act, Controls, Lockstep, ignore
from insenv.mavlink.messages import DEFAULT_HZ
from insenv.mavlink.stream import Pacer, Stop
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire import Link, open_link
from insenv.mavlink.wire.link import Clock, parse_address

CHANNELS = (1, 0, 3, 2)
"""Channels, from 0, of pitch, roll, throttle and yaw."""
ADDRESS = "tcpin:127.0.0.1:4560"
COMPONENT = 200
"""The simulator's component; PX4 is component 1 of the same system."""
LOCKSTEP = 0x1
"""HIL_ACTUATOR_CONTROLS_FLAGS: whether PX4 runs in lockstep."""
IMU_BITS = 0b111111
"""Bits of accelerometer and gyroscope in `fields_updated`."""
ARMED = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""

Messages = Callable[[], Iterable[Any]]
"""Advances by one sample and gives the messages to send, a HIL_SENSOR among them; each is sent before the next is taken."""
Answer = Callable[[Any], Iterable[Any]]
"""Answers a received message, such as a request for an interval, by messages."""


def px4_rates(sample_hz: float) -> dict[str, float]:
    """Rates (Hz) by message for PX4: sensors at each sample, each fix, the truth, and nothing else."""
    sent = {name: DEFAULT_HZ[name] for name in ("HEARTBEAT", "HIL_GPS", "HIL_STATE_QUATERNION")}
    return {**dict.fromkeys(DEFAULT_HZ, 0.0), **sent, "HIL_SENSOR": sample_hz}


def px4_messages(vehicle: Vehicle) -> Messages:
    """The steps of a vehicle as messages for PX4: each HIL_SENSOR again as sensor 1.

    PX4 rounds the inertial unit with id 0, whose messages are its clock, to 4.8 mm/s^2 and 220 deg/h, and the others not.
    """

    def step() -> Iterator[Any]:
        for message in vehicle.step():
            yield message
            if message.get_type() == "HIL_SENSOR" and message.fields_updated & IMU_BITS:
                again = copy(message)
                again.id, again.fields_updated = 1, message.fields_updated & IMU_BITS
                yield again

    return step


MIN_WAIT_S = 0.2
"""Least time after which a missing answer is given up, s."""
_MARGIN, _DECAY = 10.0, 0.99
"""Factor on the slowest answer; what remains of it at each later answer."""


class Cadence:
    """How many samples one answer covers, and how long to wait for it.

    An autopilot whose controller runs at half the sample rate answers every second sample.  Waiting for the others
    would cost the full timeout each time, so the number is learnt: an answer that comes early counts at once, one that comes
    late after two equal gaps.

    patience: the longest wait (s), kept until answers have shown how fast they are.  samples: covered by an answer.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self.samples = 1
        self._since = 0
        self._candidate = 0
        self._slowest: float | None = None

    def sent(self) -> bool:
        """Count a sample; whether its answer is due."""
        self._since += 1
        return self._since >= self.samples

    @property
    def wait_s(self) -> float:
        """How long to wait for an answer that is due (s)."""
        if self._slowest is None:
            return self._patience
        return min(self._patience, max(MIN_WAIT_S, _MARGIN * self._slowest))

    def answered(self, waited_s: float | None = None) -> None:
        """Count an answer.  waited_s: how long it took since its sample; None if the simulator did not wait."""
        if waited_s is not None:
            self._slowest = max(waited_s, _DECAY * (self._slowest or 0.0))
        gap, self._since = self._since, 0
        if 0 < gap < self.samples or gap == self._candidate:
            self.samples = gap
        self._candidate = gap if gap > self.samples else 0


class Px4Lockstep(Lockstep):
    """The simulator's side.

    messages: advances by one sample and returns the messages to send.  interval: of a sample (s).  act: receives the
    outputs.  answer: answers PX4's other messages, such as requests for intervals.  speed: simulated seconds per second
    at most; 0: as fast as both can.  patience: the longest wait for an answer (s); after it, or sooner where answers
    have been fast, the step counts as unanswered and the simulation continues, so that a lost message does not stop
    both sides for ever.  While PX4 is not connected the simulation stands still.  in_step: whether PX4 runs in
    lockstep.  Raises `InputError` for a wrong address, interval or patience.
    """

    def __init__(
        self,
        messages: Messages,
        interval: float,
        act: Act = ignore,
        *,
        answer: Answer = lambda _: (),
        address: str = ADDRESS,
        speed: float = 0.0,
        patience: float = 1.0,
        clock: Clock = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not interval > 0.0 or not patience > 0.0:
            raise InputError(f"lockstep: interval {interval:g} s and patience {patience:g} s must be above 0")
        super().__init__()
        if parse_address(address).kind != "tcpin":
            raise InputError(f"address {address!r}: must be tcpin:HOST:PORT for PX4, which connects by TCP")
        self.link: Link = open_link(address, component=COMPONENT)
        self.in_step = False
        self._messages, self._interval, self._act, self._answer = messages, interval, act, answer
        self._patience, self._clock, self._sleep = patience, clock, sleep
        self._cadence = Cadence(patience)
        self._pacer = Pacer(interval, speed, clock, sleep)
        self._connected = False
        self._next = 0.0

    def _turn(self, stop: Stop) -> None:
        self._take()  # answers that come late belong to no step
        if not self.link.peers:
            self._connected = self.in_step = False
            self._cadence = Cadence(self._patience)
            self.link.wait(0.1)
            return
        if not self._connected:
            self._connected, self._next = True, self._clock()
            self._pacer.restart(self._pacer.speed)
            self.progress.connections += 1
        if not self._pacer.wait(lambda: not stop()):
            return
        for message in self._messages():
            self.link.send(message)
        self.progress.steps += 1
        due = self._cadence.sent()
        if self.in_step:
            if due:
                self._await(stop)
        elif self._pacer.speed == 0.0:
            self._next += self._interval  # at the pace of the wall clock, until an answer comes
            while not self._take() and self._clock() < self._next:
                self._sleep(min(max(self._next - self._clock(), 0.0), self._interval))

    def _await(self, stop: Stop) -> None:
        sent = self._clock()
        deadline = sent + self._cadence.wait_s
        while self.link.peers and not stop() and not self._take(since=sent):
            left = deadline - self._clock()
            if left <= 0.0:
                self.progress.unanswered += 1
                return
            self.link.wait(min(left, 0.1))

    def _take(self, since: float | None = None) -> bool:
        """Act on received outputs and answer requests; whether there were outputs with the lockstep flag.

        since: clock time (s) of the sample that waits for them.
        """
        in_step = False
        for peer, message in self.link.receive():
            if message.get_type() != "HIL_ACTUATOR_CONTROLS":
                for reply in self._answer(message):
                    self.link.send_to(peer, reply)
                continue
            self.progress.answers += 1
            in_step = self.in_step = bool(message.flags & LOCKSTEP)
            values = tuple(float(value) for value in message.controls)
            self._act(Controls(message.time_usec * 1e-6, values, bool(message.mode & ARMED)))
        if in_step:
            self._cadence.answered(None if since is None else self._clock() - since)
            self.progress.samples_per_answer = self._cadence.samples
        return in_step

    def close(self) -> None:
        """Close the link."""
        self.link.close()
