"""The record of a forward pass for the backward pass: in memory up to `MEMORY`, beyond that in a temporary file.

A flight of 2 h at 200 Hz, with the covariance propagated 20 times per second, one fix per second and 3000 smoothed
instants, takes 41 MB: 184 B for each of 144,000 instants, 1.5 kB per fix, 1.1 kB per smoothed instant.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from insenv.core.tables import Table
from insenv.estimators import smoother

Array = NDArray[np.float64]

MEMORY = 64 * 2**20  # bytes before the file is used
_OUTPUTS = smoother.MODEL.outputs


class Record:
    """Blocks of recorded instants, written forward and read backward."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(max_size=MEMORY)  # noqa: SIM115 (it lives as long as the record)
        weakref.finalize(self, self._file.close)
        self._blocks: list[list[tuple[int, int]]] = []

    def add(self, outputs: Array, wanted: Array) -> None:
        """Add outputs of the forward pass (one row per sample); `wanted` (bool): the samples to be smoothed."""
        due, fix, rest = (outputs[:, _OUTPUTS.slice(name)][:, 0] != 0 for name in smoother.EVENTS.names)
        parts = (
            np.column_stack([_rows(outputs[due], smoother.EVENTS + smoother.INTERVAL), wanted[due]]),
            _rows(outputs[fix], smoother.FIX),
            _rows(outputs[rest], smoother.REST),
            _rows(outputs[wanted], smoother.NOMINAL),
        )
        self._blocks.append([(len(part), part.shape[1]) for part in parts])
        for part in parts:
            self._file.write(np.ascontiguousarray(part).tobytes())

    @property
    def size(self) -> int:
        """Bytes recorded."""
        return 8 * sum(rows * columns for block in self._blocks for rows, columns in block)

    def backward(self) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
        """Blocks from the last to the first, each in order of time.

        Yields the input rows of the backward pass (rows, its inputs.size), the index of the row with which the pass
        goes back into each instant that is to be smoothed, and the filter's states at those instants (instants,
        NOMINAL.size).
        """
        end = self.size
        for shapes in reversed(self._blocks):
            begin = end - 8 * sum(rows * columns for rows, columns in shapes)
            self._file.seek(begin)
            parts = [np.frombuffer(self._file.read(8 * rows * columns)).reshape(rows, columns) for rows, columns in shapes]
            rows, last = _instants(*parts[:3])
            yield rows, last[parts[0][:, -1] != 0], parts[3]
            end = begin
        self._file.seek(self.size)


def _instants(events: Array, fixes: Array, rests: Array) -> tuple[Array, NDArray[np.intp]]:
    """Input rows of the backward pass in order of time, and the last row of each instant.

    An instant has one row for each scalar measurement, or one if it has none; the transition to it belongs to the first
    row.
    """
    with_fix, with_rest = (events[:, smoother.EVENTS.slice(name).start] != 0 for name in ("fix_used", "standing_now"))
    of_fix, of_rest = _scalars(smoother.FIX, fixes), _scalars(smoother.REST, rests)
    count = with_fix * of_fix.shape[1] + with_rest * of_rest.shape[1]
    length = np.maximum(count, 1)
    first = np.cumsum(length) - length

    inputs = smoother.BACKWARD_INPUTS
    rows = np.zeros((length.sum(), inputs.size))
    rows[:, inputs.slice("scalar_used").start] = np.repeat(count > 0, length)
    rows[first, inputs.slice("carried").start] = 1
    interval = events[:, smoother.EVENTS.size : smoother.EVENTS.size + smoother.INTERVAL.size]
    rows[:, inputs.slice("carried").stop :] = np.repeat(interval, length, axis=0)
    scalar = slice(inputs.slice("H").start, inputs.slice("left").stop)
    for begin, scalars in (
        (first[with_fix], of_fix),
        ((first + with_fix * of_fix.shape[1])[with_rest], of_rest),
    ):
        rows[begin[:, None] + np.arange(scalars.shape[1]), scalar] = scalars
    return rows, first + length - 1


def _scalars(table: Table, rows: Array) -> Array:
    """Rows of `FIX` or `REST` as (instants, scalars, 32): H, gain, weight and left of each scalar measurement."""
    H, gain, weight, left = table.unpack(rows).values()
    return np.concatenate([H, gain, weight[..., None], left[..., None]], axis=-1)


def _rows(outputs: Array, table: Table) -> Array:
    """The columns of the outputs of the forward pass that `table` names, in its order."""
    return np.concatenate([outputs[:, _OUTPUTS.slice(name)] for name in table.names], axis=1)
