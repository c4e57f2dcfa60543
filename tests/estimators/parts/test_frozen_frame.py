"""The frame that is fixed in space: its turn during a delay."""

import numpy as np
import pytest

from insenv import geodesy
from insenv.core.numeric import vectorized
from insenv.estimators.parts import frozen_frame

q_n0n = vectorized(frozen_frame.q_n0n, (2,), (3,))


@pytest.mark.parametrize("latitude", [0.5, -1.2])
def test_equation_7_is_the_turn_of_the_navigation_frame_during_the_delay(latitude):
    half = geodesy.OMEGA_IE * 89.55 / 2
    ours = q_n0n(np.array([np.cos(half), np.sin(half)]), np.array([np.cos(latitude), 0, -np.sin(latitude)]))
    paper = np.array([np.cos(half), np.cos(latitude) * np.sin(half), np.sin(latitude) * np.sin(half), 0])  # north, up, east
    # n now to n at t_M here; the vector part in north, east, down
    assert np.allclose(ours, [paper[0], paper[1], paper[3], -paper[2]], atol=1e-15)
