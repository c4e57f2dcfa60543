"""Corrections of the AQE filters: scalar measurements one after another, feedback, and the covariance carried along."""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.estimators.parts.aqe_algebra import left
from insenv.estimators.parts.aqe_tables import ACCEL, DQ, GYRO, POSITION, VELOCITY, N


def fused(x: Any, innovation: Any, H: Any, variance: Any, present: Any) -> tuple[dict[str, Any], Any]:
    """Rows after the measurements `innovation` = H error + noise, one after another where `present`, with feedback; the
    innovations over their standard deviations.
    """
    P = symmetric.full(x.covariance, N)
    correction, ratios = ca.SX.zeros(N), []
    for i in range(H.shape[0]):
        PHt = ca.densify(P @ H[i, :].T)
        S = H[i, :] @ PHt + variance[i]
        remaining = innovation[i] - H[i, :] @ correction
        gain = PHt * (present[i] / S)
        correction = correction + gain * remaining
        # Joseph's form: variances fall by ten powers of ten in the first fixes, and P must stay positive
        P = P - gain @ PHt.T
        P = P - (P @ H[i, :].T) @ gain.T + (variance[i] * present[i]) * gain @ gain.T
        P = symmetric.full(symmetric.triangle(P), N)
        ratios.append(present[i] * remaining / ca.sqrt(S))
    q_wb = attitude.normalize(x.q_wb - correction[DQ])
    step = attitude.multiply(q_wb, attitude.conjugate(x.q_wb))
    turn = attitude.to_dcm(step)
    for part, matrix in ((DQ, left(step)), (VELOCITY, turn), (POSITION, turn)):
        P[part, :] = matrix @ P[part, :]
        P[:, part] = P[:, part] @ matrix.T
    rows = {
        **placed(x, x.velocity_w - correction[VELOCITY], -correction[POSITION]),
        **begun(q_wb),
        "q_wb": q_wb,
        "gyro_bias": x.gyro_bias + correction[GYRO],
        "accel_bias": x.accel_bias + correction[ACCEL],
        "covariance": symmetric.triangle(P),
    }
    return rows, ca.vertcat(*ratios)


def begun(q_wb: Any) -> dict[str, Any]:
    """Rows of a new stretch from attitude q_wb."""
    return {
        "stretch": 0,
        "stretch_q_wb": q_wb,
        "stretch_turn": ca.vertcat(1, 0, 0, 0),
        "stretch_velocity": ca.SX.zeros(3),
        "stretch_distance": ca.SX.zeros(3),
        "stretch_C": ca.SX.zeros(3, 3),
    }


def placed(x: Any, velocity_w: Any, move_w: Any) -> dict[str, Any]:
    """Rows of velocity and of a position moved by `move_w` (m, w)."""
    theta = geodesy.transport_rate_w(move_w, x.q_ew, x.height)
    q_ew = attitude.multiply(x.q_ew, attitude.from_rotation_vector(theta))
    return {"velocity_w": velocity_w, "q_ew": attitude.normalize(q_ew), "height": x.height - move_w[2]}
