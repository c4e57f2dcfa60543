"""The samples of a recorded log as inputs of estimators, each with the fix and the measurements that arrive in it."""

from __future__ import annotations

import numpy as np

from insenv.core.tables import Array
from insenv.logs import GnssFixes, RecordedLog, instruments
from insenv.logs.recorded import delivered


def sample_columns(log: RecordedLog, window: slice) -> tuple[dict[str, Array], int]:
    """Samples in `window` as columns by the names of the estimators' inputs, and the number of fixes left out.

    A fix belongs to the first sample that ends at or after its arrival, or its time where the log states no arrival; its
    age, `gnss_age`, counts to the end of that sample.  A sample has at most one fix: of several, the last.
    """
    columns = {
        "delta_angle": log.delta_angle[window],
        "delta_velocity": log.delta_velocity[window],
        "dt": log.dt[window],
        **instruments.sample_columns(log.instruments, log.imu_time[window], log.dt[window]),
    }
    if log.gnss is None:
        return columns, 0
    fixes, dropped = _fix_columns(log.gnss, log.imu_time[window], log.dt[window])
    return {**columns, **fixes}, dropped


def _fix_columns(gnss: GnssFixes, end: Array, dt: Array) -> tuple[dict[str, Array], int]:
    fix, sample, age = delivered(gnss.time, gnss.arrival, gnss.age, end, dt)
    arrived = gnss.time if gnss.arrival is None else gnss.arrival
    inside = np.count_nonzero((arrived > end[0] - dt[0]) & (arrived <= end[-1]))
    valid = np.zeros(len(end))
    valid[sample] = 1

    ages = np.zeros(len(end))
    ages[sample] = age

    def spread(values: Array, otherwise: float = 0.0) -> Array:
        column = np.full((len(end), *values.shape[1:]), otherwise)
        column[sample] = values[fix]
        return column

    columns = {
        "gnss_valid": valid,
        "gnss_age": ages,
        "gnss_latitude": spread(gnss.latitude),
        "gnss_longitude": spread(gnss.longitude),
        "gnss_height": spread(gnss.height),
        "gnss_position_sigma": spread(gnss.position_sigma, 1.0),
    }
    if gnss.velocity_n is not None and gnss.velocity_sigma is not None:
        columns["gnss_velocity_valid"] = valid
        columns["gnss_velocity_n"] = spread(gnss.velocity_n)
        columns["gnss_velocity_sigma"] = spread(gnss.velocity_sigma, 1.0)
    return columns, int(inside - len(fix))
