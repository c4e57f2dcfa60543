"""The attitude by an answer, and the covariance of its errors (`insenv.estimators.velocity_integration.source`)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.estimators.parts import frozen_frame
from insenv.estimators.parts.error_model import variances
from insenv.estimators.parts.kalman import propagate
from insenv.estimators.velocity_integration.source import (
    ACCEL,
    ALPHA,
    DRIFT,
    EARTH_AXIS,
    GYRO,
    KEPT,
    MEAN,
    SUM,
    N,
)


def q_ni(x: Any, q_i0i: Any) -> Any:
    """Takes b components at the start to n components now (4)."""
    since = select(x.count == 0, 0.0, x.time - x.epoch)
    latitude, longitude, _ = geodesy.geodetic_from_ned_offset(x.velocity_n * since, x.latitude, x.longitude, x.height)
    q_ne = attitude.conjugate(geodesy.q_ew_from_geodetic(latitude, longitude, 0.0))
    q_ei = attitude.multiply(attitude.conjugate(frozen_frame.q_n0n(x.half_turn, ca.SX(EARTH_AXIS))), q_i0i)
    return attitude.multiply(q_ne, q_ei)


def variance_n(P: Any, C_ni: Any) -> Any:
    """Variances of the attitude by the answer kept, about n (3, rad^2)."""
    both = P[KEPT, KEPT] + P[DRIFT, DRIFT] + P[KEPT, DRIFT] + P[DRIFT, KEPT]
    return ca.diag(C_ni @ both @ C_ni.T)


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance: drift' = C b_g + noise, (delta alpha)' = -f x drift + C b_a + noise."""
    A = ca.SX(N, N)
    A[ALPHA, DRIFT] = -skew(x.stretch_alpha)
    A[DRIFT, GYRO] = A[ALPHA, ACCEL] = x.stretch_C_ib
    by_rotation, _ = variances(p, x.stretch_angle, ca.SX.zeros(3))
    noise = ca.vertcat(
        ca.repmat(p.angle_random_walk**2 * x.stretch + by_rotation, 3, 1),
        ca.repmat(p.velocity_random_walk**2 * x.stretch, 3, 1),
        ca.SX.zeros(N - 6),
    )
    return {
        "covariance": propagate(x.covariance, A, noise),
        "stretch": 0,
        "stretch_alpha": ca.SX.zeros(3),
        "stretch_C_ib": ca.SX.zeros(3, 3),
        "stretch_angle": ca.SX.zeros(3),
    }


def collected(stored: Any, dalpha: Any, keep: Any, share: Any, product: Any, error: Any, variance: Any) -> Any:
    """Covariance triangle after a measurement. With e = error x - noise, the error of alpha less that of the measurement,

    mean' = mean + share (e - mean),   y' = keep y + product [dalpha x]^T (e - mean)

    error: 3xN. variance: of each component of the noise, m^2/s^2.
    """
    across = product * skew(dalpha).T
    Phi, by_noise = ca.SX.eye(N), ca.SX(N, 3)
    Phi[MEAN, :], by_noise[MEAN, :] = share * error, share * ca.SX.eye(3)
    Phi[MEAN, MEAN] = (1 - share) * ca.SX.eye(3)
    Phi[SUM, :], by_noise[SUM, :] = across @ error, across
    Phi[SUM, MEAN], Phi[SUM, SUM] = -across, keep * ca.SX.eye(3)
    return symmetric.triangle(Phi @ symmetric.full(stored, N) @ Phi.T + variance * by_noise @ by_noise.T)
