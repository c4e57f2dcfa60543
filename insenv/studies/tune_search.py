"""The search of tuning: CMA-ES (Hansen 2016, arXiv:1604.00772) over the logarithms of factors, a population at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from insenv.core.runner import Progress
from insenv.studies.tune_parameters import LARGEST

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
"""Objectives (n,), the smaller the better, of the logarithms of factors (n, parameters)."""

STEP = 0.7
"""First standard deviation of the logarithms: a factor of 2."""
POPULATION = 8
"""Smallest population: two registers of the batch core."""
FAILED = 1e3
"""Objective of factors with which the filter diverges."""


@dataclass(frozen=True)
class Search:
    """factors (parameters,): the mean of the last population, which noise moves less than its best member.

    history (generations, 2): best and median objective; evaluations; interrupted: by Ctrl-C, after which the rest goes on.
    """

    factors: Array
    history: Array
    evaluations: int
    interrupted: bool

    @property
    def notes(self) -> tuple[str, ...]:
        """What must be said of the search."""
        return (f"the search was interrupted after {self.evaluations} evaluations",) if self.interrupted else ()


def search(objective: Objective, parameters: int, evaluations: int, seed: int, progress: Progress | None) -> Search:
    """Minimise the objective with about `evaluations` evaluations; Ctrl-C ends the search and keeps what it has found."""
    import cma

    size = max(POPULATION, 4 + int(3 * log(parameters)))
    options = {
        "seed": seed % (2**31 - 1) + 1,  # 0 is the time
        "popsize": size,
        "bounds": [-log(LARGEST), log(LARGEST)],
        "verbose": -9,
        "verb_log": 0,
        "tolfun": 1e-4,
        "tolx": 1e-2,
    }
    # of one parameter the package warns that it is made for more; a second one without effect serves
    state = cma.CMAEvolutionStrategy(np.zeros(max(parameters, 2)), STEP, options)
    history: list[list[float]] = []
    done, interrupted = 0, False
    try:
        while done < evaluations and not state.stop():
            asked = state.ask()
            values = objective(np.array(asked)[:, :parameters])
            values = np.where(np.isfinite(values), values, FAILED)
            state.tell(asked, values.tolist())
            done += size
            history.append([float(values.min()), float(np.median(values))])
            if progress is not None:
                progress(min(done, evaluations), evaluations)
    except KeyboardInterrupt:
        if not history:
            raise
        interrupted = True
    mean = np.clip(np.asarray(state.result.xfavorite)[:parameters], -log(LARGEST), log(LARGEST))
    return Search(np.exp(mean), np.array(history).reshape(-1, 2), done, interrupted)
