"""Helpers of the estimator tests: the feedback of an error as a function, and states with a known error."""

import casadi as ca
import numpy as np

from insenv import geodesy
from insenv.estimators.fusion.navigation import corrected, navigation_corrected
from insenv.estimators.loosely_coupled import FILTER

MODEL = FILTER.model


def _functions():
    x, error = ca.SX.sym("x", MODEL.state.size), ca.SX.sym("e", 15)
    state = MODEL.state.symbols(x)

    def without_error(take):
        return MODEL.state.assemble({**vars(state), **take(state, error, FILTER.states, FILTER.places)})

    return {
        "fed_back": ca.Function("fed_back", [x, error], [without_error(corrected)]),
        "corrected": ca.Function("corrected", [x, error], [without_error(navigation_corrected)]),
    }


FUNCTIONS = _functions()


def with_error(x, error):
    """The state of an estimate that is off from the true state x by `error` (15), to first order."""
    return FUNCTIONS["corrected"](x, -np.asarray(error)).full().ravel()


def random_rows(rng):
    """Rows of a state of navigation somewhere, in motion, at any attitude, with a wander angle and biases."""
    q = rng.normal(size=4)
    return {
        "q_wb": q / np.linalg.norm(q), "velocity_w": rng.normal(size=3) * [80, 80, 5],
        "q_ew": geodesy.numeric.q_ew_from_geodetic(0.6, rng.uniform(-3, 3), rng.uniform(-3, 3)), "height": 500.0,
        "gyro_bias": rng.normal(size=3) * 1e-4, "accel_bias": rng.normal(size=3) * 1e-2, "samples": 10.0,
        "previous_delta_angle": rng.normal(size=3) * 1e-3, "previous_delta_velocity": rng.normal(size=3) * 1e-2,
    }  # fmt: skip


def random_state(rng):
    """Such a state (vector) of `loosely-coupled`."""
    return MODEL.state.pack({**random_rows(rng), "covariance": np.diag(np.full(15, 1e-2))[np.triu_indices(15)]})
