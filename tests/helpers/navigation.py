"""Helpers of the estimator tests: models as NumPy functions, and error states by the filter's own definition."""

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.estimators.fusion.navigation import corrected, navigation_corrected
from insenv.estimators.loosely_coupled import FILTER
from insenv.estimators.parts import strapdown

MODEL = FILTER.model


def _functions():
    x, error = ca.SX.sym("x", MODEL.state.size), ca.SX.sym("e", 15)
    state = MODEL.state.symbols(x)

    def without_error(take):
        return MODEL.state.assemble({**vars(state), **take(state, error, FILTER.states, FILTER.places)})

    return {
        "fed_back": ca.Function("fed_back", [x, error], [without_error(corrected)]),
        "corrected": ca.Function("corrected", [x, error], [without_error(navigation_corrected)]),
        "C_nw": ca.Function("C_nw", [x], [strapdown.C_nw(state.q_ew)]),
    }


FUNCTIONS = _functions()


def with_error(x, error):
    """The state of an estimate that is off from the true state x by `error` (15), to first order."""
    return FUNCTIONS["corrected"](x, -np.asarray(error)).full().ravel()


def error_state(estimate, truth):
    """Error state (15) of a state vector relative to another: what `corrected` would have to take out."""
    e, t = MODEL.state.unpack(estimate), MODEL.state.unpack(truth)
    lle, llt = (geodesy.numeric.geodetic_from_q_ew(s["q_ew"]) for s in (e, t))
    ned = geodesy.numeric.ned_offset(lle[0], lle[1], e["height"], llt[0], llt[1], t["height"])
    dr = FUNCTIONS["C_nw"](estimate).full().T @ ned
    theta = geodesy.numeric.transport_rate_w(dr, e["q_ew"], e["height"])
    conjugate = e["q_wb"] * [1, -1, -1, -1]
    turn = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(t["q_wb"], conjugate))
    back = t["velocity_w"] - np.cross(theta, t["velocity_w"])
    return np.concatenate(
        [dr, e["velocity_w"] - back, turn - theta, t["gyro_bias"] - e["gyro_bias"], t["accel_bias"] - e["accel_bias"]]
    )


def random_rows(rng):
    """Rows of a state of navigation somewhere, in motion, at any attitude, with a wander angle and biases."""
    q = rng.normal(size=4)
    return {
        "q_wb": q / np.linalg.norm(q),
        "velocity_w": rng.normal(size=3) * [80, 80, 5],
        "q_ew": geodesy.numeric.q_ew_from_geodetic(0.6, rng.uniform(-3, 3), rng.uniform(-3, 3)),
        "height": 500.0,
        "gyro_bias": rng.normal(size=3) * 1e-4,
        "accel_bias": rng.normal(size=3) * 1e-2,
        "samples": 10.0,
        "previous_delta_angle": rng.normal(size=3) * 1e-3,
        "previous_delta_velocity": rng.normal(size=3) * 1e-2,
    }


def random_state(rng):
    """Such a state (vector) of `loosely-coupled`."""
    return MODEL.state.pack({**random_rows(rng), "covariance": np.diag(np.full(15, 1e-2))[np.triu_indices(15)]})
