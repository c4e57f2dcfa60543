"""Kalman filter algebra over CasADi symbols, for any number n of states.

A covariance P (n x n) is stored as its upper triangle (`insenv.core.symmetric`). Measurements are scalar, z = H x + v,
and are processed one after another: the estimate of the error state accumulates and is fed back to the navigation state
at the end. An `accept` of 0 leaves covariance and estimate unchanged, so a measurement may be absent without a branch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.elementary import exp


@dataclass(frozen=True)
class Scalar:
    """One scalar measurement as it was used.

    H: row (1 x n). left: innovation minus what the scalars before it explained. accept: 1 if it was used, 0 if not.
    weight: `accept` over the variance of the innovation. gain: P H^T weight (n).
    """

    H: Any
    left: Any
    accept: Any
    weight: Any
    gain: Any


@dataclass(frozen=True)
class Update:
    """Scalars in the order used, the estimated error (n), and the covariance triangle after them."""

    scalars: tuple[Scalar, ...]
    correction: Any
    stored: Any


def propagate(stored: Any, A: Any, noise: Any) -> Any:
    """Covariance triangle after an interval: Phi P Phi^T + diag(noise).

    stored: triangle of P. A (n x n): integral of the error dynamics over the interval. noise (n): variances that the
    driving white noise adds, isotropic in each vector of three, so that they are the same in every frame.

    Phi is the product, row after row of A, of the elementary matrices that add A[i, :] times the other states to state
    i and scale state i by 1 + A[i, i]. It equals exp(A) to first order as I + A does, it is a congruence (P stays
    positive definite), and it touches one row and column at a time: two thirds of the operations of the matrix product.
    """
    n = A.shape[0]
    P = [[stored[symmetric.place(i, j)] for j in range(n)] for i in range(n)]
    for i in range(n):
        terms = [(A[i, j], j) for j in range(n) if j != i and not A[i, j].is_zero()]
        row = [P[i][k] + sum(a * P[j][k] for a, j in terms) for k in range(n)]
        # on the diagonal the new cross terms count once more: p_ii + sum a_j (p_ij + p'_ij)
        row[i] = P[i][i] + sum(a * (P[i][j] + row[j]) for a, j in terms)
        if not A[i, i].is_zero():
            decay = 1 + A[i, i]
            row = [decay * value for value in row]
            row[i] = decay * row[i]
        for k in range(n):
            P[i][k] = P[k][i] = row[k]
    for i in range(n):
        P[i][i] = P[i][i] + noise[i]
    return ca.vertcat(*[P[i][j] for j in range(n) for i in range(j + 1)])


def elementary(transition: Any) -> Any:
    """A (k x k) for `propagate` whose elementary matrices have the product `transition` (k x k), to rounding.

    They make x_i' = (1 + A_ii) (x_i + sum of A_ij x_j' over j < i + sum of A_ij x_j over j > i), so with the triangular factors
    transition = L U, L of unit diagonal, the inverse of L has the sums of the new states, and U those of the old.  The leading
    minors must not be 0; zeros of the structure stay.
    """
    k = transition.shape[0]
    U, inverse, A = ca.SX(transition), ca.SX.eye(k), ca.SX(k, k)
    for i in range(k):
        for row in range(i + 1, k):
            if not U[row, i].is_zero():
                factor = U[row, i] / U[i, i]
                U[row, i:] = U[row, i:] - factor * U[i, i:]
                inverse[row, : i + 1] = inverse[row, : i + 1] - factor * inverse[i, : i + 1]
        A[i, i] = U[i, i] - 1
        for j in range(k):
            entry = -inverse[i, j] if j < i else U[i, j]
            if j != i and not entry.is_zero():
                A[i, j] = entry / U[i, i]
    return A


def measure(stored: Any, correction: Any, H: Any, innovation: Any, variance: Any, accept: Any) -> tuple[Any, Any, Scalar]:
    """Covariance triangle and estimate of the error state (n) after one scalar measurement, and how it was used.

    correction (n): the estimate before it. H: row (1 x n). innovation: z. variance: of v. accept: 1 or 0.
    """
    P = symmetric.full(stored, H.shape[1])
    column = ca.densify(P @ H.T)
    weight = accept / ((H @ column) + variance)
    gain, left = column * weight, innovation - H @ correction
    return symmetric.triangle(P - gain @ column.T), correction + gain * left, Scalar(H, left, accept, weight, gain)


def measure_joseph(P: Any, correction: Any, H: Any, innovation: Any, variance: Any, accept: Any) -> tuple[Any, Any, Any]:
    """As `measure`, on a full matrix and in Joseph's form; and the innovation over its standard deviation.

    Joseph's form keeps P positive definite where variances fall by ten orders of magnitude in the first measurements.
    """
    column = ca.densify(P @ H.T)
    S = H @ column + variance
    remaining = innovation - H @ correction
    gain = column * (accept / S)
    correction = correction + gain * remaining
    P = P - gain @ column.T
    P = P - (P @ H.T) @ gain.T + (variance * accept) * gain @ gain.T
    return symmetric.full(symmetric.triangle(P), P.shape[0]), correction, accept * remaining / ca.sqrt(S)


def innovation_variance(stored: Any, H: Any, variance: Any) -> Any:
    """Variance of the innovation of a scalar measurement."""
    column = ca.densify(symmetric.full(stored, H.shape[1]) @ H.T)  # as in `measure`, so that it is computed once
    return H @ column + variance


# Biases as first-order Gauss-Markov processes, stepped over an interval of any length.
#
#     b <- a b + w,   a = exp(-T / time),   variance of w = sigma^2 (1 - a^2)
#
# so that a variance of sigma^2 stays sigma^2. The estimate of the bias decays as the bias does: between measurements the
# best estimate of b(T) is a b(0). Gelb (1974), chapter 3.


def decay(duration: Any, time: Any) -> Any:
    """a over `duration` with the correlation time `time` (s): 1 / exp(duration / time) by its series.

    Within 1e-12 up to a hundredth of the time, 2e-4 up to half of it, and between 0 and 1 for any duration; the variance
    stays sigma^2 with every a.
    """
    x = duration / time
    return 1 / (1 + x * (1 + x * (1 / 2 + x * (1 / 6 + x / 24))))


def decays(p: Any, duration: Any) -> tuple[Any, Any]:
    """Factors a of the gyro and of the accelerometer biases over `duration` (s).

    p: rows `gyro_correlation_time`, `accel_correlation_time` (s).
    """
    return decay(duration, p.gyro_correlation_time), decay(duration, p.accel_correlation_time)


def driven_variance(sigma: Any, decay: Any) -> Any:
    """Variance that the driving noise adds to each component of a bias of standard deviation `sigma`."""
    return sigma**2 * (1 - decay) * (1 + decay)


def correlated_again(variance: Any, since: Any, time: Any) -> Any:
    """Variance to add to a measurement whose error is a first-order Gauss-Markov process, `since` seconds after the last one.

    Of a constant, such an error of variance s^2 leaves the information 1 / s^2 at the first measurement and
    (1 - r) / (1 + r) / s^2 at each further one, r = exp(-since / time): as if its variance were s^2 (1 + r) / (1 - r).
    """
    r = exp(-since / time)
    return variance * (2 * r / (1 - r + 1e-12))
