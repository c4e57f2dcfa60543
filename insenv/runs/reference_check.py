"""Whether the gyros of a log contradict its reference: its clock and its body axes.

They measure how the body turns, and so must the reference, at the same time and about the same axes, whatever a filter
estimates.  Its attitude is judged by the specific force (`insenv.evaluation.specific_force`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.remarks import Remark, remark
from insenv.core.tables import Array
from insenv.logs import RecordedLog

STEP_S = 0.2
"""Interval of the rows that are compared, s."""
ROWS = 50
"""Fewest rows, and fewest intervals between fixes, that judge."""
REACH_S, COARSE_S, FINE_S = 10.0, 0.1, 0.01
"""Offsets of the clock that are tried: up to, and in steps of, s."""
TURNING = 0.02
"""Smallest rms of the varying angular rate, rad/s: a body that hardly turns shows neither clock nor axes."""
ALIKE = 0.9
"""Correlation from which both turn alike."""
BETTER = 0.03
"""Gain of the correlation from which an offset or a rotation is named."""
LATE_S, TURNED = 0.15, float(np.radians(15.0))
"""Smallest offset (s) and rotation (rad) that are named: a vehicle's own estimate is late by less."""


@dataclass(frozen=True)
class Turning:
    """How reference and gyros turn: offset of the clock (s, by which the reference is late), correlation there and without it;
    angle (rad) of the rotation from the axes of the unit to those of the reference, its axis, and the correlation without it.
    """

    late_s: float
    correlation: float
    correlation_now: float
    angle: float
    axis: Array
    correlation_unturned: float


def turning(log: RecordedLog) -> Turning | None:
    """The comparison of the angular rates; None if the reference has no attitude, or the body hardly turns."""
    reference = log.reference
    if reference is None or reference.roll is None or reference.pitch is None or reference.heading is None:
        return None
    grid = np.arange(max(reference.time[0], log.imu_time[0]), min(reference.time[-1], log.imu_time[-1]), STEP_S)
    rows = np.unique(np.searchsorted(reference.time, grid))
    if len(rows) < ROWS:
        return None
    time = reference.time[rows]
    q_nb = attitude.numeric.from_euler(*(angle[rows] for angle in (reference.roll, reference.pitch, reference.heading)))
    step = np.diff(time)[:, None]
    turned = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(attitude.numeric.conjugate(q_nb[:-1]), q_nb[1:]))
    shown = turned / step
    shown = shown - shown.mean(axis=0)
    if np.sqrt(np.mean(np.sum(shown**2, axis=1))) < TURNING:
        return None
    angles = np.cumsum(log.delta_angle, axis=0)

    def moments(late_s: float) -> tuple[Array, float]:
        at = np.column_stack([np.interp(time - late_s, log.imu_time, column) for column in angles.T])
        rate = np.diff(at, axis=0) / step
        rate = rate - rate.mean(axis=0)
        return shown.T @ rate, float(np.sqrt(np.sum(shown**2) * np.sum(rate**2)))

    def correlation(late_s: float) -> float:
        product, size = moments(late_s)
        return _best(product)[1] / size if size > 0.0 else 0.0

    coarse = np.arange(-REACH_S, REACH_S + COARSE_S / 2, COARSE_S)
    about = coarse[int(np.argmax([correlation(float(each)) for each in coarse]))]
    fine = about + np.arange(-COARSE_S, COARSE_S + FINE_S / 2, FINE_S)
    values = [correlation(float(each)) for each in fine]
    late_s = float(fine[int(np.argmax(values))])
    product, size = moments(late_s)
    vector = attitude.numeric.to_rotation_vector(attitude.numeric.from_dcm(_best(product)[0]))
    angle = float(np.linalg.norm(vector))
    return Turning(late_s, max(values), correlation(0.0), angle, vector / max(angle, 1e-12), float(np.trace(product)) / size)


def _best(product: Array) -> tuple[Array, float]:
    """The rotation R (3, 3) with the largest trace of R^T `product`, and that trace (Kabsch 1976)."""
    u, sizes, v = np.linalg.svd(product)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(v))])
    return u * signs @ v, float(sizes @ signs)


@remark(
    "reference-clock",
    "the reference turns {late:+.2f} s after the gyros (correlation {correlation:.2f}, {now:.2f} without that): errors against "
    "it are wrong by as much; [reference] time_offset_s = {offset:.2f} corrects it",
)
def reference_clock(log: RecordedLog, seen: Turning | None) -> dict[str, Any] | None:
    """The reference is on another clock."""
    section = log.description.reference
    if seen is None or abs(seen.late_s) < LATE_S or seen.correlation < max(ALIKE, seen.correlation_now + BETTER):
        return None
    offset = (0.0 if section is None else section.time_offset_s) - seen.late_s
    return {"late": seen.late_s, "correlation": seen.correlation, "now": seen.correlation_now, "offset": offset}


@remark(
    "reference-axes",
    "the body of the reference is turned by {angle:.0f} deg about {axis} (forward, right, down) from that of [imu], by the "
    "axes about which both turn (correlation {correlation:.2f}, {unturned:.2f} without that): one of them is described "
    "wrongly",
)
def reference_axes(seen: Turning | None) -> dict[str, Any] | None:
    """The reference has other body axes than the unit."""
    if seen is None or seen.angle < TURNED or seen.correlation < max(ALIKE, seen.correlation_unturned + BETTER):
        return None
    axis = ", ".join(f"{each:.2f}" for each in seen.axis)
    about = {"angle": float(np.degrees(seen.angle)), "axis": axis}
    return {**about, "correlation": seen.correlation, "unturned": seen.correlation_unturned}


def reference_notes(log: RecordedLog) -> tuple[Remark, ...]:
    """What the gyros say against the reference."""
    seen = turning(log)
    return (*reference_clock(log, seen), *reference_axes(seen))
