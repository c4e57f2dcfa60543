"""How an episode with a filter inside starts: also the filter's parameters follow from what is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.envs.filter_inside import Inner
from insenv.envs.knowledge import TOLD, knowledge_of
from insenv.envs.starts import Ranges, Starts
from insenv.envs.task import Task
from insenv.plant.loop import PREFIX
from insenv.scenario import Scenario

Array = NDArray[np.float64]


class InnerStarts(Starts):
    """`Starts` of a task with a filter inside.

    mistuning: decades; the filter's noises (row ``mistuning`` of the task, if it is not 0) are wrong by factors whose
    decimal logarithms are drawn uniformly within plus and minus that.
    """

    def __init__(
        self, scenario: Scenario, task: Task, ranges: Ranges, constants: Mapping[str, float], duration: float, *, inner: Inner,
        mistuning: float = 0.0,
    ) -> None:  # fmt: skip
        super().__init__(scenario, task, ranges, constants, duration)
        self.mistuning, self._estimator = mistuning, inner.estimator
        self._tunings = scenario.tunings
        first, last = (task.model.parameters.slice(PREFIX + inner.estimator.model.parameters.names[k]) for k in (0, -1))
        self._place = slice(first.start, last.stop)

    def draw(self, generators: Sequence[np.random.Generator], options: Mapping[str, Any] | None = None) -> Array:
        p = super().draw(generators, options)
        if self.mistuning:
            place = self.task.model.parameters.slice("mistuning")
            for row, generator in zip(p, generators, strict=True):
                row[place] = generator.uniform(-self.mistuning, self.mistuning, place.stop - place.start)
        return p

    def tell(self, p: Array, x: Array, options: Mapping[str, Any] | None = None) -> Array:
        p = super().tell(p, x, options)
        parameters, estimator = self.task.model.parameters, self._estimator
        for row in p:
            told = {name: row[parameters.slice(name)].reshape(parameters[name].shape) for name in TOLD.names}
            row[self._place] = estimator.model.parameters.pack(estimator.parameters(knowledge_of(told), self._tunings))
        return p
