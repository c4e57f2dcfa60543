"""The kind of a vehicle by how it moves: what a filter may assume of it must hold in the log.

In a turn a car is pushed sideways by its speed times its rate of turn, and so is a ship; an aircraft and a multirotor bank
instead.  When they speed up, the thrust of a car, a ship and an aircraft points forward; a multirotor tilts.  A car moves where
it points; a ship sways and rolls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv import attitude
from insenv.core.tables import Array
from insenv.studies.describe.agreement import ACCEL, GYRO, Track
from insenv.studies.describe.finding import Finding
from insenv.studies.describe.matching import Agreed
from insenv.studies.describe.mounting import MIN_HEADING_SIGMA, Mounting, attitudes

LEAST_PUSH = 0.3
"""Scatter (m/s^2) of the accelerations along an axis from which their share is known."""
FAST = 3.0
"""Speed (m/s) from which directions of motion count."""
STRAIGHT = 0.05
"""Rate (rad/s) up to which a vehicle goes straight: in a turn the antenna moves sideways by its lever arm."""
UPRIGHT, BANKED = 0.6, 0.4
"""Share of the acceleration that is felt: from which it is that of a vehicle that does not lean, up to which one that does."""
THRUST = 0.25
"""Share of the forward acceleration that an aircraft feels in wind and at an angle of attack, and a multirotor does not."""
AHEAD = 0.9
"""Length of the mean of the directions of motion from which a vehicle moves ahead."""
SIDEWAYS = 0.06
"""Part of its speed with which a car moves sideways and vertically."""
ROLLING_DEG = 0.2
"""Change of roll and pitch (deg) from one second to the next, 1 sigma, that a vehicle on a road does not exceed and one that
floats does."""
LEVEL_M, LEVEL_S = 5.0, 120.0
"""Extent of the height (m, means of 20 s) of a vehicle that floats, in this time (s) or longer."""
FLYING, FLOATING = 8.0, 25.0
"""Speed (m/s) that a wing needs, and that a ship does not exceed."""


@dataclass(frozen=True)
class Traits:
    """How a vehicle moves: the share of the sideways and the forward acceleration that is felt, NaN if there is too little
    of it; the part of its speed with which it moves sideways and vertically; change of roll and pitch (deg) from second to
    second; its largest speed (m/s); extent of its height (m), and whether the log is long enough for it."""

    across: float
    along: float
    sideways: float
    rolling: float
    speed: float
    heights: float


def traits_of(agreed: Agreed, mount: Mounting, track: Track) -> Traits:
    """How the vehicle of a log moves."""
    C, velocity, weight = attitudes(agreed)
    C_nb = C @ mount.exact.T
    pairs, windows, fit, done = agreed.pairs, agreed.windows, agreed.fit, agreed.done
    rows = np.arange(len(pairs.first))[:, None]
    took = ((pairs.last - pairs.first) * windows.step)[..., None]
    ends = [np.rint(each).astype(int) for each in (pairs.first, pairs.last)]
    force_s = np.einsum(
        "wpji,wpj->wpi",
        done.attitude[rows, np.rint(0.5 * (pairs.first + pairs.last)).astype(int)],
        done.integral[rows, ends[1]] - done.integral[rows, ends[0]],
    )
    turn_s = (
        np.cumsum(np.concatenate([np.zeros_like(windows.turned[:, :1]), windows.turned], axis=1), axis=1)
        @ agreed.choice.order.T
    )
    valid = pairs.valid
    span = np.where(valid[..., None], np.maximum((ends[1] - ends[0]) * windows.step, 1e-3)[..., None], 1.0)
    force = (force_s / span)[valid] @ mount.exact.T + fit.errors[ACCEL] @ mount.exact.T
    rate = ((turn_s[rows, ends[1]] - turn_s[rows, ends[0]]) / span)[valid] @ mount.exact.T + fit.errors[GYRO] @ mount.exact.T
    speed_b = np.einsum("nji,nj->ni", C_nb, velocity)
    speed = np.linalg.norm(velocity, axis=1)
    accel = (pairs.y / np.where(valid[..., None], took, 1.0))[valid]
    along_way = np.einsum("ni,ni->n", accel, velocity) / np.maximum(speed, 1.0)
    fast = speed > FAST
    across = _share(force[fast, 1], (speed * rate[:, 2])[fast], weight[fast])
    along = _share(force[fast, 0], along_way[fast], weight[fast])
    side = float("nan")
    straight = fast & (np.abs(rate[:, 2]) < STRAIGHT) & (weight > 1.0 / (2.0 * MIN_HEADING_SIGMA**2))
    if np.count_nonzero(straight) >= 10:
        side = float(np.sqrt(np.sum(speed_b[straight, 1:] ** 2) / np.sum(speed[straight] ** 2)))
    roll, pitch, _ = attitude.numeric.to_euler(attitude.numeric.from_dcm(C_nb))
    which = np.repeat(np.arange(len(valid)), valid.sum(axis=1))
    scatter = [
        np.hypot(np.std(np.diff(roll[which == w])), np.std(np.diff(pitch[which == w])))
        for w in np.unique(which)
        if np.count_nonzero(which == w) > 5
    ]
    return Traits(
        across,
        along,
        side,
        float(np.degrees(np.median(scatter))) if scatter else float("nan"),
        float(np.quantile(speed, 0.98)),
        _heights(track),
    )


def _heights(track: Track) -> float:
    if track.time[-1] - track.time[0] < LEVEL_S:
        return float("inf")
    parts = np.array_split(track.height, max(int((track.time[-1] - track.time[0]) / 20.0), 1))
    return float(np.ptp([np.median(part) for part in parts]))


def _share(felt: Array, pushed: Array, weight: Array) -> float:
    if len(pushed) < 10:
        return float("nan")
    mean = np.average(pushed, weights=weight)
    off = pushed - mean
    if np.sqrt(np.average(off**2, weights=weight)) < LEAST_PUSH:
        return float("nan")
    return float(np.average(off * felt, weights=weight) / np.average(off**2, weights=weight))


def kind_of(traits: Traits, steadiness: float) -> Finding:
    """The kind of the vehicle, or that it is left open."""
    felt = f"of the sideways acceleration it feels {_part(traits.across)}, of the forward one {_part(traits.along)}"
    leans, stands = traits.across < BANKED, traits.across > UPRIGHT
    heads = f"its directions of motion have a mean of {steadiness:.2f}"
    if leans and traits.along > THRUST and traits.speed > FLYING and steadiness > AHEAD:
        return Finding(
            "vehicle_kind",
            "aircraft",
            f"it banks in turns and moves ahead: {felt} (up to {BANKED:g}, from {THRUST:g}); {heads} (from {AHEAD:g})",
        )
    if leans and traits.along < THRUST and steadiness < AHEAD:
        return Finding(
            "vehicle_kind",
            "multirotor",
            f"it tilts to turn and to speed up: {felt} (up to {BANKED:g} and {THRUST:g}); {heads} (below {AHEAD:g})",
        )
    moves = f"it moves sideways and vertically by {_part(traits.sideways)} of its speed"
    rolls = f"roll and pitch change by {traits.rolling:.2g} deg from second to second"
    if stands and traits.along > UPRIGHT and traits.sideways < SIDEWAYS:
        return Finding(
            "vehicle_kind", "car", f"it moves where it points: {felt} (from {UPRIGHT:g}), {moves} (below {100 * SIDEWAYS:g} %)"
        )
    upright = not leans and not traits.along < UPRIGHT
    floats = traits.rolling > ROLLING_DEG and traits.heights < LEVEL_M and traits.speed < FLOATING
    if upright and floats and steadiness > AHEAD:
        return Finding(
            "vehicle_kind",
            "ship",
            f"it rolls, keeps its height and moves ahead: {rolls} (from {ROLLING_DEG:g}), the height by {traits.heights:.2g} m "
            f"(below {LEVEL_M:g}); {heads} (from {AHEAD:g})",
        )
    return Finding("vehicle_kind", None, f"{felt}; {moves}; {rolls}: no kind of vehicle has all of this", "open")


def _part(share: float) -> str:
    return "an unknown part" if np.isnan(share) else f"{100 * share:.3g} %"
