"""Whether the scalar of an outside model's quaternions comes first or last, by the motion.

Four numbers of length 1 are an attitude in either order, but the motion contradicts a wrong one.  The specific force,
acceleration less gravity, points out of the roof of a vehicle that stands on the ground, floats, or is carried by wings or
rotors, in a loop too; and most vehicles move forward.  A slow vehicle with a heading near north shows neither.
"""

from __future__ import annotations

import numpy as np

from insenv import attitude
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY

ORDERS = {"wxyz": "first", "xyzw": "last"}
"""Place of the scalar, by order."""
MOVING = 2.0
"""Speed (m/s) from which a vehicle's direction counts."""
MIN_ANGLE = np.radians(20.0)
"""Smallest contradiction that counts (rad): a ship's list, an aircraft's drift angle."""


def contradictions(q_nb: Array, order: str, velocity: Array, acceleration: Array) -> dict[str, float]:
    """By order, the mean angle (rad) from the roof to the specific force, plus that from the nose to the velocity in motion.

    q_nb (n, 4): scalar first, from numbers read in `order`; velocity (n, 3) m/s, acceleration (n, 3) m/s^2: north, east, down.
    """
    force = acceleration - [0.0, 0.0, STANDARD_GRAVITY]
    moving = np.linalg.norm(velocity, axis=1) > MOVING
    angles = {}
    other, moved = ("xyzw", [3, 0, 1, 2]) if order == "wxyz" else ("wxyz", [1, 2, 3, 0])
    for each, q in ((order, q_nb), (other, q_nb[:, moved])):
        C_nb = attitude.numeric.to_dcm(q)
        angles[each] = _mean_angle(-C_nb[:, :, 2], force) + _mean_angle(C_nb[moving, :, 0], velocity[moving])
    return angles


def _mean_angle(directions: Array, vectors: Array) -> float:
    if not len(vectors):
        return 0.0
    cosine = np.einsum("ni,ni->n", directions, vectors) / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)
    return float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0))))


def other_order(angles: dict[str, float], order: str) -> str | None:
    """The order other than `order` if the motion speaks for it, by the result of `contradictions`."""
    other = next(each for each in ORDERS if each != order)
    return other if angles[order] > 2.0 * angles[other] + MIN_ANGLE else None
