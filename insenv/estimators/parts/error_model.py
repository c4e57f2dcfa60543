"""The 15-state error model of inertial navigation in the wander-azimuth frame, and the Kalman filter's linear algebra on it.

States: position error (m, w), velocity error (m/s, w), misalignment psi (rad, w), gyro bias (rad/s, b), accelerometer bias
(m/s^2, b): the errors of position and velocity are estimate minus truth, psi is the turn from the computed frame (w at the
computed position) to the platform, C_hat_wb = (I - [psi x]) C_wb, and the biases are what is still left in the measured rates:

    d(dr)/dt   = dv - omega_ew x dr
    d(dv)/dt   = f x psi + C_wb b_a - (2 omega_ie + omega_ew) x dv + g / R (-dr_x, -dr_y, 2 dr_z)
    d(psi)/dt  = -(omega_ie + omega_ew) x psi - C_wb b_g
    d(b)/dt    = -b / T

Source: the psi-angle model, Benson, "A comparison of two approaches to pure-inertial and Doppler-inertial error analysis", IEEE
Trans. AES-11 (1975); Groves (2013), section 14.2.  First-order Gauss-Markov biases as in the airborne paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.attitude import skew
from insenv.core import symmetric
from insenv.geodesy import MEAN_RADIUS

N = 15
POSITION, VELOCITY, TILT, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, N, 3))


@dataclass(frozen=True)
class Interval:
    """What the error model needs of a stretch of motion, possibly many samples long.

    duration: s.  delta_velocity_w: integral of the specific force in w (3, m/s).  C_integral: integral of C_wb (3x3, s).
    omega_ie_w, omega_ew_w: Earth and transport rate (3, rad/s).
    """

    duration: Any
    delta_velocity_w: Any
    C_integral: Any
    omega_ie_w: Any
    omega_ew_w: Any


def transition(interval: Interval, gravity: Any, gyro_time: Any, accel_time: Any) -> Any:
    """A (15x15) = integral of F over the interval; gravity in m/s^2, correlation times of the biases in s."""
    A, dt = ca.SX(N, N), interval.duration
    A[POSITION, POSITION] = -skew(interval.omega_ew_w) * dt
    A[POSITION, VELOCITY] = ca.SX.eye(3) * dt
    A[VELOCITY, POSITION] = ca.diag(ca.vertcat(-1, -1, 2)) * (gravity / MEAN_RADIUS * dt)
    A[VELOCITY, VELOCITY] = -skew(2 * interval.omega_ie_w + interval.omega_ew_w) * dt
    A[VELOCITY, TILT] = skew(interval.delta_velocity_w)
    A[VELOCITY, ACCEL] = interval.C_integral
    A[TILT, TILT] = -skew(interval.omega_ie_w + interval.omega_ew_w) * dt
    A[TILT, GYRO] = -interval.C_integral
    A[GYRO, GYRO] = -ca.SX.eye(3) * (dt / gyro_time)
    A[ACCEL, ACCEL] = -ca.SX.eye(3) * (dt / accel_time)
    return A


def propagate(stored: Any, A: Any, noise: Any) -> Any:
    """Covariance triangle after an interval: Phi P Phi^T + diag(noise).

    stored: triangle of P.  A: `transition`.  noise: the 15 variances that driving white noise adds in the interval,
    isotropic in each group of three so that they need no turning into w.

    Phi is the product, row after row of A, of the elementary matrices that add A[i, :] times the other states to state i and
    scale it by 1 + A[i, i].  It equals exp(A) to first order as I + A does, is a congruence (P stays positive definite), and
    touches one row and column at a time: two thirds of the operations of the matrix product.
    """
    P = [[stored[symmetric.place(i, j)] for j in range(N)] for i in range(N)]
    for i in range(N):
        sources = [(A[i, j], P[j]) for j in range(N) if j != i and not A[i, j].is_zero()]
        row = [P[i][k] + sum(a * other[k] for a, other in sources) for k in range(N)]
        # on the diagonal the new cross terms count once more: p_ii + sum a_j (p_ij + p'_ij)
        mixed = sum(A[i, j] * (P[i][j] + row[j]) for j in range(N) if j != i and not A[i, j].is_zero())
        row[i] = P[i][i] + mixed
        if not A[i, i].is_zero():
            decay = 1 + A[i, i]
            row = [decay * value for value in row]
            row[i] = decay * row[i]
        P[i] = row
        for k in range(N):
            P[k][i] = row[k]
        P[i][i] = row[i]
    for i in range(N):
        P[i][i] = P[i][i] + noise[i]
    return ca.vertcat(*[P[i][j] for j in range(N) for i in range(j + 1)])


def measure(stored: Any, correction: Any, H: Any, innovation: Any, variance: Any, accept: Any) -> tuple[Any, Any]:
    """One scalar measurement z = H x + v: new covariance triangle and accumulated estimate.

    correction: estimate of the error state so far (15).  H: row (1x15).  innovation: z.  variance: of v.
    accept: 1 to use it, 0 to leave everything as it is.
    """
    P = symmetric.full(stored, N)
    PHt = ca.densify(P @ H.T)
    K = PHt * (accept / ((H @ PHt) + variance))
    correction = correction + K * (innovation - H @ correction)
    return symmetric.triangle(P - K @ PHt.T), correction


def weight_and_gain(stored: Any, H: Any, variance: Any, accept: Any) -> tuple[Any, Any]:
    """What `measure` uses: the weight of the innovation, accept over its variance, and the gain K = P H^T weight (15)."""
    PHt = ca.densify(symmetric.full(stored, N) @ H.T)
    weight = accept / ((H @ PHt) + variance)
    return weight, PHt * weight


def innovation_variance(stored: Any, H: Any, variance: Any) -> Any:
    """Variance of a scalar measurement's innovation."""
    return H @ symmetric.full(stored, N) @ H.T + variance
