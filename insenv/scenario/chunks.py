"""Feeding an estimator: chunks of samples as its input rows, and the interval at which outputs are recorded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from insenv.core.model import Model
from insenv.core.tables import Array

CHUNK = 20_000
"""Samples that are simulated before the estimators take them: about 10 MB."""
RECORDS = 3_000
"""Approximate upper bound of the number of recorded times of a run."""


def recording_interval(samples: int, records: int = RECORDS) -> int:
    """Samples from one record to the next: about `records` records, and one at the last sample if possible."""
    least = max(1, -(-samples // records))
    return next((every for every in range(least, 4 * least) if samples % every == 0), least)


def chunks(total: int, every: int, chunk: int = CHUNK) -> Iterator[tuple[int, int]]:
    """First sample and length of each chunk of `total` samples; all lengths are multiples of `every`, as `total` is."""
    chunk = max(every, chunk // every * every)
    for begin in range(0, total, chunk):
        yield begin, min(chunk, total - begin)


def input_rows(model: Model, columns: Mapping[str, Array], *shape: int) -> Array:
    """Inputs (*shape, inputs.size) of a model: each row is the column of its name, or else its start value.

    columns: arrays (*shape, ...) by name; those that the model does not take are ignored.
    """
    rows = np.tile(model.inputs.start_vector(), (*shape, 1))
    for name in model.inputs.names:
        if name in columns:
            rows[..., model.inputs.slice(name)] = columns[name].reshape(*shape, -1)
    return rows


def bridge_lost(columns: dict[str, Array]) -> int:
    """Replace lost samples (`imu_valid` 0) by interpolation between their neighbours, in place; return their number.

    This is how the airborne-navigation paper treats gaps in its data.  At the ends of the columns the nearest
    sample is held.
    """
    valid = columns["imu_valid"] != 0
    lost = int(np.count_nonzero(~valid))
    if lost and valid.any():
        place = np.arange(len(valid))
        for name in ("delta_angle", "delta_velocity"):
            column = columns[name]
            for axis in range(column.shape[1]):
                column[~valid, axis] = np.interp(place[~valid], place[valid], column[valid, axis])
    return lost
