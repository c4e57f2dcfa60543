"""Inertial units between two grades: each figure of a unit has its own place on the way from one grade to the other.

The units are a fixed pool, so that the limit of each is computed once and exactly.  Over the pool every figure is uniform, in
its logarithm where both grades have one above 0, and no two figures are correlated.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from insenv.core.tables import Array, Table
from insenv.sensors.imu_tables import IMU_PARAMETERS

UNITS = 64
"""Units of a pool; more than a unit has figures."""


def units_between(low: Array, high: Array, parameters: Table) -> Array:
    """Return the pool of units between two grades, (UNITS, parameters.size), with all other parameters as in `low`.

    low, high (parameters.size,): of a plant with the better and with the worse unit.
    """
    names = [
        name for name in IMU_PARAMETERS.names if not np.array_equal(low[parameters.slice(name)], high[parameters.slice(name)])
    ]
    fractions = uncorrelated(UNITS, len(names))
    return at_fractions(low, high, parameters, {name: fractions[:, k] for k, name in enumerate(names)})


def middle_unit(low: Array, high: Array, parameters: Table) -> Array:
    """Return the unit halfway between two grades in every figure, (parameters.size,)."""
    half = np.array([0.5])
    return at_fractions(low, high, parameters, dict.fromkeys(IMU_PARAMETERS.names, half))[0]


def at_fractions(low: Array, high: Array, parameters: Table, fractions: dict[str, Array]) -> Array:
    """Return k units whose figures lie at fractions (k,) of the way between two grades, by row name."""
    count = len(next(iter(fractions.values()), ())) or UNITS
    vectors = np.tile(low, (count, 1))
    for name, fraction in fractions.items():
        place = parameters.slice(name)
        a, b, way = low[place], high[place], fraction[:, None]
        positive = (a > 0.0) & (b > 0.0)
        ratio = np.where(positive, b, 1.0) / np.where(positive, a, 1.0)
        vectors[:, place] = np.where(positive, a * ratio**way, a + (b - a) * way)
    return vectors


def units_of(pool: Array, vectors: Array) -> NDArray[np.intp]:
    """Return the places (k,) in a pool of units that parameters (k, at least parameters.size) have."""
    telling = np.flatnonzero(pool[0] != pool[-1])
    if not len(telling):
        return np.zeros(len(vectors), dtype=np.intp)
    column = telling[0]  # of a figure, whose values are all different
    return np.argmin(np.abs(vectors[:, column, None] - pool[None, :, column]), axis=1)


@lru_cache(maxsize=16)
def uncorrelated(count: int, columns: int) -> Array:
    """Return a Latin hypercube (count, columns) in (0, 1) whose columns have rank correlations of about 0.

    Each column contains (k + 1/2) / count for k = 0 .. count - 1.  Source: Owen, "Controlling correlations in Latin hypercube
    samples", Journal of the American Statistical Association 89 (1994), 1517-1522: ranked Gram-Schmidt.
    """
    draw = np.random.default_rng(0)
    ranks = np.array([draw.permutation(count) for _ in range(columns)]).reshape(columns, count) - (count - 1) / 2.0
    length = np.sum(ranks**2, axis=1)
    for sweep in range(20):
        order = range(columns) if sweep % 2 == 0 else range(columns)[::-1]
        for done, k in enumerate(order):
            rest = ranks[k].copy()
            for other in order[:done]:
                rest -= ranks[other] * (np.sum(rest * ranks[other]) / length[other])
            # rounded, so that the order is that of every processor
            ranks[k] = np.argsort(np.argsort(np.round(rest, 9), kind="stable")) - (count - 1) / 2.0
    return ranks.T / count + 0.5
