"""How many samples one answer of an autopilot covers, and how long to wait for it.

An autopilot whose controller runs at half the sample rate answers every second sample.  Waiting for the others
would cost the full timeout each time, so the number is learnt: an answer that comes early counts at once, one that comes
late after two equal gaps.
"""

from __future__ import annotations

SHORTEST_WAIT_S = 0.2
"""Least time after which a missing answer is given up, s."""
_MARGIN, _KEPT = 10.0, 0.99
"""Factor on the slowest answer; what remains of it at each later answer."""


class Cadence:
    """The pattern of an autopilot's answers.

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
        return min(self._patience, max(SHORTEST_WAIT_S, _MARGIN * self._slowest))

    def answered(self, waited_s: float | None = None) -> None:
        """Count an answer.  waited_s: how long it took since its sample; None if the simulator did not wait."""
        if waited_s is not None:
            self._slowest = max(waited_s, _KEPT * (self._slowest or 0.0))
        gap, self._since = self._since, 0
        if 0 < gap < self.samples or gap == self._candidate:
            self.samples = gap
        self._candidate = gap if gap > self.samples else 0
