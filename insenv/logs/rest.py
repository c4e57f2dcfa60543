"""What a log measures while the vehicle stands: mean rate and specific force, and the errors of both.

The error of a mean comes from the scatter of the means of `BLOCKS` parts of the rest, so from noise and from whatever wind,
people and an engine do to the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv.estimators import ImuDataSheet
from insenv.logs.recorded import RecordedLog
from insenv.logs.units import Array

BLOCKS = 8
LEAST_REST = 100
"""Samples below which a rest is too short for its means."""
STEADY_S = 5.0
"""Shortest rest (s) whose rate is the Earth's: the sway of a ship looks steady for a shorter time."""


def rest_rows(log: RecordedLog) -> NDArray[np.intp]:
    """The samples of the time at rest; none if the log has none."""
    begin, end = log.rest or (np.inf, -np.inf)
    return np.flatnonzero((log.imu_time >= begin) & (log.imu_time <= end))


@dataclass(frozen=True)
class Rest:
    """The means of a time at rest, b: rate (3,) rad/s and force (3,) m/s^2.

    rate_sigmas (3,): standard deviations of the mean rate, rad/s.  rocking: scatter of the direction of the force (rad).
    duration, age: its length and the time from its end to the start of navigation (s).
    """

    rate: Array
    force: Array
    rate_sigmas: Array
    rocking: float
    duration: float
    age: float

    @property
    def rate_sigma(self) -> float:
        """The largest of `rate_sigmas`."""
        return float(self.rate_sigmas.max())

    @property
    def level(self) -> tuple[float, float]:
        """Roll and pitch (rad)."""
        x, y, z = self.force
        return float(np.arctan2(-y, -z)), float(np.arctan2(x, np.hypot(y, z)))

    def tilt_sigma(self, sensors: ImuDataSheet) -> float:
        """Standard deviation of roll and pitch (rad); sensors: of a unit in place."""
        return float(np.hypot(sensors.accel_bias_sigma / np.linalg.norm(self.force), self.rocking))


def rest_of(log: RecordedLog, rows: NDArray[np.intp], first: int) -> Rest:
    """The means over the samples `rows` of a log, for a start where sample `first` begins."""
    dt = log.dt[rows]
    parts = np.array_split(rows, BLOCKS)
    rates, forces = (
        np.array([values[part].sum(axis=0) / log.dt[part].sum() for part in parts])
        for values in (log.delta_angle, log.delta_velocity)
    )
    force = log.delta_velocity[rows].sum(axis=0) / dt.sum()
    return Rest(
        rate=log.delta_angle[rows].sum(axis=0) / dt.sum(),
        force=force,
        rate_sigmas=rates.std(axis=0, ddof=1) / np.sqrt(BLOCKS),
        rocking=float(forces.std(axis=0, ddof=1).max() / np.linalg.norm(force)),
        duration=float(dt.sum()),
        age=max(float(log.imu_time[first] - log.dt[first] - log.imu_time[rows[-1]]), 0.0),
    )
