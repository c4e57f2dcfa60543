"""Degrees from which a reader gets an angle back."""

from __future__ import annotations

import math


def degrees_of(angle: float) -> float:
    """The degrees (float) whose conversion to radians is `angle` (rad), to the bit where such degrees exist.

    Degrees are coarser than radians for about half of the angles: one in ten of these has no such degrees, and the result is
    then the nearest, one unit in the last place away.
    """
    found = math.degrees(angle)
    candidates = [found]
    for towards in (-math.inf, math.inf):
        near = found
        for _ in range(3):
            near = math.nextafter(near, towards)
            candidates.append(near)
    return min(candidates, key=lambda degrees: (abs(math.radians(degrees) - angle), abs(degrees - found)))
