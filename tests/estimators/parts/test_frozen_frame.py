"""The frame that is fixed in space: its turn during a delay, and how an attitude error shows in the velocity of a block."""

import casadi as ca
import numpy as np
import pytest

from insenv import attitude, geodesy
from insenv.core.numeric import vectorized
from insenv.estimators import get
from insenv.estimators.parts import frozen_frame

q_n0n = vectorized(frozen_frame.q_n0n, (2,), (3,))


@pytest.mark.parametrize("latitude", [0.5, -1.2])
def test_equation_7_is_the_turn_of_the_navigation_frame_during_the_delay(latitude):
    half = geodesy.OMEGA_IE * 89.55 / 2
    ours = q_n0n(np.array([np.cos(half), np.sin(half)]), np.array([np.cos(latitude), 0, -np.sin(latitude)]))
    paper = np.array([np.cos(half), np.cos(latitude) * np.sin(half), np.sin(latitude) * np.sin(half), 0])  # north, up, east
    # n now to n at t_M here; the vector part in north, east, down
    assert np.allclose(ours, [paper[0], paper[1], paper[3], -paper[2]], atol=1e-15)


def test_derivatives_of_the_velocity_of_a_block():
    """Velocity error of a block from a rotation phi in n, (-g phi_E, g phi_N) T, at random attitudes."""
    model = get("inertial-fir").model
    p, x = (ca.SX.sym(n, t.size) for n, t in zip("px", (model.parameters, model.state), strict=True))
    turn, named = ca.SX.sym("turn", 3), model.state.symbols(x)
    named.q_n0i = frozen_frame.corrected(named, turn)
    block = ca.Function("block", [p, x, turn], [frozen_frame.block_velocity_n(named)])
    rng = np.random.default_rng(4)
    for _ in range(20):
        q_n0i, q_ib = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 4)))
        half, latitude, g = rng.uniform(0, 0.1), rng.uniform(-1.4, 1.4), 9.8
        values = {
            "q_n0i": q_n0i, "q_ib": q_ib, "half_turn": [np.cos(half), np.sin(half)], "gravity": g, "block_time": 0.1,
            "axis_n": [np.cos(latitude), 0, -np.sin(latitude)],
        }  # fmt: skip
        q_n0n_now = q_n0n(np.array(values["half_turn"]), np.array(values["axis_n"]))
        q_ni = attitude.numeric.multiply(q_n0n_now * [1, -1, -1, -1], q_n0i)
        values["force_sum"] = attitude.numeric.to_dcm(q_ni).T @ [0, 0, -g * 0.1]
        state, step = model.state.pack(values), 1e-5
        slopes = [
            (block(0, state, step * axis).full() - block(0, state, -step * axis).full()).ravel() / (2 * step)
            for axis in np.eye(3)
        ]
        expected = np.array([[0, -g, 0], [g, 0, 0], [0, 0, 0]]) * 0.1
        assert np.allclose(np.transpose(slopes), expected, atol=1e-5)
