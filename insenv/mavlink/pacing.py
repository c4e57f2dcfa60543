"""Pacing: when the next sample is due on the wall clock, and how late it came.

Each sample has an absolute deadline, so that errors of sleeping do not add up.  A stream that fell behind catches up in
bursts with pauses between them, lest it overrun the buffers of those who listen (a default UDP buffer holds 256 small
messages); one that fell behind by more than `GIVE_UP_S` starts its deadlines anew, and the simulation has lost that time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

GIVE_UP_S = 5.0
BURST_MESSAGES = 90
"""Messages sent at most before there is a pause."""
BURST_PAUSE_S = 0.005
SLICE_S = 0.02
_KEPT = 20_000


class Pacer:
    """Deadlines of samples.

    interval: simulated time of a sample, s.  speed: simulated seconds a second; 0: no deadlines.  clock, sleep: for tests.
    slips: how often the deadlines were begun anew; slipped: seconds lost so.
    """

    def __init__(
        self,
        interval: float,
        speed: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._interval = interval
        self._clock, self._sleep = clock, sleep
        self.slips = 0
        self.slipped = 0.0
        self._lateness: deque[float] = deque(maxlen=_KEPT)
        self._burst = 0
        self.restart(speed)

    def restart(self, speed: float) -> None:
        """From now on at this speed: the next sample is due one interval from now."""
        self.speed = speed
        self._begun = self._clock()
        self._samples = 0
        self._burst = 0

    def wait(self, meanwhile: Callable[[], None]) -> None:
        """Wait for the next sample's deadline, with a call of `meanwhile` every `SLICE_S` if that is further off."""
        if self.speed == 0.0:
            return
        self._samples += 1
        deadline = self._begun + self._samples * self._interval / self.speed
        left = deadline - self._clock()
        if left <= 0.0:
            self._lateness.append(-left)
            if -left > GIVE_UP_S:
                self.slips += 1
                self.slipped += -left
                self.restart(self.speed)
            return
        self._burst = 0
        while left > SLICE_S:
            self._sleep(SLICE_S)
            meanwhile()
            left = deadline - self._clock()
        if left > 0.0:
            self._sleep(left)
        self._lateness.append(max(0.0, self._clock() - deadline))

    def sent(self, messages: int) -> None:
        """So many messages have been sent: pause if they are too many without one."""
        if self.speed == 0.0:
            return
        self._burst += messages
        if self._burst >= BURST_MESSAGES:
            self._burst = 0
            self._sleep(BURST_PAUSE_S)

    def lateness(self, share: float) -> float:
        """The lateness (s) that this share of the latest samples did not exceed; 0 before the first."""
        known = sorted(self._lateness)
        return known[min(len(known) - 1, int(share * len(known)))] if known else 0.0
