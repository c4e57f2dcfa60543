"""The parameters of a campaign's runs, in the order of its model."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from insenv.estimators import Estimator
from insenv.scenario import Plant

Array = NDArray[np.float64]

DIGITS = 9
"""Significant digits that `parameter_digest` compares: fewer than those in which machines may differ."""


def run_parameters(plants: Sequence[Plant], estimator: Estimator, evaluation: tuple[int, int], whole: bool) -> Array:
    """Parameters of the campaign's model, one row per plant.

    evaluation: samples between evaluations, evaluations between records.  whole: whether the plants differ in more than
    their seeds.
    """
    model, own = plants[0].model, estimator.model.parameters
    place, one = model.parameters.slice("seed").start, model.parameters.pack(plants[0].parameters)
    rows = []
    for plant in plants:
        if whole:
            one = model.parameters.pack(plant.parameters)
        one[place] = plant.seed
        parts = [one, own.pack(plant.parameters_of(estimator))]
        parts.append(np.array(evaluation, dtype=np.float64))
        rows.append(np.concatenate(parts))
    return np.array(rows)


def parameter_digest(values: Array) -> str:
    """Hash of some values to `DIGITS` significant digits."""
    return hashlib.sha256(" ".join(f"{value:.{DIGITS}g}" for value in values.ravel()).encode()).hexdigest()
