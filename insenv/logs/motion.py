"""Whether the vehicle of a log stands or moves: the time at rest, and travel over the ground.

Rest is what inertial unit and receiver agree on, one window after the other. An inertial unit alone cannot distinguish rest
from a smooth straight ride: each window's mean force and rate are therefore compared with those of the rest so far, which
shows every start from rest, and fixes show a log that begins under way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv import geodesy
from insenv.logs.course import NO_INFORMATION
from insenv.logs.recorded import GnssFixes, RecordedLog
from insenv.logs.units import Array

REST_WINDOW_S = 1.0
REST_RATE = 0.02
"""Largest standard deviation of a body rate of a vehicle at rest with its motor idling (rad/s)."""
REST_FORCE = 0.5
"""Largest standard deviation of the specific force, likewise (m/s^2)."""
REST_TURN = 0.02
"""Largest change of a mean body rate at rest (rad/s): a steady turn has a small standard deviation."""
REST_PUSH = 0.2
"""Largest change of a mean specific force at rest (m/s^2): people getting in tilt a car by some 0.5 deg, 0.1 m/s^2."""
REST_SPEED = 0.5
"""Largest speed over ground that a receiver shows at rest (m/s)."""
REST_SAMPLES = 100
LEAVES = 4.0
"""Standard deviations of a fix by which a vehicle has left its place."""
SMOOTH_S = 10.0
"""Time that a vehicle may move unnoticed before its fixes show it (s)."""

TRAVEL_WINDOW_S = 10.0
"""Travel is averaged over this time, which is longer than the periods of waves."""
TRAVEL_SPEED = 1.0
"""Mean speed over ground (m/s) above which a vehicle travels; a vessel that swings at its mooring is slower."""


@dataclass(frozen=True)
class Travel:
    """What a log shows of travel over the ground: time (s) of the first window that shows it, mean speed there (m/s)."""

    time: float
    speed: float


def rest_until(
    end: Array, rate_ib_b: Array, specific_force_b: Array, gnss: GnssFixes | None, begin_s: float | None = None
) -> float | None:
    """End (s) of the time at rest that begins with the first sample, or at `begin_s`; None if the vehicle moves at once.

    end (n,) s; rate_ib_b (n, 3) rad/s; specific_force_b (n, 3) m/s^2.
    """
    first = 0 if begin_s is None else int(np.searchsorted(end, begin_s))
    if len(end) - first < REST_SAMPLES:
        return None
    per_window = max(round(REST_WINDOW_S / float(np.median(np.diff(end)))), 2)
    until = first
    means: list[Array] = []
    for begin in range(first, len(end) - per_window + 1, per_window):
        window = slice(begin, begin + per_window)
        rate, force = rate_ib_b[window], specific_force_b[window]
        if rate.std(axis=0).max() > REST_RATE or force.std(axis=0).max() > REST_FORCE:
            break
        mean = np.concatenate([rate.mean(axis=0), force.mean(axis=0)])
        if means:
            change = np.abs(mean - np.mean(means, axis=0))
            if change[:3].max() > REST_TURN or change[3:].max() > REST_PUSH:
                break
        if gnss is not None:
            span = float(end[first]), float(end[begin]), float(end[begin + per_window - 1])
            if gnss.velocity_n is not None and _has_speed(gnss, gnss.velocity_n, *span[1:]):
                break
            if gnss.velocity_n is None and (left := _left_at(gnss, *span)) is not None:
                until = int(np.searchsorted(end, left))
                break
        means.append(mean)
        until = begin + per_window
    return float(end[until - 1]) if until - first >= REST_SAMPLES else None


def _has_speed(gnss: GnssFixes, velocity_n: Array, begin: float, end: float) -> bool:
    """Whether a velocity from `begin` to `end` (s) shows motion."""
    now = (gnss.time >= begin) & (gnss.time <= end)
    if gnss.velocity_sigma is not None:
        now &= gnss.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
    return bool(now.any() and np.hypot(*velocity_n[now, :2].T).max() > REST_SPEED)


def _left_at(gnss: GnssFixes, since: float, begin: float, end: float) -> float | None:
    """When the vehicle left the place of the fixes after `since` (s), if one from `begin` to `end` lies outside; else None.

    A vehicle that leaves its place without a sign of it in the inertial unit rides smoothly: from the start, if its way so far
    is that of a uniform motion, otherwise for at most `SMOOTH_S`.
    """
    use = (gnss.time >= since) & (gnss.time <= end)
    now = gnss.time[use] >= begin
    if not now.any() or now.all():
        return None
    places = [values[use] for values in (gnss.latitude, gnss.longitude, gnss.height)]
    way = geodesy.numeric.ned_offset(*places, *(float(p[~now].mean()) for p in places))[:, :2]
    if not (np.abs(way[now]) > LEAVES * gnss.position_sigma[use][now, :2]).any():
        return None
    time = gnss.time[use] - gnss.time[use].mean()
    way = way - way.mean(axis=0)
    uniform = np.outer(time, time @ way / (time @ time))
    steady = float(np.sum((way - uniform) ** 2)) < 0.5 * float(np.sum(way**2))
    return since if steady else begin - SMOOTH_S


def travel(log: RecordedLog, begin_s: float, end_s: float) -> Travel | None:
    """The first travel over the ground between two times (s), by the fixes or else by the reference; None if there is none.

    The speed is the mean over `TRAVEL_WINDOW_S`: of the velocities, or of the way between positions, less what
    their standard deviations explain.
    """
    found = _ground_track(log, begin_s, end_s)
    if found is None:
        return None
    time, mean_velocity, sigma = found
    speed = np.hypot(mean_velocity[:, 0], mean_velocity[:, 1])
    at = np.flatnonzero(speed > TRAVEL_SPEED + LEAVES * sigma)
    return Travel(float(time[at[0]]), float(speed[at[0]])) if at.size else None


def shows_travel(log: RecordedLog, begin_s: float, end_s: float) -> bool:
    """Whether fixes or reference would show travel between two times (s)."""
    return _ground_track(log, begin_s, end_s) is not None


def _ground_track(log: RecordedLog, begin_s: float, end_s: float) -> tuple[Array, Array, Array] | None:
    """Middle (k,) s, mean velocity (k, 2) m/s and its standard deviation (k,) of windows; None if nothing shows them."""
    gnss, reference = log.gnss, log.reference
    if gnss is not None and gnss.velocity_n is not None and gnss.velocity_sigma is not None:
        found = _mean_velocity(gnss.time, gnss.velocity_n, gnss.velocity_sigma, begin_s, end_s)
        if found is not None:
            return found
    if gnss is not None:
        found = _mean_way(gnss, begin_s, end_s)
        if found is not None:
            return found
    if reference is not None and reference.velocity_n is not None:
        return _mean_velocity(reference.time, reference.velocity_n, np.zeros(reference.velocity_n.shape), begin_s, end_s)
    return None


def _mean_velocity(
    time: Array, velocity: Array, sigma: Array, begin_s: float, end_s: float
) -> tuple[Array, Array, Array] | None:
    inside = (time >= begin_s) & (time <= end_s) & (sigma[:, :2].max(axis=1) < NO_INFORMATION)
    if not inside.any():
        return None
    time, velocity, sigma = time[inside], velocity[inside, :2], sigma[inside, :2].max(axis=1)
    number = ((time - time[0]) // TRAVEL_WINDOW_S).astype(np.int64)
    _, group = np.unique(number, return_inverse=True)
    count = np.bincount(group)
    means = [np.bincount(group, weights=values) / count for values in (time, *velocity.T, sigma)]
    return means[0], np.stack(means[1:3], axis=1), means[3] / np.sqrt(count)


def _mean_way(gnss: GnssFixes, begin_s: float, end_s: float) -> tuple[Array, Array, Array] | None:
    """From each fix to the first one that is `TRAVEL_WINDOW_S` later."""
    inside = np.flatnonzero((gnss.time >= begin_s) & (gnss.time <= end_s))
    time = gnss.time[inside]
    later = np.searchsorted(time, time + TRAVEL_WINDOW_S - 1e-9)
    first = np.flatnonzero(later < len(time))
    if not first.size:
        return None
    last = later[first]
    places = [values[inside] for values in (gnss.latitude, gnss.longitude, gnss.height)]
    way = geodesy.numeric.ned_offset(*(p[last] for p in places), *(p[first] for p in places))
    took = time[last] - time[first]
    sigma = gnss.position_sigma[inside, :2].max(axis=1)
    return 0.5 * (time[last] + time[first]), way[:, :2] / took[:, None], np.hypot(sigma[last], sigma[first]) / took
