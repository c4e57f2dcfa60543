"""A recorded log as columns of samples, by the names of estimators' input rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv.logs import GnssFixes, RecordedLog

Array = NDArray[np.float64]


def sample_columns(log: RecordedLog, window: slice) -> tuple[dict[str, Array], int]:
    """Columns of the samples in `window`, and the number of fixes that could not be used.

    Each fix goes with the first sample that ends at or after its time, with its age then: estimators fuse it at its own time.
    A sample takes one fix; of several, the last.
    """
    columns = {
        "delta_angle": log.delta_angle[window],
        "delta_velocity": log.delta_velocity[window],
        "dt": log.dt[window],
    }
    if log.gnss is None:
        return columns, 0
    fixes, dropped = _fix_columns(log.gnss, log.imu_time[window], log.dt[window])
    return {**columns, **fixes}, dropped


def _fix_columns(gnss: GnssFixes, end: Array, dt: Array) -> tuple[dict[str, Array], int]:
    inside = np.flatnonzero((gnss.time > end[0] - dt[0]) & (gnss.time <= end[-1]))
    sample = np.searchsorted(end, gnss.time[inside], side="left")
    last = np.append(np.diff(sample) > 0, True)[: len(inside)]
    fix, sample = inside[last], sample[last]
    valid = np.zeros(len(end))
    valid[sample] = 1

    def spread(values: Array, otherwise: float = 0.0) -> Array:
        column = np.full((len(end), *values.shape[1:]), otherwise)
        column[sample] = values[fix]
        return column

    columns = {
        "gnss_valid": valid,
        "gnss_age": spread(end[np.searchsorted(end, gnss.time.clip(end[0], end[-1]), side="left")] - gnss.time),
        "gnss_latitude": spread(gnss.latitude),
        "gnss_longitude": spread(gnss.longitude),
        "gnss_height": spread(gnss.height),
        "gnss_position_sigma": spread(gnss.position_sigma, 1.0),
    }
    if gnss.velocity_n is not None and gnss.velocity_sigma is not None:
        columns["gnss_velocity_valid"] = valid
        columns["gnss_velocity_n"] = spread(gnss.velocity_n)
        columns["gnss_velocity_sigma"] = spread(gnss.velocity_sigma, 1.0)
    return columns, int(len(inside) - len(fix))
