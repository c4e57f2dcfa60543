"""Health of a filter with fixes while it runs: may its small sigmas be believed yet?

Three questions, asked of the fixes since the filter started:

- Is its health neither "overconfident" nor "diverged" (`insenv.evaluation.health`), and has it been so for `HOLD_S`?
- Do the latest fixes contradict the estimate (`insenv.evaluation.contradiction`)?
- Could they contradict it at all?  A filter that starts from a reported heading with a small standard deviation states that
  sigma whether the heading is right or not.  A wrong heading shows only when the vehicle accelerates: a change of velocity by d
  is then computed in a direction that is off by the heading error.

If the velocity is known to sigma before and after a change d, the change gives the heading to sqrt(2) sigma / d.  All changes
together give it, independently of what was reported, to

    heading_sigma = (sum of d^2 / (2 sigma^2))^(-1/2).

sigma^2 is the sum of the variances that filter and fix state for one horizontal axis.  Changes count that are more than
`SIGNIFICANT` times their own noise, sqrt(2) sigma, so that noise is not taken for motion, and that take from `SHORTEST_S` to
`LONGEST_S`: errors of successive fixes are not independent, and after a longer time errors of the inertial unit grow.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from insenv.core.tables import Table, Vector
from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.evaluation.contradiction import FIXES, SHORTEST_S, contradicts
from insenv.evaluation.health import WRONG, health

LONGEST_S = 10.0
SIGNIFICANT = 3.0
RESTARTS = "gnss_restart_count"
HOLD_S = 10.0
"""Time for which the health must have been good after it was not: near a bound a verdict changes from fix to fix."""
MOST_RECORDS = 512
"""Records kept for the health; when they are full, every second one is dropped."""


class LiveHealth:
    """Health of a filter that reports it (`insenv.estimators.Estimator.reports_health`), updated at each fix.

    rows: its outputs that tell its health (`insenv.estimators.Estimator.health_rows`).
    verdict: of the health over all fixes so far, at most `SHORTEST_S` old.  refused_in_a_row: fixes up to the latest of which
    the gate refused a component.
    """

    def __init__(self, rows: Table = FIX_HEALTH) -> None:
        self._rows = rows
        self._records: list[Vector] = []
        self._latest: Vector = np.zeros(0)
        self._every, self._count = 1, 0
        self._ratios: deque[tuple[float, Vector]] = deque()
        self._information = 0.0
        self._compared: tuple[float, Vector] | None = None
        self._judged_at = float("-inf")
        self._unwell_at = self._restarted_at = float("-inf")
        self._restarts, self._time = 0.0, 0.0
        self.verdict = "untested"
        self._refused, self.refused_in_a_row = 0.0, 0

    def take(self, time: float, outputs: Mapping[str, Any], fix_velocity_sigma: Vector | None) -> None:
        """Take the filter's outputs after a fix at `time` (s); those of a filter that has diverged to NaN are ignored.

        fix_velocity_sigma: stated by the fix (3, m/s, n); None: it has no velocity.
        """
        latest = np.concatenate([np.ravel(outputs[name]) for name in self._rows.names])
        if not np.isfinite(latest).all():
            return
        self._latest, self._time = latest, time
        restarts = float(outputs.get(RESTARTS, 0.0))
        if restarts > self._restarts:
            self._restarted_at = time
        self._restarts = restarts
        if self._count % self._every == 0:
            self._records.append(self._latest)
            if len(self._records) > MOST_RECORDS:
                del self._records[1::2]
                self._every *= 2
        self._count += 1
        refused = float(outputs.get("fix_refused_count", 0.0))
        self.refused_in_a_row = self.refused_in_a_row + 1 if refused > self._refused else 0
        self._refused = refused
        if "test_ratio" in outputs:
            self._ratios.append((time, np.array(outputs["test_ratio"])))
            while len(self._ratios) > FIXES and self._ratios[1][0] <= time - SHORTEST_S:
                self._ratios.popleft()
        self._compare(time, outputs, fix_velocity_sigma)
        self._judge(time)

    def _judge(self, time: float) -> None:
        if time - self._judged_at < SHORTEST_S * (1.0 - 1e-6):
            return
        self._judged_at = time
        judged = health(self._rows.unpack(np.array([*self._records, self._latest])))
        self.verdict = "untested" if judged is None else judged.verdict
        if self.verdict in WRONG:
            self._unwell_at = time

    def _compare(self, time: float, outputs: Mapping[str, Any], fix_velocity_sigma: Vector | None) -> None:
        if "velocity_sigma" not in outputs:
            return
        velocity = np.array(outputs["velocity_n"][:2])
        if self._compared is None:
            self._compared = time, velocity
            return
        before, old = self._compared
        if time - before < SHORTEST_S * (1.0 - 1e-6):
            return
        variance = float(np.mean(np.square(outputs["velocity_sigma"][:2])))
        if fix_velocity_sigma is not None:
            variance += float(np.mean(np.square(fix_velocity_sigma[:2])))
        known = float(np.sum((velocity - old) ** 2)) / (2.0 * variance)
        if time - before <= LONGEST_S and known > SIGNIFICANT**2:
            self._information += known
            self._compared = time, velocity
        elif time - before >= LONGEST_S:
            self._compared = time, velocity

    @property
    def fixes(self) -> int:
        """Number of fixes taken."""
        return self._count

    @property
    def heading_sigma(self) -> float:
        """Standard deviation (rad) to which the changes of velocity alone give the heading; infinite without any."""
        return self._information**-0.5 if self._information > 0.0 else float("inf")

    @property
    def well(self) -> bool:
        """Whether the verdict has not been "overconfident" or "diverged" for `HOLD_S`."""
        return self._judged_at - self._unwell_at >= HOLD_S

    @property
    def contradicted(self) -> bool:
        """Whether the latest fixes contradict it (`insenv.evaluation.contradiction.contradicts`), or the filter has started
        anew by them less than `HOLD_S` ago."""
        if self._time - self._restarted_at < HOLD_S:
            return True
        if len(self._ratios) < FIXES:
            return False
        return bool(contradicts(np.median(np.array([ratio for _, ratio in self._ratios]), axis=0)))
