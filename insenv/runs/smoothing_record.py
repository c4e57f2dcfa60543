"""What the passes of a smoother read again: the record of the forward pass, and the samples that it took.

In memory up to `MEMORY`, beyond that in a temporary file. A flight of 2 h at 200 Hz, with the covariance propagated 20 times
per second, one fix per second and 3000 smoothed instants, takes 41 MB: 184 B for each of 144,000 instants, 1.5 kB per fix,
1.1 kB per smoothed instant; its samples, which only a second pass needs, 280 MB.
"""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from insenv.core.tables import Array, Table
from insenv.estimators.parts.adjoint import Smoothing, used_row

MEMORY = 64 * 2**20  # bytes before the file is used


class _Spool:
    """Bytes that are written one after the other and read from anywhere."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(max_size=MEMORY)  # noqa: SIM115 (it lives as long as this object)
        weakref.finalize(self, self._file.close)

    def write(self, values: Array) -> None:
        """Add values."""
        self._file.write(np.ascontiguousarray(values).tobytes())

    def read(self, begin: int, size: int) -> Array:
        """`size` values from the byte `begin` on."""
        self._file.seek(begin)
        values = np.frombuffer(self._file.read(8 * size))
        self._file.seek(0, 2)
        return values


class Samples:
    """Inputs of a filter, block by block, to be filtered once more."""

    def __init__(self) -> None:
        self._spool = _Spool()
        self._shapes: list[tuple[int, int]] = []

    def add(self, inputs: Array) -> None:
        """Add a block (samples, inputs)."""
        self._shapes.append(inputs.shape)
        self._spool.write(inputs)

    def __iter__(self) -> Iterator[Array]:
        begin = 0
        for rows, columns in self._shapes:
            yield self._spool.read(begin, rows * columns).reshape(rows, columns)
            begin += 8 * rows * columns


class Record:
    """Blocks of recorded instants of a smoother's forward pass, written forward and read backward."""

    def __init__(self, smoothing: Smoothing) -> None:
        self._smoothing = smoothing
        self._spool = _Spool()
        self._blocks: list[list[tuple[int, int]]] = []

    def add(self, outputs: Array, wanted: Array) -> None:
        """Add outputs of the forward pass (one row per sample); `wanted` (bool): the samples to be smoothed."""
        smoothing = self._smoothing
        due, *used = (self._rows(outputs, Table((row,)))[:, 0] != 0 for row in smoothing.events)
        parts = (
            np.column_stack([self._rows(outputs[due], smoothing.events + smoothing.interval), wanted[due]]),
            *(self._rows(outputs[flag], group.rows) for flag, group in zip(used, smoothing.groups, strict=True)),
            self._rows(outputs[wanted], smoothing.nominal),
        )
        self._blocks.append([(len(part), part.shape[1]) for part in parts])
        for part in parts:
            self._spool.write(part)

    @property
    def size(self) -> int:
        """Bytes recorded."""
        return 8 * sum(rows * columns for block in self._blocks for rows, columns in block)

    def backward(self) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
        """Blocks from the last to the first, each in order of time.

        Yields the input rows of the backward pass (rows, its inputs.size), the index of the row with which the pass
        goes back into each instant that is to be smoothed, and the filter's states at those instants (instants,
        nominal.size).
        """
        end = self.size
        for shapes in reversed(self._blocks):
            begin = end - 8 * sum(rows * columns for rows, columns in shapes)
            ends = np.cumsum([rows * columns for rows, columns in shapes])
            flat = np.split(self._spool.read(begin, int(ends[-1])), ends[:-1])
            events, *groups, nominal = (part.reshape(shape) for part, shape in zip(flat, shapes, strict=True))
            rows, last = self._instants(events, groups)
            yield rows, last[events[:, -1] != 0], nominal
            end = begin

    def _instants(self, events: Array, groups: Sequence[Array]) -> tuple[Array, NDArray[np.intp]]:
        """Input rows of the backward pass in order of time, and the last row of each instant.

        An instant has one row for each scalar measurement, or one if it has none; the transition to it belongs to the first
        row.
        """
        smoothing = self._smoothing
        flags = [events[:, 1 + k] != 0 for k in range(len(smoothing.groups))]
        scalars = [_scalars(group.rows, rows) for group, rows in zip(smoothing.groups, groups, strict=True)]
        count = np.zeros(len(events), dtype=np.int64)
        before = []
        for flag, group in zip(flags, smoothing.groups, strict=True):
            before.append(count.copy())
            count += flag * group.count
        length = np.maximum(count, 1)
        first = np.cumsum(length) - length

        inputs = smoothing.backward.inputs
        rows = np.zeros((length.sum(), inputs.size))
        rows[first, inputs.slice("carried").start] = 1
        interval = events[:, smoothing.events.size : smoothing.events.size + smoothing.interval.size]
        rows[:, inputs.slice("carried").stop :] = np.repeat(interval, length, axis=0)
        scalar = slice(inputs.slice("H").start, inputs.slice("left").stop)
        correction = slice(inputs.slice("turn").start, inputs.slice("carried").start)
        for k, (flag, earlier, (values, corrections)) in enumerate(zip(flags, before, scalars, strict=True)):
            places = (first + earlier)[flag][:, None] + np.arange(values.shape[1])
            rows[places, scalar] = values
            rows[places, inputs.slice(used_row(k)).start] = 1
            rows[places[:, -1], inputs.slice("turned").start] = 1
            rows[places[:, -1], correction] = corrections
        return rows, first + length - 1

    def _rows(self, outputs: Array, table: Table) -> Array:
        """The columns of the outputs of the forward pass that `table` names, in its order."""
        table_of_outputs = self._smoothing.forward.outputs
        return np.concatenate([outputs[:, table_of_outputs.slice(name)] for name in table.names], axis=1)


def _scalars(table: Table, rows: Array) -> tuple[Array, Array]:
    """Rows of a group: H, gain, weight and left of each scalar (instants, scalars, 2 n + 2); turn and shear (instants, k)."""
    H, gain, weight, left, *corrections = table.unpack(rows).values()
    flat = [each.reshape(len(rows), math.prod(each.shape[1:])) for each in corrections]
    return np.concatenate([H, gain, weight[..., None], left[..., None]], axis=-1), np.concatenate(flat, axis=1)
