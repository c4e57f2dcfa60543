"""`lssvm`'s differences of SINS and GNSS: late fixes away from the known place, and the noise of the chain."""

import casadi as ca
import earth_fixed
import numpy as np
import pytest
from constants import constants, number
from driven import fed
from earth_fixed import matrix_of, with_fixes
from scipy.integrate import solve_ivp

from insenv.estimators import lssvm
from insenv.estimators.parts import sins_gnss_differences as differences

ARM = np.array([2.0, -1.0, -3.0])
MODEL = lssvm.MODEL
EMPTY = {row.name: np.zeros(row.shape) for row in lssvm.MACHINE}
AWAY = earth_fixed.Motion(speed=0.0, height=20.0, swings=((20.0, 0.5, -np.pi / 2, (0.5, 0.8, 0.1)),))
"""From rest at its start 40 m away and back, as A (1 - cos w t)."""


def followed(motion, seconds, ages, **parameters):
    """The state of `lssvm` without a machine, from the true attitude."""
    columns, _ = with_fixes(motion, ARM, seconds, 0.01, ages)
    start = motion.start()
    latitude, longitude, height = earth_fixed.geodetic(motion.position(0.0))
    known = {name: start[name] for name in ("start_roll", "start_pitch", "start_heading")}
    known |= {"latitude": latitude, "longitude": longitude, "height": height, "antenna_lever_arm": ARM, **EMPTY, **parameters}
    return fed(MODEL, columns, known, "interpreter").state


@pytest.mark.parametrize("ages", [{450: 0.0}, {450: 0.3}, {250: 0.3, 450: 0.3}])
def test_sins_and_gnss_tell_the_same_motion(ages):
    """At 8 m/s, 30 m from the known place: 0.3 s are 2 m, and the Earth turns that place by 2.5 mm/s.

    What is left: gravity at the place of the vehicle, which differs by 0.3 mm/s.
    """
    state = followed(AWAY, 4.5, ages)
    C = matrix_of(state["q_n0i"])
    apart = C @ state["chain_sins"][:2].T - state["chain_gnss"][:2].T
    late = max(ages.values()) > 0.0  # acceleration is taken as constant over the age
    assert np.abs(apart[:, 0]).max() < (0.03 if late else 2e-3)
    assert np.abs(apart[:, 1]).max() < (0.1 if late else 8e-4)


def test_late_fixes_of_a_vehicle_at_rest():
    """100 s with fixes 0.3 s late: no difference of acceleration, its epochs' own rotation of the Earth is used."""
    still = earth_fixed.Motion(speed=0.0, swings=(), turns=((0.1, 1e-9, 0.5, (1, 0, 0)), (0.2, 1e-9, 0.5, (0, 0, 1))))
    state = followed(still, 100.0, {100 * k: 0.3 for k in range(1, 101)})
    assert np.abs(state["features"][:3]).max() < 2e-6 and np.abs(state["features"][3:5]).max() < 2e-4


def test_noise_of_the_chain_is_the_integral_of_its_transition():
    """Q = integral of Phi(s) G Phi(s)^T: white noise of the accelerometers in velocity, of the gyros in acceleration."""
    T, g, V, N = 3.0, 9.8, 2e-3, 5e-4
    F = np.diag(np.ones(3), 1)
    G = np.diag([0.0, V**2, (g * N) ** 2, 0.0])
    grown = solve_ivp(lambda t, Q: (F @ Q.reshape(4, 4) + Q.reshape(4, 4) @ F.T + G).ravel(), (0, T), np.zeros(16), rtol=1e-10,
        atol=1e-16)  # fmt: skip
    p, x = constants(MODEL.parameters, velocity_random_walk=V, angle_random_walk=N), constants(MODEL.state, gravity=g)
    found = number(differences._noise(p, x, ca.SX(T)))
    assert np.allclose(found, grown.y[:, -1].reshape(4, 4), rtol=1e-6, atol=1e-14)
