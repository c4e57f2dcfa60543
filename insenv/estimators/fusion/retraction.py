"""Derivatives with respect to a small error, and an error taken out of the state of a filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.estimators.fusion import history
from insenv.estimators.fusion.contract import ErrorState
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY


def linear(function: Callable[[Any], Any], n: int) -> tuple[Any, Any]:
    """Value (m) and derivative (m x n, sparse) of a function of n numbers at 0."""
    error = ca.SX.sym("error", n)
    value = function(error)
    at_zero = ca.substitute([value, ca.jacobian(value, error)], [error], [ca.SX.zeros(n)])
    return at_zero[0], ca.sparsify(at_zero[1])


def corrected(x: Any, correction: Any, states: Sequence[ErrorState], places: Mapping[str, slice]) -> dict[str, Any]:
    """State rows with an estimated error (n) taken out, those of the kept motion too."""
    return {
        **navigation_corrected(x, correction, states, places),
        **history.corrected(x, correction[VELOCITY], correction[TILT]),
    }


def navigation_corrected(x: Any, correction: Any, states: Sequence[ErrorState], places: Mapping[str, slice]) -> dict[str, Any]:
    """Rows of navigation and estimated errors with an estimated error (n) taken out."""
    dr, dv, psi = correction[POSITION], correction[VELOCITY], correction[TILT]
    # moving the position turns the computed frame by -theta; platform and velocity are then referred to the new one
    theta = geodesy.transport_rate_w(dr, x.q_ew, x.height)
    velocity = x.velocity_w - dv
    return {
        "q_wb": attitude.normalize(attitude.multiply(attitude.from_rotation_vector(psi + theta), x.q_wb)),
        "velocity_w": velocity + ca.cross(theta, velocity),
        "q_ew": attitude.normalize(attitude.multiply(x.q_ew, attitude.from_rotation_vector(-theta))),
        "height": x.height + dr[2],
        **{state.name: getattr(x, state.name) + correction[places[state.name]] for state in states},
    }
