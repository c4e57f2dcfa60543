"""The errors of velocity and attitude as one error of a group: a correction turns both.

A correction turns the platform by psi.  What a filter has not measured, above all the heading of a vehicle at rest, is an error
about the vertical *as the platform shows it*.  The errors of velocity and attitude (w) therefore turn with the platform, and
their covariance with them:

    e <- T e,   P <- T P T^T,   T = 1 but for the blocks C of velocity and attitude,   C = exp([psi x])

Without that turn an error of heading that was none of velocity becomes one: the next measurement of velocity seems to measure
the heading, and the stated sigma falls without a cause.  With it, velocity and attitude have the left-invariant error
R^T (v^ - v), R^T R^ in other axes, to first order.  The error of position keeps its axes: it is known apart from errors that
do not turn, those of receiver and barometer, and turning it alone would seem to measure it.

Sources: Barrau and Bonnabel (2017), "The invariant extended Kalman filter as a stable observer", IEEE Trans. Automatic Control
62, 1797-1812; biases make the filter an imperfect one, for which convergence is not proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core import symmetric
from insenv.estimators.parts.error_model import TILT, VELOCITY
from insenv.estimators.parts.kalman import Update

TURNING = (VELOCITY, TILT)
"""The parts of the error that turn."""


def turned(matrix: Any, turns: Sequence[tuple[slice, Any]]) -> Any:
    """T M T^T for a matrix (n x n) over the error, T = 1 but for the blocks `turns`: a part of the error and its turn."""
    for part, turn in turns:
        matrix[part, :] = turn @ matrix[part, :]
    for part, turn in turns:
        matrix[:, part] = matrix[:, part] @ turn.T
    return matrix


def with_platform(turn: Any) -> tuple[tuple[slice, Any], ...]:
    """The blocks of T; turn: C (3x3), or its transpose for the way back."""
    return tuple((part, turn) for part in TURNING)


def turn_of(psi: Any) -> Any:
    """C (3x3) of a correction psi (3, rad, w)."""
    return attitude.to_dcm(attitude.from_rotation_vector(psi))


def covariance_after(update: Update, n: int, share: Any = 1.0) -> Any:
    """Covariance triangle of n errors after an update whose correction has been taken out of the state.

    share: 1; 0 leaves the covariance as the conventional Kalman filter of small angles does.
    """
    turn = turn_of(update.correction[TILT] * share)
    return symmetric.triangle(turned(symmetric.full(update.stored, n), with_platform(turn)))


def adjoint_before(adjoint: Any, psi: Any) -> Any:
    """T^T s for the adjoint s (n) of the error after a correction psi."""
    found = ca.SX(adjoint)
    for part in TURNING:
        found[part] = turn_of(psi).T @ adjoint[part]
    return found
