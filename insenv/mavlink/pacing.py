"""Pacing: when the next sample is due on the wall clock, and how late it is.

Each sample has an absolute deadline, so that errors of sleeping do not accumulate.  A stream that falls behind catches
up in bursts with pauses, so as not to overrun the receivers' buffers (a default UDP buffer holds 256 small messages).
One that falls behind by more than `GIVE_UP_S` restarts its deadlines, and the simulation loses that time.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

GIVE_UP_S = 5.0
BURST_MESSAGES = 90
"""Largest number of messages sent without a pause."""
BURST_PAUSE_S = 0.005
SLICE_S = 0.02
_KEPT = 20_000


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
        self._interval = interval
        self._clock, self._sleep = clock, sleep
        self.slips = 0
        self.slipped = 0.0
        self._lateness: deque[float] = deque(maxlen=_KEPT)
        self._burst = 0
        self.restart(speed)

    def restart(self, speed: float) -> None:
        """Restart the deadlines at this speed: the next sample is due one interval from now."""
        self.speed = speed
        self._begun = self._clock()
        self._samples = 0
        self._burst = 0

    def change(self, speed: float) -> None:
        """Continue at another speed: the part of the sample that has passed counts, so that changes never delay a sample."""
        before, now = self.speed, self._clock()
        begun = now
        if before > 0.0 and speed > 0.0:
            passed = (now - self._begun) * before / self._interval - self._samples
            begun = now - min(max(passed, 0.0), 1.0) * self._interval / speed
        self.restart(speed)
        self._begun = begun

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
        known = sorted(self._lateness)
        return known[min(len(known) - 1, int(share * len(known)))] if known else 0.0
