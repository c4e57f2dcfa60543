"""The smoother along a run or a replay: it follows as its filter does, and goes back when it is asked for its outputs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.estimators import Estimator
from insenv.runs.follower import Follower
from insenv.runs.smoothed import Smoother

Array = NDArray[np.float64]


class SmoothingFollower(Follower):
    """A `Follower` whose outputs are those of the whole run smoothed."""

    smoother: Smoother

    @classmethod
    def started(cls, estimator: Estimator, parameters: Mapping[str, Any], every: int) -> SmoothingFollower:
        smoother = Smoother(parameters)
        follower = cls(estimator, smoother.forward, every)
        follower.smoother = smoother
        return follower

    def follow(self, columns: dict[str, Array], count: int) -> None:
        begin = time.process_time()
        self.smoother.take(columns, (np.arange(count) + 1) % self.every == 0)
        self.seconds += time.process_time() - begin

    def named(self) -> dict[str, Array]:
        """All outputs so far by row name, time along the first axis, smoothed."""
        begin = time.process_time()
        outputs = self.smoother.smoothed()
        self.seconds += time.process_time() - begin
        return outputs
