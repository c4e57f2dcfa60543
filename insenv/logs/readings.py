"""Measurements of an aiding instrument in a recorded log."""

from __future__ import annotations

from dataclasses import dataclass

from insenv.instruments import INSTRUMENTS
from insenv.logs.units import Array


@dataclass(frozen=True)
class Readings:
    """Measurements of one instrument: its id, the name of the series, time of validity (m,) s, and values (m, k).

    The columns of `values` are the measured rows `rows` of `insenv.instruments`, one after the other; other rows keep their
    start value.
    """

    id: str
    name: str
    time: Array
    values: Array
    rows: tuple[str, ...]

    def columns(self) -> dict[str, Array]:
        """The values by row, (m, ...)."""
        table, found, begin = INSTRUMENTS[self.id].measurement, {}, 0
        for row in self.rows:
            size, shape = table[row].size, table[row].shape
            found[row] = self.values[:, begin : begin + size].reshape(-1, *shape)
            begin += size
        return found
