"""Normalised estimation error squared (NEES), e^T P^-1 e, of estimators with a covariance, as a symbolic expression.

The NEES of a consistent filter has a mean equal to the number of states compared.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.model import Values
from insenv.estimators import Estimator


def normalised(error: Any, P: Any) -> Any:
    """e^T P^-1 e of a column (k,) and a symmetric positive definite matrix (k, k), by elimination (P = L D L^T)."""
    total = error[0] * error[0] / P[0, 0]
    while error.shape[0] > 1:
        column = P[1:, 0] / P[0, 0]
        error, P = error[1:] - column * error[0], P[1:, 1:] - P[0, 0] * (column @ column.T)
        total = total + error[0] * error[0] / P[0, 0]
    return total


def nees(estimator: Estimator, x: Values, outputs: Values, truth: Values) -> tuple[Any, int]:
    """NEES of an estimator and its degrees of freedom; (None, 0) if it has no covariance.

    x, outputs: the estimator's state and outputs by row name.  truth: the plant's rows.  The error is
    `Estimator.error`, or, for an estimator without it, that of the attitude.
    """
    if estimator.error is not None:
        error, P = estimator.error(x, outputs, truth)
    elif hasattr(outputs, "attitude_covariance"):
        error, P = attitude.error_rotation_vector(outputs.q_nb, truth.q_nb), outputs.attitude_covariance
    else:
        return None, 0
    return normalised(error, ca.densify(P)), error.shape[0]
