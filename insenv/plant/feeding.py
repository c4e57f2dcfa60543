"""Feeding an estimator: from columns of samples, by name, to its input rows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from insenv.core.model import Model

Array = NDArray[np.float64]


def input_rows(model: Model, columns: Mapping[str, Array], count: int) -> Array:
    """Inputs (count, inputs.size) of a model: each row it has from the column of that name, its start value where there is
    none.

    columns: arrays (count, ...) by name; names that the model does not take are passed over.
    """
    rows = np.tile(model.inputs.start_vector(), (count, 1))
    for name in model.inputs.names:
        if name in columns:
            rows[:, model.inputs.slice(name)] = columns[name].reshape(count, -1)
    return rows


def bridge_lost(columns: dict[str, Array]) -> int:
    """Replace lost samples (`imu_valid` 0) by interpolation between their neighbours, in place; the number of them.

    As the airborne-navigation paper treats gaps in its rows; at an end of the columns the nearest sample is held.
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
