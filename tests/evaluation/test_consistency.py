"""NEES of each kind of filter, as a campaign computes it, against its own error state and covariance."""

import casadi as ca
import numpy as np
import pytest
from driven import outputs_of
from navigation import FUNCTIONS, MODEL, random_state, with_error

from insenv import geodesy
from insenv.estimators import get
from insenv.estimators.parts import quaternion_error
from insenv.estimators.parts.quaternion_error import Y
from insenv.evaluation.errors import nees


def nees_of(id, estimate, truth):
    """NEES as computed by the campaign's model, from a state vector and that of a navigation filter which is the truth."""
    outputs = outputs_of(MODEL, truth)
    x = get(id).model.state.symbols(ca.SX(ca.DM(estimate)))
    rows = {name: outputs[name] for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")}
    true = type(x)(**{name: ca.SX(ca.DM(np.atleast_1d(value))) for name, value in rows.items()})
    value, degrees = nees(get(id), x, type(x)(), true)
    return float(ca.evalf(value)), degrees


def test_nees_of_the_15_state_filter_is_that_of_its_own_error_state():
    rng = np.random.default_rng(6)
    for _ in range(5):
        true = random_state(rng)
        L = rng.normal(size=(15, 15)) * 1e-3 * np.repeat([30.0, 0.5, 1e-3, 1e-5, 1e-3], 3)[:, None]
        P, error = L @ L.T, L @ rng.normal(size=15)
        estimate = MODEL.state.pack({"covariance": P.T[np.tril_indices(15)]}, with_error(true, error))
        found, degrees = nees_of("loosely-coupled", estimate, true)
        expected = error[:9] @ np.linalg.solve(P[:9, :9], error[:9])
        assert degrees == 9 and found == pytest.approx(expected, rel=1e-3)  # equal to first order


def test_nees_of_a_quaternion_error_counts_rotation_velocity_and_position():
    """Small correlated errors, added to the truth and described by the covariance."""
    rng = np.random.default_rng(7)
    model, place = get("aqe-ekf").model, quaternion_error
    for _ in range(5):
        base = MODEL.state.unpack(random_state(rng))
        shared = {n: base[n] for n in ("q_wb", "velocity_w", "q_ew", "height")}
        L = rng.normal(size=(9, 9)) * np.repeat([1e-4, 0.2, 2.0], 3)[:, None]
        e = L @ rng.normal(size=9)  # rotation, velocity, position, in w
        into = np.zeros((place.N, 9))
        into[place.DQ, 0:3] = 0.5 * np.array(ca.DM(ca.evalf(Y(ca.SX(ca.DM(base["q_wb"]))))))
        into[place.VELOCITY, 3:6], into[place.POSITION, 6:9] = np.eye(3), np.eye(3)
        P = into @ (L @ L.T) @ into.T
        estimate = model.state.pack({**shared, "covariance": P.T[np.tril_indices(place.N)]})
        # the filter's own function removes errors: psi is minus the rotation, without that of the computed frame
        state = MODEL.state.pack(shared, random_state(rng))
        theta = geodesy.numeric.transport_rate_w(e[6:9], base["q_ew"], base["height"])
        back = np.concatenate([e[6:9], e[3:6], -e[0:3] - theta, np.zeros(6)])
        found, degrees = nees_of("aqe-ekf", estimate, np.array(FUNCTIONS["corrected"](state, back)).ravel())
        assert degrees == 9 and found == pytest.approx(e @ np.linalg.solve(L @ L.T, e), rel=2e-2)
