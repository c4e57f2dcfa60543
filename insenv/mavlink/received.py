"""Estimates that clients send: ODOMETRY, ATTITUDE, ATTITUDE_QUATERNION, VISION_POSITION_ESTIMATE.

Frames: attitude from body FRD to NED at the vehicle; positions from home (HOME_POSITION) along the NED axes at home; the
velocity of ODOMETRY in body FRD (child frame 12) or NED (child frame 1).  Times are those of the simulation clock, which the
vehicle's messages carry (``time_usec``, ``time_boot_ms``), or the same in Unix time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan, sqrt
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.evaluation.outside import Array, checked_estimate

LOCAL_NED, BODY_FRD = 1, 12
"""MAV_FRAME."""
UNIX_US = 10**15
"""Time stamps beyond this many microseconds are Unix time."""
FARTHEST = 1e5
"""Largest distance from home, m, within which the axes at home make sense."""
_POSE_SIGMA = {0: POSITION[0], 6: POSITION[1], 11: POSITION[2], 15: ATTITUDE[0], 18: ATTITUDE[1], 20: ATTITUDE[2]}
"""Channels on the diagonal of a pose covariance, whose upper triangle stands row by row."""


@dataclass(frozen=True)
class Estimate:
    """One estimate: its time (s, simulation clock), rows as of `checked_estimate`, and stated sigma by channel.

    resolution: of the time stamp, s.
    """

    time: float
    rows: dict[str, Array]
    sigma: dict[str, float] = field(default_factory=dict)
    resolution: float = 1e-6


@dataclass(frozen=True)
class Origin:
    """Home: latitude, longitude (rad), height (m), as HOME_POSITION states it; start_unix: Unix time (s) at the start."""

    latitude: float
    longitude: float
    height: float
    start_unix: float


def estimate_of(message: Any, origin: Origin) -> Estimate:
    """The estimate in a message.  Raises `InputError`, one sentence, for nonsense: not finite, no rotation, another frame."""
    return READERS[message.get_type()](message, origin)


def _attitude(message: Any, origin: Origin) -> Estimate:
    q = _by_euler(message.roll, message.pitch, message.yaw)
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(q), resolution=1e-3)


def _attitude_quaternion(message: Any, origin: Origin) -> Estimate:
    offset = tuple(getattr(message, "repr_offset_q", (0.0,) * 4))
    if any(offset) and offset != (1.0, 0.0, 0.0, 0.0):
        raise InputError(f"repr_offset_q = {list(offset)}: allowed is none: the attitude is that of the body")
    q = [message.q1, message.q2, message.q3, message.q4]
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(q), resolution=1e-3)


def _vision_position_estimate(message: Any, origin: Origin) -> Estimate:
    rows = checked_estimate(
        {
            "q_nb": _by_euler(message.roll, message.pitch, message.yaw),
            **_place((message.x, message.y, message.z), origin),
        }
    )
    return Estimate(_seconds(message.usec, origin), rows, _pose_sigma(message.covariance))


def _odometry(message: Any, origin: Origin) -> Estimate:
    if message.frame_id != LOCAL_NED:
        raise InputError(f"frame_id = {message.frame_id}: allowed is {LOCAL_NED} (MAV_FRAME_LOCAL_NED)")
    if message.child_frame_id not in (LOCAL_NED, BODY_FRD):
        raise InputError(
            f"child_frame_id = {message.child_frame_id}: allowed is {BODY_FRD} (MAV_FRAME_BODY_FRD) or {LOCAL_NED}"
            " (MAV_FRAME_LOCAL_NED)"
        )
    rows = checked_estimate(
        {
            "q_nb": message.q,
            "velocity_n": (message.vx, message.vy, message.vz),
            **_place((message.x, message.y, message.z), origin),
        }
    )
    sigma = _pose_sigma(message.pose_covariance)
    if message.child_frame_id == BODY_FRD:
        rows["velocity_n"] = np.asarray(attitude.numeric.rotate(rows["q_nb"], rows["velocity_n"]))
    covariance = np.array(message.velocity_covariance)[[0, 1, 2, 6, 7, 11]]
    if np.isfinite(covariance).all() and min(covariance[[0, 3, 5]]) > 0.0:
        P = np.zeros((3, 3))
        P[np.triu_indices(3)] = covariance
        P = P + np.triu(P, 1).T
        if message.child_frame_id == BODY_FRD:
            C_nb = attitude.numeric.to_dcm(rows["q_nb"])
            P = C_nb @ P @ C_nb.T
        sigma |= dict(zip(VELOCITY, np.sqrt(np.maximum(np.diag(P), 0.0)).tolist(), strict=True))
    return Estimate(_seconds(message.time_usec, origin), rows, sigma)


READERS: dict[str, Callable[[Any, Origin], Estimate]] = {
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "VISION_POSITION_ESTIMATE": _vision_position_estimate,
    "ODOMETRY": _odometry,
}
"""By name of the message."""


def _seconds(stamp_us: int, origin: Origin) -> float:
    return (stamp_us - round(origin.start_unix * 1e6) if stamp_us > UNIX_US else stamp_us) * 1e-6


def _by_euler(roll: float, pitch: float, heading: float) -> Array:
    angles = {"roll": roll, "pitch": pitch, "yaw": heading}
    for name, angle in angles.items():
        if not isfinite(angle) or abs(angle) > 7.0:
            raise InputError(f"{name} = {angle:g} rad: allowed is a finite angle up to a full turn")
    return np.asarray(attitude.numeric.from_euler(roll, pitch, heading))


def _place(offset: Sequence[float], origin: Origin) -> dict[str, float]:
    """Latitude, longitude, height of a position from home along the NED axes at home."""
    if not all(map(isfinite, offset)) or max(map(abs, offset)) > FARTHEST:
        raise InputError(
            f"x, y, z = {[round(v, 3) for v in offset]} m: allowed are finite distances from home up to {FARTHEST:g} m"
        )
    at = (origin.latitude, origin.longitude, origin.height)
    found = geodesy.numeric.geodetic_from_ned_offset(np.array(offset), *at)
    return {name: float(value) for name, value in zip(("latitude", "longitude", "height"), found, strict=True)}


def _pose_sigma(triangle: Sequence[float]) -> dict[str, float]:
    """Standard deviations by channel (m, deg) of a pose covariance; none where it is unknown: NaN, or not positive."""
    found = {}
    for place, channel in _POSE_SIGMA.items():
        variance = triangle[place] if place < len(triangle) else nan
        if isfinite(variance) and variance > 0.0:
            found[channel] = sqrt(variance) * (180.0 / np.pi if channel in ATTITUDE else 1.0)
    return found
