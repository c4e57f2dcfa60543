"""Changes of the receiver's velocity in a recorded log, beside its inertial increments (`insenv.evaluation.specific_force`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.evaluation.specific_force import VelocityChanges
from insenv.logs import GnssFixes, RecordedLog
from insenv.logs.recorded import NO_INFORMATION

SHORTEST_S, LONGEST_S = 0.95, 2.05
"""Length of an interval between two fixes: the noise of the receiver is divided by it, and the gyros are not corrected."""
SWING_S = 0.1
"""Time over which the rate of the lever arm is a mean: a receiver does not follow vibration."""
COVERED = 0.98
"""Share of an interval that samples cover."""


def velocity_changes(log: RecordedLog) -> VelocityChanges | None:
    """The changes over about a second between fixes with a velocity; None if there are none.

    Intervals with interpolated samples are left out.
    """
    gnss = log.gnss
    if gnss is None or gnss.velocity_n is None or len(log.imu_time) < 3:
        return None
    known: NDArray[np.bool_] = np.isfinite(gnss.velocity_n)
    if gnss.velocity_sigma is not None:
        known &= gnss.velocity_sigma < NO_INFORMATION
    pairs = _pairs(gnss.time, np.asarray(known.any(axis=1)), float(log.imu_time[0] - log.dt[0]), float(log.imu_time[-1]))
    if not len(pairs):
        return None
    ends = gnss.time[pairs].T
    first = np.searchsorted(log.imu_time, ends[0], side="right")
    count = np.searchsorted(log.imu_time, ends[1], side="left") - first + 1
    bridged = np.append(0, np.cumsum(log.bridged))
    whole = bridged[first + count] == bridged[first]
    pairs, ends, first, count = pairs[whole], ends[:, whole], first[whole], count[whole]
    if not len(pairs):
        return None
    middle, increment_b, covered = _increments(log, ends, first, count)
    begin, end = pairs.T
    duration = ends[1] - ends[0]
    use = covered >= COVERED * duration
    change = np.nan_to_num(gnss.velocity_n[end] - gnss.velocity_n[begin])
    demanded = change - _gravity(gnss, begin) * duration[:, None]
    changes = VelocityChanges(middle, duration, increment_b, demanded, known[begin] & known[end])
    return VelocityChanges(**{name: values[use] for name, values in vars(changes).items()}) if use.any() else None


def _pairs(time: Array, known: NDArray[np.bool_], begin_s: float, end_s: float) -> NDArray[np.intp]:
    """Rows (k, 2) of the fixes at both ends of the intervals, which do not overlap."""
    rows = np.flatnonzero(known & (time > begin_s) & (time <= end_s))
    pairs, last = [], 0
    while last < len(rows):
        following = int(np.searchsorted(time[rows], time[rows[last]] + SHORTEST_S))
        if following >= len(rows):
            break
        if time[rows[following]] - time[rows[last]] <= LONGEST_S:
            pairs.append((rows[last], rows[following]))
        last = following
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _increments(log: RecordedLog, ends: Array, first: NDArray[np.intp], count: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Of intervals: time in the middle, velocity change (k, 3) of the antenna in the body axes there, time that samples cover.

    ends (2, k): of the intervals, s; first, count (k,): their samples, of which the first and the last count in part.
    """
    k = len(first)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (k, 1))  # from the present body axes to those at the begin
    q_middle, middle, change, covered = q.copy(), np.zeros(k), np.zeros((k, 3)), np.zeros(k)
    for sample in range(int(count.max())):
        row = np.minimum(first + sample, len(log.dt) - 1)
        dt, end = log.dt[row], log.imu_time[row]
        part = np.clip(np.minimum(end, ends[1]) - np.maximum(end - dt, ends[0]), 0.0, None) * (sample < count)
        share = (part / dt)[:, None]
        half = attitude.numeric.from_rotation_vector(0.5 * share * log.delta_angle[row])
        q = attitude.numeric.multiply(q, half)
        change += attitude.numeric.rotate(q, share * log.delta_velocity[row])
        q = attitude.numeric.multiply(q, half)
        covered += part
        at = sample == (count - 1) // 2
        q_middle[at], middle[at] = q[at], np.minimum(end, ends[1])[at]
    if np.any(log.lever_arm_b):
        swing = [np.cross(_rate(log, at), log.lever_arm_b) for at in ends]
        change += attitude.numeric.rotate(q, swing[1]) - swing[0]
    return middle, np.asarray(attitude.numeric.rotate_inverse(q_middle, change)), covered


def _rate(log: RecordedLog, times: Array) -> Array:
    """Mean rate (k, 3) rad/s over `SWING_S` about the times (k,)."""
    angle = np.cumsum(log.delta_angle, axis=0)
    early, late = (
        np.stack([np.interp(times + offset, log.imu_time, column) for column in angle.T], axis=1)
        for offset in (-SWING_S / 2, SWING_S / 2)
    )
    return np.asarray((late - early) / SWING_S)


def _gravity(gnss: GnssFixes, rows: NDArray[np.intp]) -> Array:
    """Gravity less the Coriolis acceleration (k, 3), n, m/s^2, at fixes."""
    latitude, height, velocity = gnss.latitude[rows], gnss.height[rows], np.nan_to_num(gnss.velocity_n[rows])  # type: ignore[index]
    down = geodesy.numeric.normal_gravity(np.sin(latitude), height)
    earth = geodesy.numeric.earth_rate_n(latitude)
    transport = geodesy.numeric.transport_rate_n(velocity, latitude, height)
    zero = np.zeros_like(down)
    return np.asarray(np.stack([zero, zero, down], axis=1) - np.cross(2.0 * earth + transport, velocity))
