"""The heading of a recorded log by its first motion: from the course, and by the specific force.

By the course: the gyro rates minus their mean at rest are integrated from a heading of 0 at rest; the heading at rest is the
course over ground minus the integrated heading.  A vehicle that moves sideways has another heading.

By the specific force: integrated since the vehicle stood, it gives the same change of velocity as the fixes in the right
heading only, whichever way the vehicle moves.  A tilt and an accelerometer bias limit it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.errors import InputError, InsenvError
from insenv.base.remarks import Remark, declared
from insenv.core.runner import make_runner
from insenv.estimators import ImuDataSheet, get
from insenv.logs import GnssFixes, RecordedLog
from insenv.scenario.chunks import input_rows

Array = NDArray[np.float64]

COURSE_SPEED = 5.0  # m/s: above it the course over ground gives the heading to a few degrees
COURSE_FIXES = 5  # number of fixes to average
COURSE_SIGMA = float(np.radians(5.0))  # side slip and course noise; of a given heading too
CONFLICT = 2.0  # standard deviations by which a given heading and one from the motion may differ
MATCHED = float(np.radians(15.0))  # largest standard deviation of a heading by the specific force that decides
LEAST_MATCHED = float(np.radians(1.0))  # lever arm, latency, scale factors
LARGEST_SIGMA = float(np.radians(60.0))  # of a heading: beyond it a linear filter does not converge


def heading_by_course(log: RecordedLog, first: int, level: tuple[float, float], rest_rate: Array) -> float:
    """Heading (rad) where sample `first` begins, if the vehicle then moves forwards.

    level: roll and pitch there (rad); rest_rate (3,) rad/s: mean rate at rest, b.  Raises `InsenvError` without motion.
    """
    fixes = _fixes_in_motion(log, first)
    carried = attitude.numeric.to_euler(_carried(log, first, fixes, level, rest_rate)["q_nb"])[2]
    course = np.arctan2(fixes.velocity[:, 1], fixes.velocity[:, 0])
    return float(np.angle(np.mean(np.exp(1j * (course - carried[fixes.sample - first])))))


def heading_by_force(
    log: RecordedLog, first: int, level: tuple[float, float], rest_rate: Array, sensors: ImuDataSheet, tilt_sigma: float
) -> tuple[float, float]:
    """Heading (rad) where sample `first` begins, by the specific force since the vehicle stood, and its standard deviation.

    Arguments as for `heading_by_course`; sensors: of the unit in place; tilt_sigma: of the level (rad).
    """
    fixes = _fixes_in_motion(log, first)
    # in the frame of heading 0 the computed Earth rate is that of another heading: at rest the attitude must stay
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(*level, 0.0))
    apparent = rest_rate - C_nb.T @ geodesy.numeric.earth_rate_n(fixes.latitude)
    velocity = _carried(log, first, fixes, level, apparent)["velocity_n"]
    stood = log.description.initial.static_until_s
    begin = first if stood is None else int(np.clip(np.searchsorted(log.imu_time, stood), first, fixes.sample[0]))
    gained = velocity[fixes.sample - first] - velocity[begin - first]
    measured, integrated = (values[:, 0] + 1j * values[:, 1] for values in (fixes.velocity, gained))
    heading = float(np.angle(np.sum(measured * integrated.conj())))

    time = float(log.imu_time[fixes.sample[-1]] - log.imu_time[begin])
    slope = np.hypot(geodesy.NOMINAL_GRAVITY * tilt_sigma, sensors.accel_bias_sigma)
    error = np.hypot(np.hypot(slope * time, sensors.velocity_random_walk * np.sqrt(time)), fixes.sigma)
    speed = float(np.hypot(*fixes.velocity[:, :2].T).mean())
    return heading, float(np.hypot(error / speed, LEAST_MATCHED))


_CONFLICT = (
    "the given heading, {heading:.4g} deg, and the course of the first motion, which means {course:.4g} deg, are {apart:.3g} "
    "deg apart: "
)
_WIDENED = declared(
    "heading-sigma-widened", f"{_CONFLICT}its standard deviation is taken as {{wide:.3g}} deg, not {{narrow:.2g}} deg"
)
_REPLACED = declared(
    "heading-replaced",
    f"{_CONFLICT}navigation starts with {{force:.4g}} deg (1 sigma {{sigma:.2g}} deg), with which the specific force agrees "
    "with the change of velocity",
)


def checked_by_motion(
    log: RecordedLog,
    first: int,
    angles: tuple[float, float, float],
    rest_rate: Array,
    sigma: float,
    tilt_sigma: float,
) -> tuple[float, float, tuple[Remark, ...]]:
    """The given heading and its standard deviation (rad), or others where the first motion contradicts it, with a remark.

    angles: roll, pitch and the given heading (rad).  The course alone does not decide, because a vehicle may move sideways.
    The specific force does, and is taken unless it agrees with the given heading alone.  Where the accelerometers are too poor
    for that, the standard deviation grows.
    """
    roll, pitch, heading = angles
    try:
        course = heading_by_course(log, first, (roll, pitch), rest_rate)
    except InsenvError:
        return heading, sigma, ()
    apart = _apart(heading, course)
    if apart <= CONFLICT * np.hypot(sigma, COURSE_SIGMA):
        return heading, sigma, ()
    conflict = {"heading": np.degrees(heading), "course": np.degrees(course) % 360, "apart": np.degrees(apart)}
    force, force_sigma = heading_by_force(log, first, (roll, pitch), rest_rate, log.sensors(in_place=True), tilt_sigma)
    if force_sigma > MATCHED:
        widened = max(sigma, min(apart, LARGEST_SIGMA))
        said = _WIDENED.filled(**conflict, wide=np.degrees(widened), narrow=np.degrees(sigma))
        return heading, widened, (said,)
    of_given, of_course = (
        _apart(angle, force) / np.hypot(own, force_sigma) for angle, own in ((heading, sigma), (course, COURSE_SIGMA))
    )
    if of_given <= CONFLICT < of_course:
        return heading, sigma, ()
    said = _REPLACED.filled(**conflict, force=np.degrees(force) % 360, sigma=np.degrees(force_sigma))
    return force, force_sigma, (said,)


@dataclass(frozen=True)
class _Fixes:
    """The first fixes in motion: sample (k,) at each; velocity (k, 3) m/s, n; sigma: of its components; latitude (rad)."""

    sample: NDArray[np.intp]
    velocity: Array
    sigma: float
    latitude: float


def _fixes_in_motion(log: RecordedLog, first: int) -> _Fixes:
    if log.gnss is None:
        raise InputError("heading from motion needs [gnss]; or give [initial] heading_deg, or use --start reference")
    time, velocity, sigma = _ground_velocity(log.gnss)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    moving = np.flatnonzero((speed > COURSE_SPEED) & (time > log.imu_time[first]) & (time < log.imu_time[-1]))[:COURSE_FIXES]
    if len(moving) < COURSE_FIXES:
        raise InputError(
            f"heading from motion: fewer than {COURSE_FIXES} fixes are faster than {COURSE_SPEED:g} m/s; "
            "give [initial] heading_deg, or heading_sigma_deg = 180 for an estimator of large misalignment (aqe-sukf), or use "
            "--start reference"
        )
    sample = np.maximum(np.searchsorted(log.imu_time, time[moving]), first)
    return _Fixes(sample, velocity[moving], float(sigma[moving].mean()), float(log.gnss.latitude[0]))


def _carried(log: RecordedLog, first: int, fixes: _Fixes, level: tuple[float, float], rate: Array) -> dict[str, Any]:
    """Outputs of the mechanization from heading 0 and rest at sample `first` to the last of the fixes, `rate` subtracted."""
    last = int(fixes.sample[-1])
    window = slice(first, last + 1)
    # any estimator that integrates the attitude will do; for a few minutes the position does not matter
    model = get("wander-sins").model
    runner = make_runner(model, {"start_latitude": fixes.latitude, "start_roll": level[0], "start_pitch": level[1]})
    columns = {
        "delta_angle": log.delta_angle[window] - rate * log.dt[window, None],
        "delta_velocity": log.delta_velocity[window],
        "dt": log.dt[window],
    }
    return model.outputs.unpack(runner.run(last + 1 - first, input_rows(model, columns, last + 1 - first)))


def _ground_velocity(gnss: GnssFixes) -> tuple[Array, Array, Array]:
    """Times (s), velocities (m/s, n) and their standard deviations: the receiver's, or differences of its positions."""
    if gnss.velocity_n is not None:
        sigma = np.ones(gnss.velocity_n.shape) if gnss.velocity_sigma is None else gnss.velocity_sigma
        return gnss.time, gnss.velocity_n, sigma[:, :2].max(axis=1)
    place = np.stack([gnss.latitude, gnss.longitude, gnss.height], axis=1)
    moved = geodesy.numeric.ned_offset(*place[1:].T, *place[:-1].T)
    took = np.diff(gnss.time)
    sigma = np.hypot(gnss.position_sigma[1:, :2].max(axis=1), gnss.position_sigma[:-1, :2].max(axis=1)) / took
    return (gnss.time[1:] + gnss.time[:-1]) / 2, moved / took[:, None], sigma


def _apart(a: float, b: float) -> float:
    return abs(float(np.angle(np.exp(1j * (a - b)))))
