"""How the unit is mounted: in the attitudes that fit the fixes gravity points down and the vehicle moves forward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv import attitude
from insenv.core.tables import Array
from insenv.studies.describe.finding import UnclearError
from insenv.studies.describe.inertial import Choice
from insenv.studies.describe.matching import Agreed
from insenv.studies.describe.tables import LogTable

MIN_SPEED = 2.0
"""Speed over the ground (m/s) from which a direction counts."""
STEADY, LIKELY = 0.85, 0.5
"""Length of the mean of unit vectors from which they have one direction, and from which it is the likelier one."""
TURNING = 0.1
"""Rate (rad/s) above which a vehicle may bank, so that its attitude says less of what is down."""
STRAIGHT, LEAST_STRAIGHT = 0.03, 5.0
"""Rate (rad/s) above which a vehicle does not go straight, and the number of pairs in which it has to."""
OBLIQUE = np.radians(30.0)
"""Angle from the nearest axis from which a unit is not mounted along the axes."""


@dataclass(frozen=True, eq=False)
class Mounting:
    """C_bs (3, 3) of the accelerometers' columns (with their sign), whether the forward axis is seen, the angles (deg) of
    the mean directions of down and forward from their axes, and the length of the mean forward direction; exact (3, 3): with
    the mean directions themselves, which are
    those of a car, with the standard deviation of its heading (rad)."""

    C_bs: Array
    exact: Array
    heading_sigma: float
    forward_seen: bool
    down_off: float
    forward_off: float
    steadiness: float


def mounting(agreed: Agreed, table: LogTable) -> Mounting:
    """The axes of the unit.  Raises `UnclearError` for one that is mounted obliquely."""
    C, velocity, weight = attitudes(agreed)
    # in a turn an aircraft banks
    down = np.average(C[..., 2, :], axis=0, weights=1.0 / (1.0 + (_turning(agreed) / TURNING) ** 2))
    down /= np.linalg.norm(down)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    moving = speed > MIN_SPEED
    axis = _nearest(down)
    down_off = float(np.degrees(np.arccos(np.clip(down @ axis, -1, 1))))
    steadiness, forward, forward_off, seen = 0.0, np.zeros(3), 0.0, False
    if np.count_nonzero(moving) >= 10:
        ahead = np.einsum("nji,nj->ni", C[moving], velocity[moving] * [1, 1, 0]) / speed[moving, None]
        mean = np.average(ahead, axis=0, weights=weight[moving])
        mean = mean - (mean @ down) * down
        steadiness = float(np.linalg.norm(mean))
        forward = _nearest(mean * (np.abs(axis) < 0.5))
        forward_off = float(np.degrees(np.arccos(np.clip(mean @ forward / max(steadiness, 1e-9), -1, 1))))
        seen = steadiness > STEADY
    if np.radians(down_off) > OBLIQUE or (seen and np.radians(forward_off) > OBLIQUE):
        raise UnclearError(
            f"{table.file}: the unit is mounted obliquely: down is {down_off:.3g} deg and forward {forward_off:.3g} deg "
            f"from its nearest axis; "
            f"allowed are {np.degrees(OBLIQUE):g} deg; axes as a matrix and mounting_angles_deg describe it (docs/logs.md)"
        )
    if steadiness < LIKELY:
        forward = next(each for each in np.eye(3) if abs(each @ axis) < 0.5)
    C_bs = np.stack([forward, np.cross(axis, forward), axis])
    # in a turn the antenna moves sideways by its lever arm, and a window in which little happens has no heading
    known = moving & (weight > 1.0 / (2.0 * MIN_HEADING_SIGMA**2))
    straight = np.where(known, 1.0 / (1.0 + (_turning(agreed) / STRAIGHT) ** 2), 0.0)
    if not seen or straight.sum() < LEAST_STRAIGHT:
        return Mounting(C_bs, C_bs, np.pi, seen, down_off, forward_off, steadiness)
    return Mounting(C_bs, *_along_motion(agreed, C_bs, down, straight), seen, down_off, forward_off, steadiness)


def _along_motion(agreed: Agreed, C_bs: Array, down: Array, straight: Array) -> tuple[Array, float]:
    """C_bs (3, 3) of a vehicle that moves where it points, and the standard deviation (rad) of its heading.

    down (3,): on the mean, right but for the pitch; straight (n,): weights.  Medians count, because the heading of a window in
    which little happens is wrong by anything.
    """
    C, velocity, _ = attitudes(agreed)
    ahead = np.einsum("ij,nkj,nk->ni", C_bs, C, velocity) / np.linalg.norm(velocity, axis=1)[:, None]
    heading, pitch = np.arctan2(ahead[:, 1], ahead[:, 0]), -np.arcsin(np.clip(ahead[:, 2], -1, 1))
    middle = [_median(angle, straight) for angle in (heading, pitch)]
    x = np.array([np.cos(middle[1]) * np.cos(middle[0]), np.cos(middle[1]) * np.sin(middle[0]), -np.sin(middle[1])]) @ C_bs
    y = np.cross(down, x)
    y /= np.linalg.norm(y)
    which = np.repeat(np.arange(len(agreed.pairs.valid)), agreed.pairs.valid.sum(axis=1))
    parts = [which == w for w in np.unique(which) if straight[which == w].sum() > 0]
    each = np.array([_median(heading[rows], straight[rows]) for rows in parts])
    weights = np.array([straight[rows].sum() for rows in parts])
    weights = weights / weights.sum()
    spread = _median(np.abs(each - middle[0]), weights) / 0.6745
    return np.stack([x, y, np.cross(x, y)]), float(spread * np.sqrt(np.sum(weights**2)))


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())])


def mounting_angles(mount: Mounting) -> Array:
    """Roll, pitch and heading (3,) deg of the unit, by which the nominal axes are turned."""
    return np.degrees(attitude.numeric.to_euler(attitude.numeric.from_dcm(mount.exact @ mount.C_bs.T)))


MIN_HEADING_SIGMA = 0.05
"""Smallest standard deviation (rad) of the heading of a window, as a weight."""


def attitudes(agreed: Agreed) -> tuple[Array, Array, Array]:
    """C_ns (n, 3, 3) of the accelerometers' columns in the middle of each pair, the velocity (n, 3) m/s there, and a weight
    (n,) by what the window shows of its heading: how much the horizontal velocity changes in it."""
    place = np.rint(0.5 * (agreed.pairs.first + agreed.pairs.last)).astype(int)
    rows = np.arange(len(place))[:, None]
    C = np.einsum("wij,wpjk->wpik", agreed.fit.start, agreed.done.attitude[rows, place])
    valid, y = agreed.pairs.valid, agreed.pairs.y
    pushed = np.sum(y[..., :2] ** 2, axis=(-1, -2)) / np.maximum(
        3 * valid.sum(axis=1) / (agreed.fit.count / len(valid) + 3), 1.0
    )
    weight = 1.0 / (float(agreed.fit.mean) / np.maximum(pushed, 1e-9) + MIN_HEADING_SIGMA**2)
    return C[valid], agreed.pairs.speed[valid], np.repeat(weight, valid.sum(axis=1))


def _turning(agreed: Agreed) -> Array:
    """Size (n,) rad/s of the mean rate over each pair."""
    turned_by = np.concatenate([np.zeros_like(agreed.windows.turned[:, :1]), np.cumsum(agreed.windows.turned, axis=1)], axis=1)
    rows, ends = (
        np.arange(len(turned_by))[:, None],
        [np.rint(each).astype(int) for each in (agreed.pairs.first, agreed.pairs.last)],
    )
    took = np.maximum((ends[1] - ends[0]) * agreed.windows.step, 1e-3)
    return np.asarray(np.linalg.norm(turned_by[rows, ends[1]] - turned_by[rows, ends[0]], axis=-1) / took)[agreed.pairs.valid]


def _nearest(direction: Array) -> Array:
    """The axis (3,), with its sign, next to a direction."""
    axis, at = np.zeros(3), int(np.argmax(np.abs(direction)))
    axis[at] = np.sign(direction[at]) or 1.0
    return axis


def axes_text(C_bs: Array) -> str:
    """The key `axes` of a matrix: three letters, or, of a reflection, body axes in terms of the sensor's."""
    if np.linalg.det(C_bs) > 0:
        return "".join(
            ("FRD" if C_bs[int(np.argmax(np.abs(column))), place] > 0 else "BLU")[int(np.argmax(np.abs(column)))]
            for place, column in enumerate(C_bs.T)
        )
    return "".join(f"{'+' if row[at] > 0 else '-'}{'xyz'[at]}" for row in C_bs for at in [int(np.argmax(np.abs(row)))])


def lying(table: LogTable, choice: Choice) -> tuple[Array, float]:
    """C_bs (3, 3) by gravity alone, forward along the first level axis, and the angle (deg) of gravity from its axis."""
    force = np.nanmedian(table.values[:, choice.triads.accel], axis=0)
    down = -force / np.linalg.norm(force)
    axis = _nearest(down)
    off = float(np.degrees(np.arccos(np.clip(down @ axis, -1, 1))))
    if np.radians(off) > OBLIQUE:
        raise UnclearError(
            f"{table.file}: gravity is {off:.3g} deg from the nearest axis of the unit (allowed {np.degrees(OBLIQUE):g} deg)"
        )
    forward = next(each for each in np.eye(3) if abs(each @ axis) < 0.5)
    return np.stack([forward, np.cross(axis, forward), axis]), off
