"""Lockstep with PX4: the simulator listens on TCP 4560, sends HIL_SENSOR and receives HIL_ACTUATOR_CONTROLS.

PX4 has no clock of its own in this mode: the time of HIL_SENSOR is its time.  While it starts, PX4 reads sensors and
answers nothing, so the first steps do not wait for it but follow the wall clock.  From its first answer with the
lockstep flag (bit 0) on, each step waits for an answer, and the pair runs as fast as it can.
https://docs.px4.io/main/en/simulation/
"""

from __future__ import annotations

import time
from collections.abc import Callable

from insenv.errors import InputError
from insenv.mavlink.lockstep.contract import Act, Controls, Lockstep, Messages, Stop, ignore
from insenv.mavlink.messages import DEFAULT_HZ
from insenv.mavlink.wire import Link, open_link
from insenv.mavlink.wire.link import Clock

CHANNELS = (1, 0, 3, 2)
"""Channels, from 0, of pitch, roll, throttle and yaw."""
ADDRESS = "tcpin:127.0.0.1:4560"
COMPONENT = 200
"""The simulator's component; PX4 is component 1 of the same system."""
LOCKSTEP = 0x1
"""HIL_ACTUATOR_CONTROLS_FLAGS: whether PX4 runs in lockstep."""
ARMED = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""


def px4_rates(sample_hz: float) -> dict[str, float]:
    """Rates (Hz) by message for PX4: sensors at each sample, each fix, the truth, and nothing else."""
    return {
        **dict.fromkeys(DEFAULT_HZ, 0.0),
        "HEARTBEAT": 1.0,
        "HIL_SENSOR": sample_hz,
        "HIL_GPS": DEFAULT_HZ["HIL_GPS"],
        "HIL_STATE_QUATERNION": DEFAULT_HZ["HIL_STATE_QUATERNION"],
    }


class Px4Lockstep(Lockstep):
    """The simulator's side.

    messages: advances by one sample and returns the messages to send.  interval: of a sample (s).  act: receives the
    outputs.  patience: the longest wait for an answer (s); after it the step counts as unanswered and the simulation
    continues, so that a lost message does not stop both sides for ever.  While PX4 is not connected the simulation
    stands still.  in_step: whether PX4 runs in lockstep.  Raises `InputError` for a wrong address, interval or
    patience.
    """

    def __init__(
        self,
        messages: Messages,
        interval: float,
        act: Act = ignore,
        *,
        address: str = ADDRESS,
        patience: float = 1.0,
        clock: Clock = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not interval > 0.0 or not patience > 0.0:
            raise InputError(f"lockstep: interval {interval:g} s and patience {patience:g} s must be above 0")
        super().__init__()
        self.link: Link = open_link(address, component=COMPONENT)
        self.in_step = False
        self._messages, self._interval, self._act = messages, interval, act
        self._patience, self._clock, self._sleep = patience, clock, sleep
        self._connected = False
        self._next = 0.0

    def _turn(self, stop: Stop) -> None:
        self._take()  # answers that come late belong to no step
        if not self.link.peers:
            self._stand_still()
            return
        if not self._connected:
            self._connected, self._next = True, self._clock()
            self.progress.connections += 1
        for message in self._messages():
            self.link.send(message)
        self.progress.steps += 1
        if self.in_step:
            self._await(stop)
        else:
            self._pace()

    def _stand_still(self) -> None:
        self._connected = self.in_step = False
        self.link.wait(0.1)

    def _await(self, stop: Stop) -> None:
        deadline = self._clock() + self._patience
        while self.link.peers and not stop():
            if self._take():
                return
            left = deadline - self._clock()
            if left <= 0.0:
                self.progress.unanswered += 1
                return
            self.link.wait(min(left, 0.1))

    def _pace(self) -> None:
        self._next += self._interval
        while not self._take() and self._clock() < self._next:
            self._sleep(min(max(self._next - self._clock(), 0.0), self._interval))

    def _take(self) -> bool:
        """Act on received outputs; whether there were any with the lockstep flag."""
        in_step = False
        for _, message in self.link.receive():
            if message.get_type() != "HIL_ACTUATOR_CONTROLS":
                continue
            self.progress.answers += 1
            in_step = self.in_step = bool(message.flags & LOCKSTEP)
            values = tuple(float(value) for value in message.controls)
            self._act(Controls(message.time_usec * 1e-6, values, bool(message.mode & ARMED)))
        return in_step

    def close(self) -> None:
        """Close the link."""
        self.link.close()
