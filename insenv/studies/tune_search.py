"""The search of tuning: CMA-ES (Hansen 2016, arXiv:1604.00772) over the logarithms of factors, a population at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.remarks import Remark, declared
from insenv.core.runner import Progress
from insenv.core.tables import Array, Row
from insenv.estimators import Estimator
from insenv.estimators.settings import DOCUMENTED, keys_by_row, tuning

# The parameters of a filter that tuning may change, as factors on their values, and their keys in [estimator.ID].

ENDINGS = ("random_walk", "bias_sigma", "drift_sigma", "wander_sigma", "_noise", "_gate", "_error")
"""Endings of the rows that are noises and gates; what is known of the start, and times, are not tuned by default."""
NAMES = ("standing_sigma", "non_holonomic_sigma")
LARGEST = 100.0
"""Largest factor, and its inverse the smallest."""


@dataclass(frozen=True)
class Parameter:
    """A parameter that is tuned: its row, its key in [estimator.ID], and its value (row.size,) before, SI."""

    row: Row
    key: str
    unit: float
    before: Array

    def value(self, factor: float) -> Array:
        """The value (row.size,), SI, for a factor; within the bounds of the row."""
        return np.clip(self.before * factor, self.row.lower, self.row.upper)

    def setting(self, factor: float) -> float | list[float]:
        """The value in the unit of the key, rounded to 4 digits."""
        numbers = [float(f"{number / self.unit:.4g}") for number in self.value(factor)]
        return numbers[0] if len(set(numbers)) == 1 else numbers


def tuned_parameters(
    estimator: Estimator, values: Mapping[str, Any], keys: Sequence[str] | None, but: Sequence[str] = ()
) -> tuple[Parameter, ...]:
    """The parameters that `keys` name (of [estimator.ID]), or by default the noises and gates that are not 0.

    values: parameters of the estimator by row name, SI.  but: rows that are not tuned by default.  Raises `InputError` for a
    key that is unknown or whose value is 0.
    """
    settable = estimator.settable_rows
    known = {row: names for row, names in keys_by_row(settable).items() if row in values}
    if keys is None:
        noises = (row for row in known if _is_noise(row) and row not in but and np.all(np.asarray(values[row]) > 0.0))
        chosen = {row: known[row][0] for row in noises}
    else:
        by_key = {name: row for row, names in known.items() for name in names}
        for key in keys:
            if key not in by_key:
                raise InputError(f"key {key!r}: {estimator.id!r} has no such parameter{nearest(key, by_key, DOCUMENTED)}")
        chosen = {by_key[key]: key for key in keys}
    parameters = []
    for row, key in chosen.items():
        before = np.array(values[row], dtype=float).reshape(-1)
        if not np.all(before > 0.0):
            raise InputError(f"key {key!r}: its value is {before.tolist()}: tuning finds a factor, and needs a value above 0")
        unit = float(np.max(np.asarray(tuning(estimator, {key: 1.0})[row])))
        parameters.append(Parameter(estimator.model.parameters[row], key, unit, before))
    if not parameters:
        raise InputError(f"estimator {estimator.id!r} has no noise or gate that is not 0: name its parameters")
    return tuple(parameters)


def _is_noise(row: str) -> bool:
    return row.endswith(ENDINGS) or row in NAMES


Objective = Callable[[Array], Array]
"""Objectives (n,), the smaller the better, of the logarithms of factors (n, parameters)."""

STEP = 0.7
"""First standard deviation of the logarithms: a factor of 2."""
POPULATION = 8
"""Smallest population: two registers of the batch core."""
FAILED = 1e3
"""Objective of factors with which the filter diverges."""
_INTERRUPTED = declared("search-interrupted", "the search was interrupted after {count} evaluations")


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
    def notes(self) -> tuple[Remark, ...]:
        """What must be said of the search."""
        return (_INTERRUPTED.filled(count=self.evaluations),) if self.interrupted else ()


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
            population = state.ask()
            values = objective(np.array(population)[:, :parameters])
            values = np.where(np.isfinite(values), values, FAILED)
            state.tell(population, values.tolist())
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
