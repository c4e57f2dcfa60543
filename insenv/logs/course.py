"""Velocity from speed over ground and course, which is what receivers report that give no vector."""

from __future__ import annotations

import numpy as np

from insenv.logs.units import Array

NO_INFORMATION = 100.0
"""Standard deviation (m/s) of a velocity component that a log does not hold."""
SLOW = 0.5
"""Speed over ground (m/s) below which receivers may leave the course out."""


def course_velocity(speed: Array, course: Array, down: Array) -> Array:
    """Velocity (n, 3) m/s, NED, from speed over ground (m/s), course (rad) and downward velocity (m/s)."""
    return np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)


def fixes_from_course(speed: Array, course: Array, sigma: Array) -> tuple[Array, Array]:
    """Velocity (n, 3) m/s, NED, and its standard deviation (n, 3) m/s, from columns of a log.

    speed (n,) m/s; course (n,) rad, NaN where it is missing; sigma (n,) m/s, of each horizontal component. The vertical
    component is unknown. Without a course a speed below `SLOW` is an error of a vehicle at rest, a higher one says nothing.
    """
    known = np.isfinite(course)
    velocity = course_velocity(np.where(known, speed, 0.0), np.where(known, course, 0.0), np.zeros(len(speed)))
    horizontal = np.where(known, sigma, np.where(speed <= SLOW, np.hypot(sigma, speed), NO_INFORMATION))
    return velocity, np.stack([horizontal, horizontal, np.full(len(speed), NO_INFORMATION)], axis=1)
