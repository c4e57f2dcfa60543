"""Measurements of an aiding instrument in a recorded log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.logs.units import Array
from insenv.sensors.instruments import INSTRUMENTS


@dataclass(frozen=True)
class Readings:
    """Measurements of one instrument: its id, the name of the series, time of validity (m,) s, and values (m, k).

    The columns of `values` are the measured rows `rows` of `sensors.instruments`, one after the other; other rows keep their
    start value.  arrival, age (m,) s: when each measurement arrived, and its age then; None: at its time of validity.
    """

    id: str
    name: str
    time: Array
    values: Array
    rows: tuple[str, ...]
    arrival: Array | None = None
    age: Array | None = None

    def columns(self) -> dict[str, Array]:
        """The values by row, (m, ...)."""
        table, found, begin = INSTRUMENTS[self.id].measurement, {}, 0
        for row in self.rows:
            size, shape = table[row].size, table[row].shape
            found[row] = self.values[:, begin : begin + size].reshape(-1, *shape)
            begin += size
        return found


def delivered(
    time: Array, arrival: Array | None, age: Array | None, end: Array, dt: Array
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Which measurements the samples that end at `end` (n,) s and are `dt` (n,) s long get: rows, samples, ages on these.

    A measurement belongs to the first sample that ends at or after its arrival, and of several in one sample the last counts.
    time (m,) s: of validity; arrival, age: as of `Readings`.
    """
    arrived = time if arrival is None else arrival
    inside = np.flatnonzero((arrived > end[0] - dt[0]) & (arrived <= end[-1]))
    sample = np.searchsorted(end, arrived[inside], side="left")
    last = np.append(np.diff(sample) > 0, True)[: len(inside)]
    rows, sample = inside[last], sample[last]
    waited = end[sample] - arrived[rows]
    return rows, sample, waited if age is None else waited + age[rows]
