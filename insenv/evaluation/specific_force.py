"""A judge of an attitude that needs no reference: specific force that it turns, against changes of the receiver's velocity.

Over an interval T of about a second the velocity of the antenna changes by

    C_nb (integral of C_bb' f dt + change of omega x l) + (g - (2 omega_ie + omega_en) x v) T,

with C_nb the attitude in the middle of the interval, b the body axes there, and b' those of each sample: the gyros carry them
over half a second.  What is left of the receiver's change, over T, contains the noise of the receiver and the bias of the
accelerometers, whatever the attitude, and gravity or acceleration turned by its error.  So the attitude that leaves less is the
better one, and that of a reference needs no trust.  The heading shows only while the velocity changes.

Equation: Groves, "Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems" (2013), eq. (5.53).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.remarks import remark
from insenv.core.tables import Array
from insenv.evaluation.outages import attitude_between

FEWEST = 20
"""Intervals in each half of a run below which a reference is not judged."""
UNEXPLAINED = 0.5
"""m/s^2, rms, that a reference leaves beyond what the estimate leaves: gravity turned by 3 deg."""
LARGER = 1.25
"""By this factor: a noise that is larger hides such a difference."""
SETTLED = float(np.radians(10.0))
"""Stated standard deviation of each angle (rad) from which an estimate is one."""


@dataclass(frozen=True)
class VelocityChanges:
    """Changes of the receiver's velocity, and the increments of the accelerometers beside them.

    time (k,): middle of each interval, s; duration (k,) s.  increment_b (k, 3): the velocity change of the antenna by specific
    force and rotation, body axes of the middle, m/s.  demanded_n (k, 3): the change that it has to be, n, m/s.  known (k, 3):
    whether the receiver measures this component.
    """

    time: Array
    duration: Array
    increment_b: Array
    demanded_n: Array
    known: NDArray[np.bool_]

    def left(self, q_nb: Array) -> Array:
        """What an attitude (k, 4) in the middle of the intervals leaves of the components (k, 3), m/s^2; 0: not known."""
        turned = attitude.numeric.rotate(q_nb, self.increment_b)
        return np.where(self.known, (self.demanded_n - turned) / self.duration[:, None], 0.0)


@dataclass(frozen=True)
class SpecificForce:
    """How an attitude fits the velocities of the receiver: what it leaves, rms of the vector, m/s^2, over so many intervals.

    reference: the same of the log's reference, over the same intervals; None if it has no attitude.  contradicted: whether the
    reference leaves far more.
    """

    estimate: float
    intervals: int
    reference: float | None = None
    contradicted: bool = False

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {"estimate": self.estimate, "reference": self.reference, "intervals": self.intervals}

    @remark(
        "reference-contradicted",
        "the log contradicts its reference: with the attitude of the reference, the measured specific force differs from the "
        "receiver's changes of velocity by {reference:.2g} m/s2, with that of this estimate by {estimate:.2g}: differences "
        "from such a reference are not errors of the estimate; check the reference's time, axes and heading",
    )
    def reference_contradicted(self) -> dict[str, Any] | None:
        """The reference leaves far more than the estimate."""
        return {"reference": self.reference, "estimate": self.estimate} if self.contradicted else None


def specific_force(
    changes: VelocityChanges,
    time: Array,
    q_nb: Array,
    sigma: Array | None,
    q_reference: Array | None,
    from_s: float,
    to_s: float,
) -> SpecificForce | None:
    """Judge an attitude (n, 4), and that of a reference, at the times (n,) s of records, from `from_s` to `to_s`.

    sigma (n, 3): what the estimate states, rad: intervals in which it is not yet one do not count; None: it states none.
    q_reference (n, 4): NaN where the reference does not reach.  None if no interval counts.
    """
    later = np.searchsorted(time, changes.time)
    counts = (later > 0) & (later < len(time)) & (changes.time >= from_s) & (changes.time <= to_s)
    rows, later = np.flatnonzero(counts), later[counts]
    if sigma is not None:
        settled = (sigma[later] < SETTLED).all(axis=1)
        rows, later = rows[settled], later[settled]
    if q_reference is not None:
        covered = np.isfinite(q_reference[[later - 1, later]]).all(axis=(0, 2))
        rows, later = rows[covered], later[covered]
    if not len(rows):
        return None
    share = ((changes.time[rows] - time[later - 1]) / (time[later] - time[later - 1]))[:, None]
    part = VelocityChanges(**{name: values[rows] for name, values in vars(changes).items()})
    squares = [
        (part.left(attitude_between(q[later - 1], q[later], share)) ** 2).sum(axis=1)
        for q in (q_nb, q_reference)
        if q is not None
    ]
    left = [float(np.sqrt(np.mean(each))) for each in squares]
    middle = len(rows) // 2
    if q_reference is None or middle < FEWEST:
        return SpecificForce(left[0], len(rows), left[1] if len(left) > 1 else None)
    halves = [[float(np.mean(each[half])) for each in squares] for half in (slice(middle), slice(middle, None))]
    contradicted = all(_far_more(reference, estimate) for estimate, reference in halves)
    return SpecificForce(left[0], len(rows), left[1], contradicted)


def _far_more(reference: float, estimate: float) -> bool:
    """Of mean squares: in each half of a run, so that one event, as an impact that one of them misses, does not decide."""
    return reference - estimate > UNEXPLAINED**2 and reference > LARGER**2 * estimate
