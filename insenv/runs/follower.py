"""An estimator that follows a run or a replay, chunk by chunk."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv.base.errors import InsenvError
from insenv.base.remarks import Remark, clock
from insenv.core.runner import Runner, make_runner
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.evaluation.health import Health, fixes_count_less, health, models_slow_errors, no_fix
from insenv.scenario.inputs import input_rows

SHORT = 1e-12
"""Squared norm below which a quaternion is no attitude."""


def diverged(what: str, columns: Mapping[str, Array], sample: int) -> InsenvError:
    """Outputs are not finite after `sample` of the samples in `columns`, with its ``time`` (s) if that known."""
    at = f" at {clock(float(columns['time'][sample]), 9)} s" if "time" in columns else ""
    return InsenvError(f"{what} diverged: its outputs are no longer finite numbers{at}")


@dataclass
class Follower:
    """One estimator in a run: its runner, its outputs so far, the processor time it has used (s), and the standard deviations
    (k, 3) m of the fixes so far."""

    estimator: Estimator
    runner: Runner
    every: int
    outputs: list[Array] = field(default_factory=list)
    seconds: float = 0.0
    fix_sigmas: list[Array] = field(default_factory=list)

    @property
    def first(self) -> int:
        """Number of records before the first estimate: an estimator has one after every sample."""
        return 0

    @classmethod
    def started(cls, estimator: Estimator, parameters: Mapping[str, Any], every: int) -> Follower:
        """The estimator started with `parameters` (SI, by row name); its outputs are recorded every `every` samples."""
        return cls(estimator, make_runner(estimator.model, parameters), every)

    def follow(self, columns: dict[str, Array], count: int) -> None:
        """Process `count` samples (a multiple of `every`).  Raises `InsenvError` if an output is not finite or q_nb has no
        length.
        """
        rows = input_rows(self.estimator.model, columns, count)
        if self.estimator.reports_fixes and "gnss_position_sigma" in columns:
            self.fix_sigmas.append(columns["gnss_position_sigma"][columns["gnss_valid"] > 0])
        begin = time.process_time()
        outputs = self.runner.run(count, rows, self.every)
        self.seconds += time.process_time() - begin
        finite = np.isfinite(outputs).all(axis=1)
        if not finite.all():
            raise diverged(f"estimator {self.estimator.id!r}", columns, (int(np.argmin(finite)) + 1) * self.every - 1)
        if np.any(np.sum(outputs[:, self.estimator.model.outputs.slice("q_nb")] ** 2, axis=1) < SHORT):
            raise InsenvError(f"estimator {self.estimator.id!r} diverged: its output q_nb has length 0")
        self.outputs.append(outputs)

    def named(self) -> dict[str, Array]:
        """All outputs so far by row name, time along the first axis."""
        return self.estimator.model.outputs.unpack(np.concatenate(self.outputs))

    def health_rows(self) -> dict[str, Array]:
        """Outputs so far by row name, those that tell its health among them."""
        return self.named()

    @property
    def _parameters(self) -> dict[str, Any]:
        return self.estimator.model.parameters.unpack(self.runner.p)

    def health(self, outputs: Mapping[str, Array]) -> Health | None:
        """Its health, from what `named` returned; None if it does not report it, or if nothing was measured."""
        return health(outputs) if self.estimator.reports_health else None

    def settled(self, duration_s: float) -> bool:
        """Whether `duration_s` of data are enough for the estimator."""
        return not self.estimator.too_short(self._parameters, duration_s)

    def notes(self, time: Array, duration_s: float, health: Health | None, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
        """Remarks on the estimate after `duration_s` of data, on its health and on what `named` returned.

        time (records,): of these outputs, s since the start.
        """
        parameters, estimator = self._parameters, self.estimator
        of_fixes = no_fix(health) if estimator.reports_fixes else ()
        of_health = health.notes(models_slow_errors(parameters), estimator.causes) if health else ()
        return (
            *estimator.notes(parameters, duration_s),
            *estimator.shown(parameters, time, outputs),
            *of_fixes,
            *of_health,
            *fixes_count_less(parameters, outputs, np.concatenate([np.zeros((0, 3)), *self.fix_sigmas])),
        )
