"""Whether the scalar of quaternions comes first, by the motion; aerobatics are no wrong order."""

import numpy as np
import pytest

from insenv import attitude
from insenv.scenario.tracks.fmu_section import contradictions, other_order


def flown(nose, roll):
    """Quaternions (n, 4) scalar first, velocity and acceleration of a flight at 60 m/s; nose: heading and pitch (n,), rad."""
    heading, pitch = nose
    direction = [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)]
    velocity = 60.0 * np.column_stack(direction)
    q_nb = attitude.numeric.from_euler(roll, pitch, heading)
    return q_nb, velocity, np.gradient(velocity, TIME, axis=0)


TIME = np.arange(0.0, 60.0, 0.1)
ZERO = np.zeros_like(TIME)
FIGURES = {
    "loops": ((ZERO, 2.0 * np.pi * TIME / 15.0), ZERO), "rolls": ((ZERO, ZERO), 2.0 * np.pi * TIME / 6.0),
    "inverted for two thirds": ((ZERO, ZERO), np.where(TIME > 20.0, np.pi, 0.0)),
    "a circle upside down": ((2.0 * np.pi * TIME / 60.0, ZERO), ZERO + np.pi), "knife edge": ((ZERO, ZERO), ZERO + 0.5 * np.pi),
    "turns": ((2.0 * np.pi * TIME / 30.0, ZERO), ZERO + np.arctan(60.0 * 2.0 * np.pi / 30.0 / 9.81)),
}  # fmt: skip


@pytest.mark.parametrize("figure", FIGURES)
def test_aerobatics_are_no_wrong_order_and_a_wrong_order_is_none(figure):
    (heading, pitch), roll = FIGURES[figure]
    for course in np.radians(np.arange(0, 360, 15)):
        q_nb, velocity, acceleration = flown((heading + course, pitch), roll)
        assert other_order(contradictions(q_nb, "wxyz", velocity, acceleration), "wxyz") is None, course
        for moved, read, true in (([1, 2, 3, 0], "wxyz", "xyzw"), ([3, 0, 1, 2], "xyzw", "wxyz")):
            found = contradictions(q_nb[:, moved], read, velocity, acceleration)
            if figure in ("loops", "turns"):
                assert other_order(found, read) == true and other_order(found, true) is None, course
