"""Lockstep with PX4: the simulator listens on TCP 4560, sends HIL_SENSOR, and takes HIL_ACTUATOR_CONTROLS.

PX4 has no clock of its own in this mode: the time of the HIL_SENSOR messages is its time.  While it starts it reads sensors
and answers nothing, so the first steps cannot wait for it: they follow one another at the pace of the clock on the wall.
From its first answer that says it keeps step (bit 0 of the flags), each step waits for an answer, and no longer: then the
pair goes as fast as it can.  https://docs.px4.io/main/en/simulation/
"""

from __future__ import annotations

import time
from collections.abc import Callable

from insenv.errors import InputError
from insenv.mavlink.lockstep.contract import Act, Controls, Messages, Progress, Stop, ignore, never
from insenv.mavlink.messages import DEFAULT_HZ
from insenv.mavlink.wire import Link, open_link
from insenv.mavlink.wire.link import Clock

ADDRESS = "tcpin:127.0.0.1:4560"
COMPONENT = 200
"""The simulator's component; PX4 is component 1 of the same system."""
KEEPS_STEP = 0x1
"""The flag of HIL_ACTUATOR_CONTROLS."""
ARMED = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""


def px4_rates(sample_hz: float) -> dict[str, float]:
    """Rates (Hz) by message for a vehicle that talks to PX4: sensors at each sample, each fix, and the truth, nothing else."""
    return {
        **dict.fromkeys(DEFAULT_HZ, 0.0),
        "HEARTBEAT": 1.0,
        "HIL_SENSOR": sample_hz,
        "HIL_GPS": DEFAULT_HZ["HIL_GPS"],
        "HIL_STATE_QUATERNION": DEFAULT_HZ["HIL_STATE_QUATERNION"],
    }


class Px4Lockstep:
    """The simulator's side.

    messages: goes one sample on and gives what is to be sent; interval: of a sample (s); act: takes the outputs.  patience: how
    long (s) a step waits for its answer; then it counts as unanswered and the simulation goes on, so that a lost message
    does not stop both for ever.  While nobody is connected the simulation stands still.
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
        self.progress = Progress()
        self.link: Link = open_link(address, component=COMPONENT)
        self.in_step = False
        self._messages, self._interval, self._act = messages, interval, act
        self._patience, self._clock, self._sleep = patience, clock, sleep
        self._connected = False
        self._next = 0.0

    def run(self, steps: int | None = None, stop: Stop = never) -> Progress:
        """Go on for so many steps (None: without end), or until `stop`."""
        end = None if steps is None else self.progress.steps + steps
        while not stop() and (end is None or self.progress.steps < end):
            self._take()  # what came late answers no step any more
            if not self.link.peers:
                self._stand_still()
                continue
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
        return self.progress

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
        """Hand on what came; whether outputs were among it that keep step."""
        kept = False
        for _, message in self.link.receive():
            if message.get_type() != "HIL_ACTUATOR_CONTROLS":
                continue
            self.progress.answers += 1
            kept = self.in_step = bool(message.flags & KEEPS_STEP)
            values = tuple(float(value) for value in message.controls)
            self._act(Controls(message.time_usec * 1e-6, values, bool(message.mode & ARMED)))
        return kept

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    def __enter__(self) -> Px4Lockstep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
