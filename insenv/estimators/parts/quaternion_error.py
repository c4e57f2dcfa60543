"""The additive-quaternion-error (AQE) model of large misalignment: algebra, transition, noise, start covariance.

Source: the LS-SVM large misalignment paper, equations (1)-(9). All three misalignment angles may be large: the attitude
error is the difference of two unit quaternions, dQ = Q_hat - Q, and no angle is assumed to be small.

Hamilton quaternions, scalar first; n and b are any right-handed frames, Q takes b components to n components:

    [p] q = p (x) q,   <w> q = q (x) w,   U(q) u = q (x) (0, u),   Y(q) u = (0, u) (x) q                    (4)
    Y^T U = C,   Y^T q = U^T q = 0                                                                             (5)
    d(dQ)/dt = 1/2 <w_ib> dQ - 1/2 [w_in] dQ + 1/2 U(Q_hat) b_g - 1/2 Y(Q_hat) dw_in                           (6)
    d(dv)/dt = dC f_hat + C b_a - (2 w_ie + w_ew) x dv - dw_ew x v + gravity gradient                          (7)
    dC = C_hat - C = 2 Y^T(dQ) U(Q_hat) - Y^T(dQ) U(dQ)                                                        (8), (9)

Frames: the paper's n is east, north, up and its b right, forward, up. Here n is north, east, down turned by the wander
angle (frame w of `insenv.estimators.parts.strapdown`), b is forward, right, down, and Q = q_wb. The equations hold in
any pair of right-handed frames; only the order and signs of the components differ. Corrections to the paper: (1) to (3)
print <w_in>, (6) has [w_in], which is the left multiplication; (7) prints w_ie + w_in, it is 2 w_ie + w_en. The gradient
of gravity is vertical only: Q is relative to the computed vertical, which a position error turns (dw_in). Neglected:
the change of the Earth's rate with the position error, 1e-11 rad/s per metre.

States: dQ (4), gyro bias (3), accelerometer bias (3), dv (3) as in the paper, and dr (3), the position error in metres.

Over an interval, (6) without its inputs is an isometry, dQ(T) = conj(q_n) (x) dQ(0) (x) q_b, with q_n the rotation of
the navigation frame and q_b that of the body, and the velocity error is C(Q_hat) - C(Q) applied to the integral of the
specific force in the body axes at the start of the interval. So a time update evaluates the nonlinear function once,
however many inertial samples it covers and however the vehicle moves.

Norm: Q = Q_hat - dQ is a unit quaternion. The covariance of dQ lies on the tangent Y(Q_hat) of the unit sphere: start
covariance and noise do, and (6) keeps it there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.attitude import skew
from insenv.core.elementary import exp
from insenv.estimators.parts.error_model import bias_of_tilt, bias_sigma
from insenv.estimators.parts.kalman import decays, driven_variance
from insenv.geodesy import MEAN_RADIUS, NOMINAL_GRAVITY

N = 16
DQ, GYRO, ACCEL, VELOCITY, POSITION = slice(0, 4), slice(4, 7), slice(7, 10), slice(10, 13), slice(13, 16)


def left(q: Any) -> Any:
    """[q] (4x4): [q] p = q (x) p."""
    return ca.vertcat(ca.horzcat(q[0], -q[1:].T), ca.horzcat(q[1:], q[0] * ca.SX.eye(3) + skew(q[1:])))


def right(q: Any) -> Any:
    """<q> (4x4): <q> p = p (x) q."""
    return ca.vertcat(ca.horzcat(q[0], -q[1:].T), ca.horzcat(q[1:], q[0] * ca.SX.eye(3) - skew(q[1:])))


def U(q: Any) -> Any:
    """U(q) (4x3): U u = q (x) (0, u), (4)."""
    return left(q)[:, 1:]


def Y(q: Any) -> Any:
    """Y(q) (4x3): Y u = (0, u) (x) q, (4)."""
    return right(q)[:, 1:]


def sensitivity(q_hat: Any, vector: Any) -> Any:
    """Derivative (3x4) of dC v with respect to dQ at 0: 2 Y^T(dQ) U(Q_hat) v as a matrix times dQ, (9)."""
    w = U(q_hat) @ vector
    return 2 * ca.horzcat(w[1:], -w[0] * ca.SX.eye(3) - skew(w[1:]))


@dataclass(frozen=True)
class Nonlinear:
    """The nonlinear part of a time update: [C(Q_hat) - C(Q)] times the integrals of the specific force.

    G (6x4): its regression on dQ, velocity first, then position. mean (6): its mean.
    extra (6x6): covariance of the residual of the regression. C (3x3): mean attitude matrix.
    """

    G: Any
    mean: Any
    extra: Any
    C: Any


Spread = Callable[[Any, Any, Any, Any], Nonlinear]
"""From Q_hat at the start of the interval, P of dQ (4x4) and the integrals of the specific force (3, m/s; 3, m)."""


def start_covariance(p: Any, q: Any) -> Any:
    """Covariance (16x16) of a start with attitude q: of dQ the second moments of sin(phi/2), phi about n and normal."""
    tilt, heading = (0.5 * (1 - exp(-0.5 * s * s)) for s in (p.tilt_sigma, p.heading_sigma))
    sigma = ca.vertcat(ca.repmat(bias_sigma(p), 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1), p.velocity_sigma, p.position_sigma)
    P = ca.diagcat(Y(q) @ ca.diag(ca.vertcat(tilt, tilt, heading)) @ Y(q).T, ca.diag(sigma * sigma))
    # phi = 2 Y^T dQ turns the true n to the computed one
    by_attitude = -2 * bias_of_tilt(p) @ Y(q).T
    shared = by_attitude @ P[DQ, DQ]
    P[GYRO, DQ], P[DQ, GYRO] = shared, shared.T
    P[GYRO, GYRO] = P[GYRO, GYRO] + shared @ by_attitude.T
    return P


def transition(p: Any, x: Any, part: Nonlinear) -> Any:
    """Phi (16x16) over the interval of the state `x` (rows `since_propagation*`) with its nonlinear part; (6), (7) integrated.

    Biases decay in their own blocks alone: what they do to the rest changes by the interval over their correlation time.
    """
    T, q, C = x.since_propagation, x.since_propagation_q_wb, part.C
    frame = ca.vertcat(1, -(x.omega_ie_w + x.omega_ew_w) * (T / 2))
    carry = left(frame) @ right(x.since_propagation_turn)
    into_quaternion = U(q) @ x.since_propagation_C / 2  # dQ that a gyro bias causes, in its coordinates at the interval's start
    middle = part.G @ into_quaternion / 2  # on average half of it acts on the velocity
    along = C @ x.since_propagation_C
    coriolis = -skew(2 * x.omega_ie_w + x.omega_ew_w) * T
    # vertical only: Q is relative to the computed vertical, which a position error turns; dw_ew carries that effect
    gradient = ca.diag(ca.vertcat(0, 0, 2)) * (NOMINAL_GRAVITY / MEAN_RADIUS * T)
    turned = ca.vertcat(ca.horzcat(0, 1, 0), ca.horzcat(-1, 0, 0), ca.SX(1, 3)) / MEAN_RADIUS  # dw_ew of dv
    Phi = ca.SX(N, N)
    for i in range(N):
        Phi[i, i] = 1
    Phi[DQ, DQ] = carry
    Phi[DQ, GYRO] = carry @ into_quaternion
    Phi[DQ, VELOCITY] = -carry @ Y(q) @ turned * (T / 2)
    Phi[VELOCITY, DQ] = part.G[:3, :]
    Phi[VELOCITY, GYRO] = middle[:3, :]
    Phi[VELOCITY, ACCEL] = along
    Phi[VELOCITY, VELOCITY] = ca.SX.eye(3) + coriolis + skew(x.velocity_w) @ turned * T
    Phi[VELOCITY, POSITION] = gradient
    Phi[POSITION, DQ] = part.G[3:, :]
    Phi[POSITION, GYRO] = middle[3:, :] * (2 / 3)  # double integral of a ramp
    Phi[POSITION, ACCEL] = along * (T / 2)
    Phi[POSITION, VELOCITY] = ca.SX.eye(3) * T
    gyro_decay, accel_decay = decays(p, T)
    Phi[GYRO, GYRO], Phi[ACCEL, ACCEL] = gyro_decay * ca.SX.eye(3), accel_decay * ca.SX.eye(3)
    return Phi


def process_noise(p: Any, T: Any, q: Any, motion: tuple[Any, Any]) -> Any:
    """Covariance (16x16) that the driving white noises add in an interval T (s); q: the attitude at its end.

    motion: variances of attitude (rad^2) and velocity (m^2/s^2) by errors that are proportional to the motion.
    """
    Q = ca.SX(N, N)
    Q[DQ, DQ] = (p.angle_random_walk**2 * T + motion[0]) / 4 * Y(q) @ Y(q).T
    gyro_decay, accel_decay = decays(p, T)
    Q[GYRO, GYRO] = ca.SX.eye(3) * driven_variance(p.gyro_bias_sigma, gyro_decay)
    Q[ACCEL, ACCEL] = ca.SX.eye(3) * driven_variance(p.accel_bias_sigma, accel_decay)
    velocity = p.velocity_random_walk**2 * T + motion[1]
    Q[VELOCITY, VELOCITY] = ca.SX.eye(3) * velocity
    Q[VELOCITY, POSITION] = Q[POSITION, VELOCITY] = ca.SX.eye(3) * (velocity * T / 2)
    Q[POSITION, POSITION] = ca.SX.eye(3) * (velocity * T * T / 3)
    return Q
