"""Whether a vehicle seems to move sideways: a unit turned about the vertical shows in no innovation.

GNSS measures the motion of a place.  A filter finds the attitude of the unit from it, however the unit is mounted, so axes that
are named wrongly become a wrong heading with a small stated sigma.  Only a vehicle that moves forward contradicts it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.core.tables import Vector

SPEED = 3.0
"""Speed over the ground (m/s) from which the course counts."""
LONG_S = 10.0
"""Shortest time (s) at such speeds."""
KNOWN = np.radians(10.0)
"""Largest standard deviation (rad) of a heading that counts."""
STEADY = 0.9
"""Length of the mean of the unit vectors of the angle: nearer 0 for a vehicle that moves in any direction."""
SIDEWAYS = np.radians(30.0)
"""Smallest angle (rad) that is not the drift angle of a ship in a current or of an aircraft in the wind."""


def sideways_notes(time: Vector, outputs: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """A sentence if heading less course is steadily far from 0.

    time (n,) s; outputs by row name: `q_nb` (n, 4), `velocity_n` (n, 3) m/s, none of an alignment, and `attitude_sigma` (n, 3)
    rad, where there is one.
    """
    velocity = outputs.get("velocity_n")
    if velocity is None or len(time) < 2:
        return ()
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > SPEED
    if (sigma := outputs.get("attitude_sigma")) is not None:
        moving &= sigma[:, 2] < KNOWN
    if moving.sum() * float(np.median(np.diff(time))) < LONG_S:
        return ()
    heading = attitude.numeric.to_euler(outputs["q_nb"][moving])[2]
    mean = np.mean(np.exp(1j * (heading - np.arctan2(velocity[moving, 1], velocity[moving, 0]))))
    angle = float(np.angle(mean))
    if abs(mean) < STEADY or abs(angle) < SIDEWAYS:
        return ()
    return (
        f"the heading is {np.degrees(angle):+.0f} deg from the direction of travel: if this vehicle moves forward, the unit is"
        " turned about the vertical by that; look at `axes` and `mounting_angles_deg`, which fixes of GNSS do not show",
    )
