"""Whether a log contradicts its reference: its clock, its body axes, its attitude.

Two judges that use no filter.  The gyros measure how the body turns, and so must the reference, at the same time and about the
same axes.  The specific force, turned by an attitude and added up from one fix to the next, is the change of the velocity less
gravity: what an attitude leaves of it, in m/s^2, judges the reference and an estimate alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.remarks import Remark, remark
from insenv.evaluation.errors import Track
from insenv.logs import RecordedLog
from insenv.logs.recorded import NO_INFORMATION

Array = NDArray[np.float64]

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
INTERVAL_S = 1.0
"""Shortest interval between two velocities, s."""
TIMES_WORSE, LEAST_LEFT = 2.0, 0.5
"""By which the reference must leave more than the estimate, and the least that it leaves, m/s^2."""


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


@dataclass(frozen=True)
class Left:
    """What an attitude leaves, rms of a component, m/s^2: as it is, and with its heading turned by the best `angle` (rad)."""

    as_is: float
    turned: float
    angle: float


@dataclass(frozen=True)
class ForceJudge:
    """What attitudes leave between the specific force and the change of the velocity of the fixes.

    time (k,) s: fixes at least `INTERVAL_S` apart; change (k - 1, 3) m/s^2: of the velocity, less gravity, n.
    """

    log: RecordedLog
    time: Array
    change: Array

    @classmethod
    def of(cls, log: RecordedLog) -> ForceJudge | None:
        """The judge of a log; None without velocities of fixes."""
        gnss = log.gnss
        if gnss is None or gnss.velocity_n is None or gnss.velocity_sigma is None:
            return None
        known = (
            (gnss.velocity_sigma.max(axis=1) < NO_INFORMATION)
            & (gnss.time >= log.imu_time[0])
            & (gnss.time <= log.imu_time[-1])
        )
        rows, last = [], -np.inf
        for row in np.flatnonzero(known):
            if gnss.time[row] >= last + INTERVAL_S - 1e-6:
                rows.append(row)
                last = gnss.time[row]
        if len(rows) < ROWS:
            return None
        time, velocity = gnss.time[rows], gnss.velocity_n[rows]
        change = np.diff(velocity, axis=0) / np.diff(time)[:, None]
        change[:, 2] -= float(geodesy.numeric.normal_gravity(np.sin(gnss.latitude[rows[0]]), gnss.height[rows[0]]))
        return cls(log, time, change)

    def left(self, time: Array, q_nb: Array) -> Left | None:
        """What an attitude (n, 4) at times (n,) s leaves; None for one that covers fewer than `ROWS` intervals."""
        covered = (self.time[:-1] >= time[0]) & (self.time[1:] <= time[-1])
        if np.count_nonzero(covered) < ROWS:
            return None
        log = self.log
        signs = np.cumprod(np.append(1.0, np.where(np.sum(q_nb[1:] * q_nb[:-1], axis=1) < 0.0, -1.0, 1.0)))
        middle = log.imu_time - 0.5 * log.dt
        q = np.column_stack([np.interp(middle, time, column) for column in (q_nb * signs[:, None]).T])
        q = q / np.linalg.norm(q, axis=1)[:, None]
        velocity = np.cumsum(attitude.numeric.rotate(q, log.delta_velocity), axis=0)
        at = np.column_stack([np.interp(self.time, log.imu_time, column) for column in velocity.T])
        felt, seen = (np.diff(at, axis=0) / np.diff(self.time)[:, None])[covered], self.change[covered]
        across = float(np.sum(felt[:, 0] * seen[:, 1] - felt[:, 1] * seen[:, 0]))
        angle = float(np.arctan2(across, float(np.sum(felt[:, :2] * seen[:, :2]))))
        c, s = np.cos(angle), np.sin(angle)
        turned = felt @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        as_is, best = (float(np.sqrt(np.mean((each - seen) ** 2))) for each in (felt, turned))
        return Left(as_is, best, angle)


@remark(
    "reference-force",
    "the attitude of the reference leaves {left:.2g} m/s2 between the specific force and the change of the velocity of the "
    "fixes, and that of {id} {least:.2g}{turned}: errors of attitude against this reference are its own",
)
def reference_force(log: RecordedLog, reference: Track, estimates: Mapping[str, Track]) -> dict[str, Any] | None:
    """The reference fits the specific force much worse than an estimate.

    reference, estimates by id: at times of the log.
    """
    judge = ForceJudge.of(log)
    known = reference.q_nb is not None and np.isfinite(reference.q_nb).all(axis=1)
    if judge is None or reference.q_nb is None or not np.any(known):
        return None
    of_reference = judge.left(reference.time[known], reference.q_nb[known])
    left = {id: judge.left(each.time, each.q_nb) for id, each in estimates.items() if each.q_nb is not None}
    judged = {id: each.as_is for id, each in left.items() if each is not None}
    if of_reference is None or not judged:
        return None
    id = min(judged, key=judged.__getitem__)
    if of_reference.as_is < max(LEAST_LEFT, TIMES_WORSE * judged[id]):
        return None
    turned = ""
    if abs(of_reference.angle) > TURNED and of_reference.turned < of_reference.as_is / TIMES_WORSE:
        degrees = np.degrees(of_reference.angle)
        turned = f" (with its heading turned by {degrees:+.0f} deg the reference would leave {of_reference.turned:.2g})"
    return {"left": of_reference.as_is, "id": id, "least": judged[id], "turned": turned}


def reference_notes(log: RecordedLog, reference: Track, estimates: Mapping[str, Track]) -> tuple[Remark, ...]:
    """What the log says against its reference.  Arguments: see `reference_force`."""
    seen = turning(log)
    return (*reference_clock(log, seen), *reference_axes(seen), *reference_force(log, reference, estimates))
