"""What a log measures while the vehicle stands: mean rate and specific force, and the errors of both.

The error of a mean comes from the scatter of the means of `BLOCKS` parts of the rest, so from noise and from whatever wind,
people and an engine do to the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.estimators import ImuDataSheet
from insenv.geodesy import OMEGA_IE
from insenv.logs.inertial import InertialSamples
from insenv.logs.noise import shaken
from insenv.logs.recorded import NO_INFORMATION, GnssFixes, Readings, RecordedLog

# Whether the vehicle of a log stands or moves: the time at rest, and travel over the ground.
#
# Rest is what inertial unit and receiver agree on, one window after the other. An inertial unit alone cannot distinguish rest
# from a smooth straight ride: each window's mean force and rate are therefore compared with those of the rest so far, which
# shows every start from rest, and fixes show a log that begins under way.

REST_WINDOW_S = 1.0
REST_TURN = 0.02
"""Largest change of a mean body rate at rest (rad/s): a steady turn has a small standard deviation."""
REST_PUSH = 0.2
"""Largest change of a mean specific force at rest (m/s^2): people getting in tilt a car by some 0.5 deg, 0.1 m/s^2."""
REST_SPEED = 0.5
"""Largest speed over ground that a receiver shows at rest (m/s)."""
REST_SIGMAS, LARGEST_REST_SPEED = 3.0, 1.0
"""The same by the standard deviation that the receiver states, up to this speed (m/s)."""
REST_SAMPLES = 100
LEAVING_SIGMAS = 4.0
"""Standard deviations of a fix by which a vehicle has left its place."""
SMOOTH_S = 10.0
"""Time that a vehicle may move unnoticed before its fixes show it (s)."""

TRAVEL_WINDOW_S = 10.0
"""Medians over this time count, which is longer than the periods of waves."""
TRAVEL_SPEED = 1.0
"""Speed over ground (m/s) above which a vehicle travels; a vessel that swings at its mooring is slower."""


@dataclass(frozen=True)
class Travel:
    """What a log shows of travel over the ground: time (s) of the first window that shows it, speed there (m/s)."""

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
    total, count = np.zeros(6), 0
    for begin in range(first, len(end) - per_window + 1, per_window):
        window = slice(begin, begin + per_window)
        rate, force = rate_ib_b[window], specific_force_b[window]
        if shaken(rate, force):
            break
        mean = np.concatenate([rate.mean(axis=0), force.mean(axis=0)])
        if count:
            change = np.abs(mean - total / count)
            if change[:3].max() > REST_TURN or change[3:].max() > REST_PUSH:
                break
        if gnss is not None:
            span = float(end[first]), float(end[begin]), float(end[begin + per_window - 1])
            if gnss.velocity_n is not None and _has_speed(gnss, gnss.velocity_n, *span[1:]):
                break
            if gnss.velocity_n is None and (left := _left_at(gnss, *span)) is not None:
                until = int(np.searchsorted(end, left))
                break
        total, count = total + mean, count + 1
        until = begin + per_window
    return float(end[until - 1]) if until - first >= REST_SAMPLES else None


def _has_speed(gnss: GnssFixes, velocity_n: Array, begin: float, end: float) -> bool:
    """Whether a velocity from `begin` to `end` (s) shows motion."""
    now, allowed = (gnss.time >= begin) & (gnss.time <= end), np.full(len(gnss.time), REST_SPEED)
    if gnss.velocity_sigma is not None:
        sigma = gnss.velocity_sigma[:, :2].max(axis=1)
        now &= sigma < NO_INFORMATION
        allowed = np.clip(REST_SIGMAS * sigma, REST_SPEED, LARGEST_REST_SPEED)
    return bool(np.any(np.hypot(*velocity_n[now, :2].T) > allowed[now]))


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
    if not (np.abs(way[now]) > LEAVING_SIGMAS * gnss.position_sigma[use][now, :2]).any():
        return None
    time = gnss.time[use] - gnss.time[use].mean()
    way = way - way.mean(axis=0)
    uniform = np.outer(time, time @ way / (time @ time))
    steady = float(np.sum((way - uniform) ** 2)) < 0.5 * float(np.sum(way**2))
    return since if steady else begin - SMOOTH_S


def travel(log: RecordedLog, begin_s: float, end_s: float) -> Travel | None:
    """The first travel over the ground between two times (s); None if there is none.

    It shows in the fixes, or else in the reference, an odometer or a Doppler log that tracks the ground.

    The speed is that of the median velocity over `TRAVEL_WINDOW_S`, or of the way between median places; what their
    standard deviations explain does not count.
    """
    track = _ground_track(log, begin_s, end_s)
    if track is None:
        return None
    time, velocity, sigma = track
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    at = np.flatnonzero(speed > TRAVEL_SPEED + LEAVING_SIGMAS * sigma)
    return Travel(float(time[at[0]]), float(speed[at[0]])) if at.size else None


def shows_travel(log: RecordedLog, begin_s: float, end_s: float) -> bool:
    """Whether what `travel` looks at would show travel between two times (s)."""
    return _ground_track(log, begin_s, end_s) is not None


def _ground_track(log: RecordedLog, begin_s: float, end_s: float) -> tuple[Array, Array, Array] | None:
    """Middle (k,) s, median velocity (k, 2) m/s and its standard deviation (k,) of windows; None if nothing shows them."""
    gnss, reference, track = log.gnss, log.reference, None
    if gnss is not None and gnss.velocity_n is not None and gnss.velocity_sigma is not None:
        track = _by_velocity(gnss.time, gnss.velocity_n, gnss.velocity_sigma, begin_s, end_s)
    if gnss is not None and track is None:
        track = _by_way(gnss, begin_s, end_s)
    if track is not None:
        return track
    if reference is not None and reference.velocity_n is not None:
        return _by_velocity(reference.time, reference.velocity_n, np.zeros(reference.velocity_n.shape), begin_s, end_s)
    for each in log.instruments:
        velocity = _over_ground(log, each)
        if velocity is not None:
            return _by_velocity(each.time, velocity, np.zeros(velocity.shape), begin_s, end_s)
    return None


def _over_ground(log: RecordedLog, readings: Readings) -> Array | None:
    """Velocity over the ground (m, 2) m/s, b, that an odometer or a Doppler log shows; None of other instruments."""
    if readings.id == "odometer":
        return np.column_stack([readings.values[:, 0], np.zeros(len(readings.time))])
    tracks_ground = readings.id == "dvl" and not np.any(log.stated_errors.get("dvl_current_sigma", 0.0))
    return readings.values[:, :2] if tracks_ground else None


def _by_velocity(time: Array, velocity: Array, sigma: Array, begin_s: float, end_s: float) -> tuple[Array, Array, Array] | None:
    known = sigma[:, :2].max(axis=1) < NO_INFORMATION
    windows = _windows(np.column_stack([time, velocity[:, :2], sigma[:, :2].max(axis=1)])[known], begin_s, end_s)
    if windows is None:
        return None
    middle, count = windows
    return middle[:, 0], middle[:, 1:3], middle[:, 3] / np.sqrt(count)


def _by_way(gnss: GnssFixes, begin_s: float, end_s: float) -> tuple[Array, Array, Array] | None:
    """From the median place of each window to that of the next."""
    place = [gnss.latitude, np.unwrap(gnss.longitude), gnss.height, gnss.position_sigma[:, :2].max(axis=1)]
    windows = _windows(np.column_stack([gnss.time, *place]), begin_s, end_s)
    if windows is None or len(windows[0]) < 2:
        return None
    middle, count = windows
    way = geodesy.numeric.ned_offset(*middle[1:, 1:4].T, *middle[:-1, 1:4].T)
    took = np.diff(middle[:, 0])
    sigma = middle[:, 4] / np.sqrt(count)
    return 0.5 * (middle[1:, 0] + middle[:-1, 0]), way[:, :2] / took[:, None], np.hypot(sigma[1:], sigma[:-1]) / took


def _windows(rows: Array, begin_s: float, end_s: float) -> tuple[Array, Array] | None:
    """Medians (k, columns) of the rows in windows of `TRAVEL_WINDOW_S` by their first column, the time, and their numbers (k,).

    Medians, because one wrong fix must not refuse an alignment. The last window may be shorter.
    """
    rows = rows[(rows[:, 0] >= begin_s) & (rows[:, 0] <= end_s)]
    if not len(rows):
        return None
    number = (rows[:, 0] - rows[0, 0]) // TRAVEL_WINDOW_S
    windows = np.split(rows, np.flatnonzero(np.diff(number)) + 1)
    return np.array([np.median(each, axis=0) for each in windows]), np.array([float(len(each)) for each in windows])


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
        return level_of(self.force)

    def tilt_sigma(self, sensors: ImuDataSheet) -> float:
        """Standard deviation of roll and pitch (rad); sensors: of a unit in place."""
        return float(np.hypot(sensors.accel_bias_sigma / np.linalg.norm(self.force), self.rocking))


def level_of(force_b: Array) -> tuple[float, float]:
    """Roll and pitch (rad) with which a specific force (3, b) points upwards."""
    x, y, z = force_b
    return float(np.arctan2(-y, -z)), float(np.arctan2(x, np.hypot(y, z)))


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


# Whether the unit of the gyros is right.
#
# The size of gravity shows a wrong unit of the accelerometers. Gyros measure the Earth's rate and their bias at rest, and a
# vehicle that follows its course turns about the vertical as its course over ground does, whatever its side slip.

MIN_COURSE_SPEED = 3.0
"""Speed over ground (m/s) from which the course counts."""
MIN_TURN_S, MAX_TURN_S = 1.0, 2.5
"""Turns are compared between fixes that are this far apart, at least and at most (s)."""
MIN_PAIRS = 10
"""Pairs of fixes that are needed."""
MIN_TURN = np.radians(45.0)
"""Extent of the course (rad) from which the vehicle has turned: waves of 2 m swing that of a ship of 6 m/s by 20 deg."""
MIN_CORRELATION = 0.9
"""Correlation of the turns from which the vehicle follows its course: not that of a multirotor."""
WRONG_RATIO = 2.0
"""Ratio of the turns, or its inverse, that no scale factor and no side slip explains."""

BIAS_SIGMAS = 10.0
"""Standard deviations of the bias by which the rate at rest differs from the Earth's if the unit is wrong."""
RATE_SIGMAS = 3.0
"""Standard deviations of the mean rate, likewise, of a vehicle that rocks."""
_RATE_AT_REST = declared(
    "rate-at-rest",
    "imu: the gyros measure {rate:.3g} deg/h at rest; the Earth's rate is 15 deg/h and the data sheet allows a bias of "
    "{bias:.2g} deg/h: check gyro_unit, gyro_scale, kind, and the grade",
)
_TURNS_DIFFER = declared(
    "turns-differ",
    "imu: the gyros turn {ratio:.3g} times as far as the course of the fixes (57.3 or 0.0175: degrees and radians): check "
    "gyro_unit, gyro_scale, kind",
)


def rest_rate_notes(log: RecordedLog) -> list[Remark]:
    """A note if the mean rate at rest is not that of the Earth and a bias as the data sheet in the description allows it."""
    rows = rest_rows(log)
    if not log.states_unit or len(rows) < REST_SAMPLES or log.dt[rows].sum() < STEADY_S:
        return []
    rest = rest_of(log, rows, 0)
    rate, bias = float(np.linalg.norm(rest.rate)), float(np.sqrt(3.0) * log.sensors(in_place=True).gyro_bias_sigma)
    if abs(rate - OMEGA_IE) <= BIAS_SIGMAS * bias + RATE_SIGMAS * np.sqrt(3.0) * rest.rate_sigma:
        return []
    hourly = float(np.degrees(3600.0))
    return [_RATE_AT_REST.filled(rate=rate * hourly, bias=bias * hourly)]


def turn_notes(samples: InertialSamples, gnss: GnssFixes | None) -> list[Remark]:
    """A note if the turns that the gyros measure are proportional to those of the course, and not equal to them."""
    ratio = turn_ratio(samples, gnss)
    if ratio is None or 1.0 / WRONG_RATIO < ratio < WRONG_RATIO:
        return []
    return [_TURNS_DIFFER.filled(ratio=ratio)]


def turn_ratio(samples: InertialSamples, gnss: GnssFixes | None) -> float | None:
    """How many times as far the gyros turn as the course of the fixes; None where both are not proportional, or not shown."""
    if gnss is None or gnss.velocity_n is None or gnss.velocity_sigma is None:
        return None
    moving = np.hypot(gnss.velocity_n[:, 0], gnss.velocity_n[:, 1]) > MIN_COURSE_SPEED
    moving &= gnss.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
    moving &= (gnss.time >= samples.imu_time[0]) & (gnss.time <= samples.imu_time[-1])
    time, velocity = gnss.time[moving], gnss.velocity_n[moving]
    _, first = np.unique(np.floor(time / MIN_TURN_S), return_index=True)
    time, velocity = time[first], velocity[first]
    near = np.diff(time) <= MAX_TURN_S
    if np.count_nonzero(near) < MIN_PAIRS:
        return None
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    if np.ptp(course) < MIN_TURN:
        return None
    down = -np.median(samples.delta_velocity / samples.dt[:, None], axis=0)
    turned = np.cumsum(samples.delta_angle @ down) / max(float(np.linalg.norm(down)), 1e-9)
    by_course = np.diff(course)[near]
    by_gyro = np.diff(np.interp(time, samples.imu_time, turned))[near]
    by_course, by_gyro = by_course - by_course.mean(), by_gyro - by_gyro.mean()
    both, alone = float(by_gyro @ by_course), float(by_course @ by_course)
    if both <= MIN_CORRELATION * np.sqrt(float(by_gyro @ by_gyro) * alone):
        return None
    return both / alone
