"""Whether the unit of the gyros is right.

The size of gravity shows a wrong unit of the accelerometers. Gyros measure the Earth's rate and their bias at rest, and a
vehicle that follows its course turns about the vertical as its course over ground does, whatever its side slip.
"""

from __future__ import annotations

import numpy as np

from insenv.geodesy import OMEGA_IE
from insenv.logs.inertial import InertialSamples
from insenv.logs.motion import REST_SAMPLES
from insenv.logs.recorded import NO_INFORMATION, GnssFixes, RecordedLog
from insenv.logs.rest import STEADY_S, rest_of, rest_rows

SPEED = 3.0
"""Speed over ground (m/s) from which the course counts."""
STEP_S, LONGEST_S = 1.0, 2.5
"""Turns are compared between fixes that are this far apart, at least and at most (s)."""
FEWEST = 10
"""Pairs of fixes that are needed."""
TURNED = np.radians(45.0)
"""Extent of the course (rad) from which the vehicle has turned: waves of 2 m swing that of a ship of 6 m/s by 20 deg."""
ALIKE = 0.9
"""Correlation of the turns from which the vehicle follows its course: not that of a multirotor."""
WRONG = 2.0
"""Ratio of the turns, or its inverse, that no scale factor and no side slip explains."""

BEYOND = 10.0
"""Standard deviations of the bias by which the rate at rest differs from the Earth's if the unit is wrong."""
SCATTERED = 3.0
"""Standard deviations of the mean rate, likewise, of a vehicle that rocks."""


def rest_rate_notes(log: RecordedLog) -> list[str]:
    """A note if the mean rate at rest is not that of the Earth and a bias as the data sheet in the description allows it."""
    rows = rest_rows(log)
    if not log.states_unit or len(rows) < REST_SAMPLES or log.dt[rows].sum() < STEADY_S:
        return []
    rest = rest_of(log, rows, 0)
    rate, bias = float(np.linalg.norm(rest.rate)), float(np.sqrt(3.0) * log.sensors(in_place=True).gyro_bias_sigma)
    if abs(rate - OMEGA_IE) <= BEYOND * bias + SCATTERED * np.sqrt(3.0) * rest.rate_sigma:
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
    if np.ptp(course) < TURNED:
        return []
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
