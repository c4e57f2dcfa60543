"""Whether the unit of the gyros is right.

The size of gravity shows a wrong unit of the accelerometers. Gyros measure the Earth's rate and their bias at rest, and a
vehicle that follows its course turns about the vertical as its course over ground does, whatever its side slip.
"""

from __future__ import annotations

import numpy as np

from insenv.geodesy import OMEGA_IE
from insenv.logs.course import NO_INFORMATION
from insenv.logs.inertial import InertialSamples
from insenv.logs.recorded import GnssFixes, RecordedLog

SPEED = 3.0
"""Speed over ground (m/s) from which the course counts."""
STEP_S, LONGEST_S = 1.0, 2.5
"""Turns are compared between fixes that are this far apart, at least and at most (s)."""
FEWEST = 10
"""Pairs of fixes that are needed."""
ALIKE = 0.9
"""Correlation of the turns from which the vehicle follows its course: not that of a multirotor."""
WRONG = 2.0
"""Ratio of the turns, or its inverse, that no scale factor and no side slip explains."""

BEYOND = 10.0
"""Standard deviations of the bias by which the rate at rest differs from the Earth's if the unit is wrong."""
ROCKED = np.radians(0.5)
"""Turn of a vehicle at rest (rad): people getting in tilt a car by as much."""
REST_SAMPLES = 100
"""Fewest samples of a rest that counts."""


def rest_rate_notes(log: RecordedLog) -> list[str]:
    """A note if the mean rate at rest is not that of the Earth, a bias as the data sheet in the description allows it, and of a
    vehicle that rocks.
    """
    initial = log.description.initial
    if initial.static_until_s is None or not log.states_unit:
        return []
    begin = -np.inf if initial.static_from_s is None else initial.static_from_s
    rest = (log.imu_time >= begin) & (log.imu_time <= initial.static_until_s)
    if np.count_nonzero(rest) < REST_SAMPLES:
        return []
    time = float(log.dt[rest].sum())
    sheet = log.sensors(in_place=True)
    rate = float(np.linalg.norm(log.delta_angle[rest].sum(axis=0))) / time
    bias = float(np.sqrt(3.0) * np.hypot(sheet.gyro_bias_sigma, sheet.angle_random_walk / np.sqrt(time)))
    if abs(rate - OMEGA_IE) <= BEYOND * bias + ROCKED / time:
        return []
    hourly = float(np.degrees(3600.0))
    return [
        f"imu: the gyros measure {rate * hourly:.3g} deg/h at rest; the Earth's rate is 15 deg/h and the data sheet allows a "
        f"bias of {bias * hourly:.2g} deg/h: check gyro_unit, gyro_scale, kind, and the grade"
    ]


def turn_notes(samples: InertialSamples, gnss: GnssFixes | None) -> list[str]:
    """A note if the turns that the gyros measure are proportional to those of the course, and not equal to them."""
    if gnss is None or gnss.velocity_n is None or gnss.velocity_sigma is None:
        return []
    moving = np.hypot(gnss.velocity_n[:, 0], gnss.velocity_n[:, 1]) > SPEED
    moving &= gnss.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
    moving &= (gnss.time >= samples.imu_time[0]) & (gnss.time <= samples.imu_time[-1])
    time, velocity = gnss.time[moving], gnss.velocity_n[moving]
    _, first = np.unique(np.floor(time / STEP_S), return_index=True)
    time, velocity = time[first], velocity[first]
    near = np.diff(time) <= LONGEST_S
    if np.count_nonzero(near) < FEWEST:
        return []
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    down = -np.median(samples.delta_velocity / samples.dt[:, None], axis=0)
    turned = np.cumsum(samples.delta_angle @ down) / max(float(np.linalg.norm(down)), 1e-9)
    by_course = np.diff(course)[near]
    by_gyro = np.diff(np.interp(time, samples.imu_time, turned))[near]
    by_course, by_gyro = by_course - by_course.mean(), by_gyro - by_gyro.mean()
    both, alone = float(by_gyro @ by_course), float(by_course @ by_course)
    if both <= ALIKE * np.sqrt(float(by_gyro @ by_gyro) * alone):
        return []
    ratio = both / alone
    if 1.0 / WRONG < ratio < WRONG:
        return []
    return [
        f"imu: the gyros turn {ratio:.3g} times as far as the course of the fixes (57.3 or 0.0175: degrees and radians): check "
        "gyro_unit, gyro_scale, kind"
    ]
