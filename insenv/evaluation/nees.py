"""Normalised estimation error squared, e^T P^-1 e, of the estimators that keep a covariance, over symbols.

For a filter that knows its errors it averages to the number of states compared.  Errors are taken as the filter itself defines
them (`insenv.estimators.parts.error_model`, and the aqe's quaternion error), biases left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.parts import aqe_tables, error_model, strapdown
from insenv.estimators.parts.aqe_algebra import Y

States = Callable[[Values, Values], tuple[Any, Any]]
"""From the estimator's state (or outputs) and the truth's rows to the error (n) and its covariance (n x n)."""


def normalised(error: Any, P: Any) -> Any:
    """e^T P^-1 e of a column and a symmetric positive matrix, by elimination (P = L D L^T) without square roots."""
    total = error[0] * error[0] / P[0, 0]
    while error.shape[0] > 1:
        column = P[1:, 0] / P[0, 0]
        error, P = error[1:] - column * error[0], P[1:, 1:] - P[0, 0] * (column @ column.T)
        total = total + error[0] * error[0] / P[0, 0]
    return total


def _navigation_error_w(x: Values, truth: Values) -> tuple[Any, Any, Any, Any]:
    """Position (m) and velocity error (m/s), turn of the truth into the estimate as seen from e (rad), and turn of the
    computed frame that the position error makes (rad), all in w.
    """
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    offset_n = geodesy.ned_offset(latitude, longitude, x.height, truth.latitude, truth.longitude, truth.height)
    offset = attitude.rotate_inverse(strapdown.wander_quaternion(x.q_ew), offset_n)
    q_en = geodesy.q_ew_from_geodetic(truth.latitude, truth.longitude, 0.0)
    q_wn = attitude.multiply(attitude.conjugate(x.q_ew), q_en)  # from n at the true place to w at the computed one
    velocity = x.velocity_w - attitude.rotate(q_wn, truth.velocity_n)
    turn = attitude.error_rotation_vector(x.q_wb, attitude.multiply(q_wn, truth.q_nb))
    return offset, velocity, turn, geodesy.transport_rate_w(offset, x.q_ew, x.height)


def _psi_angle(x: Values, truth: Values) -> tuple[Any, Any]:
    """Position, velocity and psi of the 15-state filter."""
    offset, velocity, turn, _ = _navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, error_model.N)[:9, :9]
    return ca.vertcat(offset, velocity, -turn), P


def _quaternion_error(x: Values, truth: Values) -> tuple[Any, Any]:
    """Position, velocity and the rotation 2 Y^T dQ of the filters with an additive quaternion error."""
    offset, velocity, turn, theta = _navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, aqe_tables.N)
    tilt = ca.horzcat(2 * Y(x.q_wb).T, ca.SX(3, aqe_tables.N - 4))
    level = ca.horzcat(ca.SX(6, aqe_tables.N - 6), ca.SX.eye(6))  # the last six states: velocity, position
    chosen = ca.vertcat(level, tilt)
    return ca.vertcat(velocity, offset, turn - theta), chosen @ P @ chosen.T


def _attitude_covariance(outputs: Values, truth: Values) -> tuple[Any, Any]:
    """Misalignment about north, east, down of an estimator that gives out its covariance."""
    return attitude.error_rotation_vector(outputs.q_nb, truth.q_nb), outputs.attitude_covariance


_BY_STATE: dict[str, States] = {
    "loosely-coupled": _psi_angle,
    "aqe-ekf": _quaternion_error,
    "aqe-sukf": _quaternion_error,
}


def nees(id: str, x: Values, outputs: Values, truth: Values) -> tuple[Any, int]:
    """NEES of estimator `id` from its state and outputs and the truth's rows, and its degrees of freedom; 0 if it keeps no
    covariance.
    """
    if id in _BY_STATE:
        error, P = _BY_STATE[id](x, truth)
    elif hasattr(outputs, "attitude_covariance"):
        error, P = _attitude_covariance(outputs, truth)
    else:
        return None, 0
    return normalised(error, ca.densify(P)), error.shape[0]
