"""Derivatives with respect to a small error, and an error taken out of the state of a filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from insenv.estimators.fusion import history
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.parts import strapdown
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
    return {
        **strapdown.corrected(x, correction[POSITION], correction[VELOCITY], correction[TILT]),
        **{state.name: getattr(x, state.name) + correction[places[state.name]] for state in states},
    }
