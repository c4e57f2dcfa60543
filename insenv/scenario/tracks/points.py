"""The points of a track, and the checks of their times and places."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import Remark
from insenv.core.tables import Array

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
