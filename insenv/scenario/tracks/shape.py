"""The points of a track, the checks of their times and places, and the splines of its position and attitude.

Where a file has no attitude, heading is the course over ground, pitch the angle of climb, and roll the bank of a coordinated
turn, atan(v dcourse/dt / g).  At rest and at walking pace the course of a receiver is noise: a vehicle keeps its heading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import Remark
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY, numeric
from insenv.vehicles.track import Spline, smoothed

MIN_POINTS = 8
"""Points that a track has at least."""


@dataclass(frozen=True)
class Points:
    """label: the file's name in messages; time (n,) s; latitude, longitude (n,) rad; height (n,) m above the ellipsoid;
    attitude (n, 3): roll, pitch, heading, rad, or None; velocity (n, 3): north, east, down, m/s, or None; notes: on what was
    chosen in the file."""

    label: str
    time: Array
    latitude: Array
    longitude: Array
    height: Array
    attitude: Array | None = None
    velocity: Array | None = None
    notes: tuple[Remark, ...] = ()

    def ned(self) -> Array:
        """Offsets (n, 3) north, east, down from the first point, m."""
        here = (self.latitude, self.longitude, self.height)
        return np.asarray(geodesy.numeric.ned_offset(*here, *(float(each[0]) for each in here)))


def checked(points: Points, max_gap_s: float, max_acceleration: float) -> Points:
    """The points with times from 0 on.  Raises `InputError` for what cannot be a track: it names the place in the file."""
    label, time = points.label, points.time
    if len(time) < MIN_POINTS:
        raise InputError(f"{label}: {len(time)} points: allowed is {MIN_POINTS} or more")
    more = [each for each in (points.attitude, points.velocity) if each is not None]
    columns = [points.latitude, points.longitude, points.height, *more]
    bad = np.flatnonzero(~np.isfinite(np.column_stack([time, *columns])).all(axis=1))
    if bad.size:
        raise InputError(f"{label}: point {bad[0] + 1} has a value that is not finite")
    step = np.diff(time)
    at = int(np.argmax(step <= 0))
    if step[at] <= 0:
        raise InputError(
            f"{label}: time goes from {time[at]:.10g} s to {time[at + 1]:.10g} s at point {at + 2}: it must increase"
        )
    at = int(np.argmax(np.abs(points.latitude) > 1.57))
    if abs(points.latitude[at]) > 1.57:
        raise InputError(
            f"{label}: latitude {np.degrees(points.latitude[at]):.6g} deg of point {at + 1}: allowed is from -89.9 to 89.9 "
            "deg; check position_unit"
        )
    time = time - time[0]
    gaps = int(np.count_nonzero(step > max_gap_s))
    if gaps:
        at = int(np.argmax(step))
        several = f" (the longest of {gaps} such gaps)" if gaps > 1 else ""
        raise InputError(
            f"{label}: no points between {time[at]:.6g} s and {time[at + 1]:.6g} s: a gap of {step[at]:.6g} s, allowed "
            f"max_gap_s = {max_gap_s:g} s{several}"
        )
    points = replace(points, time=time, longitude=np.unwrap(points.longitude))
    _check_jumps(points, max_acceleration)
    return points


def _check_jumps(points: Points, largest: float) -> None:
    """Raise `InputError` for an acceleration over neighbouring steps of a second or more that no vehicle has."""
    step = max(1, round(1.0 / float(np.median(np.diff(points.time)))))
    time, place = points.time, points.ned()
    before, after = time[step:-step] - time[: -2 * step], time[2 * step :] - time[step:-step]
    velocity = [
        (place[step:-step] - place[: -2 * step]) / before[:, None],
        (place[2 * step :] - place[step:-step]) / after[:, None],
    ]
    acceleration = np.linalg.norm(velocity[1] - velocity[0], axis=1) / (0.5 * (before + after))
    if acceleration.size and acceleration.max() > largest:
        at = int(np.argmax(acceleration)) + step
        raise InputError(
            f"{points.label}: a jump near {time[at]:.6g} s: {acceleration.max():.4g} m/s2 over a second, allowed "
            f"max_acceleration_mps2 = {largest:g} m/s2"
        )


SLOW = 1.0
"""Speed (m/s) at which the course is trusted half."""
LEVEL = "level"


@dataclass(frozen=True)
class Shape:
    """The splines of a track: points (n, 6) of the channels of `insenv.vehicles.track`, latitude, longitude (rad), height (m)
    less those of the origin; interval s; origin: latitude, longitude rad, height m; duration_s; notes: those of the points."""

    points: Array
    interval: float
    origin: tuple[float, float, float]
    duration_s: float
    notes: tuple[Remark, ...] = ()

    @property
    def spline(self) -> Spline:
        """The spline of all channels."""
        return Spline(self.points, self.interval, 0.0)


def shaped(points: Points, interval: float, noise_m: float | None, bank: str) -> Shape:
    """The splines of checked points.  noise_m: standard deviation of their positions, None: found."""
    origin = float(points.latitude[0]), float(points.longitude[0]), float(points.height[0])
    R_M, R_N = numeric.radii(np.sin(origin[0]))
    scale = np.array([R_M + origin[2], (R_N + origin[2]) * np.cos(origin[0]), 1.0])  # m per unit of each channel
    place = np.column_stack([points.latitude - origin[0], points.longitude - origin[1], points.height - origin[2]])
    rates = None if points.velocity is None else scale * points.velocity / _per_rate(points.latitude, points.height)
    position = smoothed(points.time, place * scale, interval, sigma=noise_m, rates=rates)
    if points.attitude is None:
        attitude = _along_course(position, points.time, interval, bank)
    else:
        angles = np.unwrap(points.attitude, axis=0)
        attitude = smoothed(points.time, angles, interval).points
    together = np.hstack([position.points / scale, attitude])
    return Shape(together, interval, origin, float(points.time[-1] - points.time[0]), points.notes)


def _per_rate(latitude: Array, height: Array) -> Array:
    """Velocity (n, 3) north, east, down, m/s, per rate of latitude, longitude, height (Groves 2013, eq. 2.111)."""
    R_M, R_N = numeric.radii(np.sin(latitude))
    return np.column_stack([R_M + height, (R_N + height) * np.cos(latitude), -np.ones_like(height)])


def motion(points: Points, shape: Shape, derivative: int) -> Array:
    """Velocity (derivative 1) or acceleration (2) of the track at its points (n, 3): north, east, down, m and s."""
    return shape.spline.at(points.time, derivative)[:, :3] * _per_rate(points.latitude, points.height)


def check_velocity(points: Points, shape: Shape, largest: float) -> None:
    """Raise `InputError` where the velocities of the points are not those of the track; largest: difference allowed, m/s."""
    assert points.velocity is not None
    velocity = motion(points, shape, 1)
    apart = np.abs(velocity - points.velocity)
    at, axis = np.unravel_index(int(np.argmax(apart)), apart.shape)
    if apart[at, axis] > largest:
        raise InputError(
            f"{points.label}: velocity {('north', 'east', 'down')[axis]} is {points.velocity[at, axis]:.6g} m/s at "
            f"{points.time[at]:.6g} s, and {velocity[at, axis]:.6g} m/s by the positions: allowed is a difference of "
            f"max_contradiction_mps = {largest:g} m/s; check the order north, east, down, the unit and the Earth model; a "
            "step_s too long for the motion does this too"
        )


def _along_course(position: Spline, time: Array, interval: float, bank: str) -> Array:
    """Control points (n, 3) of roll, pitch, heading from the track itself."""
    fine = np.linspace(time[0], time[-1], 2 * len(position.points))
    velocity = position.at(fine, 1)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    trust = speed**2 / (speed**2 + SLOW**2)
    moving = speed > SLOW
    course = np.zeros(len(fine))
    if moving.any():
        known = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
        course = np.interp(fine, fine[moving], known)  # held through stops
    weight = np.maximum(trust**2, 1e-3)
    heading = smoothed(fine, course[:, None], interval, weight)
    rate = heading.at(fine, 1)[:, 0]
    climb = trust * np.arctan2(velocity[:, 2], np.maximum(speed, SLOW))
    roll = np.zeros(len(fine)) if bank == LEVEL else np.arctan(speed * rate / STANDARD_GRAVITY)
    others = smoothed(fine, np.column_stack([roll, climb]), interval)
    return np.hstack([others.points, heading.points])


def start_of(shape: Shape) -> tuple[float, float, float]:
    """Latitude, longitude (rad) and height (m) of the spline at time 0."""
    offset = shape.spline.at(np.zeros(1))[0, :3]
    latitude, longitude, height = (origin + float(part) for origin, part in zip(shape.origin, offset, strict=True))
    return latitude, float(np.arctan2(np.sin(longitude), np.cos(longitude))), height
