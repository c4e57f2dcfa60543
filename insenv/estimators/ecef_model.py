"""The 12-state error model of alignment in the Earth frame, and the Kalman filter's linear algebra on it.

States: velocity error (m/s, e), misalignment phi (rad, e), accelerometer bias (m/s^2, b), gyro bias (rad/s, b); errors are
estimate minus truth, C_hat_eb = (I - [phi x]) C_eb, biases are what is still left in the measured rates:

    d(dv)/dt  = -2 omega_ie x dv + f^e x phi + C_eb b_a          (12)
    d(phi)/dt = -omega_ie x phi - C_eb b_g                       (22)
    d(b)/dt   = white noise (0 in the paper)                     (25)

Numbers are those of the ECEF fine-alignment paper.  Its observation z = -v_ins with H = [I 0 0 0] (26) does not go with the
sign of its (8), (12): with dv = estimate minus truth, z is +v_ins (less the velocity known from outside).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.attitude import skew
from insenv.core import symmetric
from insenv.geodesy import OMEGA_IE

N = 12
VELOCITY, TILT, ACCEL, GYRO = (slice(i, i + 3) for i in range(0, N, 3))


def transition(duration: Any, delta_velocity_e: Any, C_integral: Any) -> Any:
    """A (12x12) = integral of F over a stretch: its duration (s), the integrals of specific force (3, m/s, e) and of C_eb
    (3x3, s).
    """
    A = ca.SX(N, N)
    turn = skew(ca.SX([0, 0, OMEGA_IE]))
    turn = ca.sparsify(turn) * duration
    A[VELOCITY, VELOCITY] = -2 * turn
    A[VELOCITY, TILT] = skew(delta_velocity_e)
    A[VELOCITY, ACCEL] = C_integral
    A[TILT, TILT] = -turn
    A[TILT, GYRO] = -C_integral
    return A


def propagate(stored: Any, A: Any, noise: Any) -> Any:
    """Covariance triangle after a stretch: Phi P Phi^T + diag(noise).

    stored: triangle of P.  A: `transition`.  noise: 12 variances.  Phi is the product, row after row of A, of the elementary
    matrices that add A[i, :] times the other states to state i: a congruence, equal to exp(A) to first order.
    """
    P = [[stored[symmetric.place(i, j)] for j in range(N)] for i in range(N)]
    for i in range(N):
        terms = [(A[i, j], j) for j in range(N) if not A[i, j].is_zero()]
        if terms:
            row = [P[i][k] + sum(a * P[j][k] for a, j in terms) for k in range(N)]
            # on the diagonal the new cross terms count once more
            row[i] = P[i][i] + sum(a * (P[i][j] + row[j]) for a, j in terms)
            for k in range(N):
                P[i][k] = P[k][i] = row[k]
    for i in range(N):
        P[i][i] = P[i][i] + noise[i]
    return ca.vertcat(*[P[i][j] for j in range(N) for i in range(j + 1)])


def observation(A: Any, lag: Any) -> Any:
    """H (3x12) of the velocity error's mean over a window, of the state at its end: I - lag A, with A of the window.

    lag: 1/2 for the mean (the velocity error runs on evenly), 0 for the velocity at the end.
    """
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    H[:, TILT] = -lag * A[VELOCITY, TILT]
    H[:, ACCEL] = -lag * A[VELOCITY, ACCEL]
    return H


def observe(stored: Any, correction: Any, H: Any, innovation: Any, variance: Any, accept: Any) -> tuple[Any, Any]:
    """One scalar measurement z = H x + v: new covariance triangle and accumulated estimate of the error state (12).

    H: row (1x12).  innovation: z.  variance: of v.  accept: 1 to use it, 0 to leave everything as it is.
    """
    column = ca.densify(symmetric.full(stored, N) @ H.T)
    gain = column * (accept / (H @ column + variance))
    change = [gain[k] * column[j] for j in range(N) for k in range(j + 1)]
    return stored - ca.vertcat(*change), correction + gain * (innovation - H @ correction)
