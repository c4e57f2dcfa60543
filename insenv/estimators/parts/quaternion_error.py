"""The additive-quaternion-error (AQE) model of large misalignment, shared by `aqe-ekf` and `aqe-sukf`.

Source: the LS-SVM large misalignment paper, equations (1)-(9).  All three misalignment angles may be large: the attitude
error is the difference of two unit quaternions, dQ = Q_hat - Q, and no angle is taken as small.

Translation: the paper's n is east, north, up and its b right, forward, up; here n is north, east, down turned by the wander
angle (frame w of `insenv.estimators.parts.strapdown`), b forward, right, down, and Q = q_wb.  The equations hold in any pair of
right-handed frames, so only components change places.  Where (1) to (3) print <w_in>, (6) has [w_in]: it is the left
multiplication.  The matrices are in `insenv.estimators.parts.aqe_algebra`.

    d(dQ)/dt = 1/2 <w_ib> dQ - 1/2 [w_in] dQ + 1/2 U(Q_hat) b_g - 1/2 Y(Q_hat) dw_in                              (6)
    d(dv)/dt = dC f_hat + C b_a - (2 w_ie + w_ew) x dv - dw_ew x v + gravity gradient                             (7)
    dC = C_hat - C = 2 Y^T(dQ) U(Q_hat) - Y^T(dQ) U(dQ)                                                           (8), (9)

(The paper prints w_ie + w_in in (7); it is 2 w_ie + w_en.  The change of the Earth's rate with the position error, 1e-11
rad/s for a metre, is left out.)  States: dQ(4), gyro bias(3), accelerometer bias(3), dv(3) - the paper's 13 - and dr(3),
the position error in metres.

Over an interval (6) without its inputs is an isometry, dQ(T) = conj(q_n) (x) dQ(0) (x) q_b, with q_n the turn of the
navigation frame and q_b that of the body, and the velocity error is C(Q_hat) - C(Q) applied to the integral of the specific
force in the body axes at the interval's start.  So a filter interval needs the nonlinear function once, however many
inertial samples it has and however the vehicle moves.

The norm: Q = Q_hat - dQ is a unit quaternion.  The covariance of dQ stands on the tangent Y(Q_hat) of the unit sphere: the
start and the noise do, and (6) keeps it there.  After a correction the estimate is normalised and the covariance carried
along to its new tangent: dQ by the turn from the old to the new estimate on the left, dv and dr by its matrix, as errors
that are fixed in the body.  So what gravity cannot show, a turn about the specific force, which the body's axes know
whatever the attitude, is still unknown after the correction.  (With the mere projection on the new tangent the filter
believes that it has learnt the heading while it levels, and is left with degrees of error at a stated tenth of a degree.)
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import exp, select
from insenv.core.model import Model, Step, Values
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.aqe_algebra import Nonlinear, Spread, U, Y, left, right, sensitivity
from insenv.estimators.parts.aqe_feedback import begun, fused, placed
from insenv.estimators.parts.aqe_tables import ACCEL, DQ, GYRO, INPUTS, OUTPUTS, PARAMETERS, POSITION, STATE, VELOCITY, N
from insenv.estimators.parts.increments import compensated
from insenv.estimators.parts.navigation_error import navigation_error_w
from insenv.geodesy import MEAN_RADIUS, NOMINAL_GRAVITY


def start_covariance(p: Any, q: Any) -> Any:
    """Covariance (16x16) of a start: of dQ the second moments of sin(phi/2) for normal angles phi about n, on Y(Q_hat)."""
    tilt, heading = (0.5 * (1 - exp(-0.5 * s * s)) for s in (p.tilt_sigma, p.heading_sigma))
    rest = ca.vertcat(
        ca.repmat(p.gyro_bias_sigma, 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1), p.velocity_sigma, p.position_sigma
    )
    return ca.diagcat(Y(q) @ ca.diag(ca.vertcat(tilt, tilt, heading)) @ Y(q).T, ca.diag(rest * rest))


def start(p: Any) -> dict[str, Any]:
    """The start as given; w is NED there."""
    rows = strapdown.start_state(p)
    return {
        **rows,
        "stretch_q_wb": rows["q_wb"],
        "gyro_bias": p.start_gyro_bias,
        "accel_bias": p.start_accel_bias,
        "covariance": symmetric.triangle(start_covariance(p, rows["q_wb"])),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: mechanization with the estimated quaternion and biases, and the stretch's integrals."""
    delta_angle = u.delta_angle - x.gyro_bias * u.dt
    delta_velocity = u.delta_velocity - x.accel_bias * u.dt
    moved = strapdown.move(x, delta_angle, delta_velocity, u.dt)
    rotation, increment = compensated(x, delta_angle, delta_velocity)
    C = attitude.to_dcm(x.stretch_turn)
    turn = attitude.renormalize(attitude.multiply(x.stretch_turn, attitude.from_small_rotation_vector(rotation)))
    gained = C @ increment
    stretch = x.stretch + u.dt
    due = ca.logic_or(stretch + u.dt / 2 > p.filter_interval, ca.logic_or(u.gnss_valid, u.standing))
    return {
        **strapdown.moved_rows(moved, x, delta_angle, delta_velocity),
        "dt": u.dt,
        "stretch": stretch,
        "stretch_turn": turn,
        "stretch_velocity": x.stretch_velocity + gained,
        "stretch_distance": x.stretch_distance + (x.stretch_velocity + gained / 2) * u.dt,
        "stretch_C": x.stretch_C + (C + attitude.to_dcm(turn)) * (u.dt / 2),
        "omega_ie_w": moved.omega_ie_w,
        "omega_ew_w": moved.omega_ew_w,
        "acceleration_w": (moved.velocity_w - x.velocity_w) / u.dt,
        "predict_due": select(due, 1.0, 0.0),
    }


def transition(x: Any, part: Nonlinear) -> Any:
    """Phi (16x16) over the stretch, with the nonlinear part by its regression; (6), (7) integrated."""
    T, q, C = x.stretch, x.stretch_q_wb, part.C
    frame = ca.vertcat(1, -(x.omega_ie_w + x.omega_ew_w) * (T / 2))
    carry = left(frame) @ right(x.stretch_turn)
    into_quaternion = U(q) @ x.stretch_C / 2  # dQ, in its coordinates at the stretch's start, that a gyro bias makes
    middle = part.G @ into_quaternion / 2  # on average half of it acts on the velocity
    along = C @ x.stretch_C
    coriolis = -skew(2 * x.omega_ie_w + x.omega_ew_w) * T
    gradient = ca.diag(ca.vertcat(-1, -1, 2)) * (NOMINAL_GRAVITY / MEAN_RADIUS * T)
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
    return Phi


def process_noise(p: Any, T: Any, q: Any) -> Any:
    """Covariance (16x16) that the driving white noises add in an interval T; q: the attitude at its end."""
    Q = ca.SX(N, N)
    Q[DQ, DQ] = p.angle_random_walk**2 * T / 4 * Y(q) @ Y(q).T
    Q[GYRO, GYRO] = ca.SX.eye(3) * (2 * p.gyro_bias_sigma**2 / p.gyro_correlation_time * T)
    Q[ACCEL, ACCEL] = ca.SX.eye(3) * (2 * p.accel_bias_sigma**2 / p.accel_correlation_time * T)
    velocity = p.velocity_random_walk**2 * T
    Q[VELOCITY, VELOCITY] = ca.SX.eye(3) * velocity
    Q[VELOCITY, POSITION] = Q[POSITION, VELOCITY] = ca.SX.eye(3) * (velocity * T / 2)
    Q[POSITION, POSITION] = ca.SX.eye(3) * (velocity * T * T / 3)
    return Q


def predict(p: Any, x: Any, spread: Spread) -> dict[str, Any]:
    """The time update over the stretch of samples since the last one."""
    P = symmetric.full(x.covariance, N)
    part = spread(x.stretch_q_wb, P[DQ, DQ], x.stretch_velocity, x.stretch_distance)
    Phi = transition(x, part)
    P = Phi @ P @ Phi.T + process_noise(p, x.stretch, x.q_wb)
    moving = [*range(N)[VELOCITY], *range(N)[POSITION]]
    P[moving, moving] = P[moving, moving] + part.extra
    return {
        **placed(x, x.velocity_w - part.mean[:3], -part.mean[3:]),
        "covariance": symmetric.triangle(P),
        **begun(x.q_wb),
    }


def predicted_fix(p: Any, x: Any, age: Any) -> tuple[Any, Any, Any]:
    """What an antenna would have shown `age` ago: its place relative to the unit now (m, w), its velocity (m/s, w), and the
    derivatives (6x16) of both with respect to the error state.
    """
    q = x.q_wb
    C_wb = attitude.to_dcm(q)
    rate_b = x.previous_delta_angle / x.dt
    swing = ca.cross(rate_b, p.antenna_lever_arm)
    arm_then = p.antenna_lever_arm - age * swing
    acceleration = x.acceleration_w
    down = geodesy.earth_rate_w(x.q_ew)[2] / geodesy.OMEGA_IE
    force_b = C_wb.T @ (acceleration - ca.vertcat(0, 0, geodesy.normal_gravity(-down, x.height)))
    offset = -x.velocity_w * age + acceleration * (age**2 / 2) + C_wb @ arm_then
    velocity = x.velocity_w - acceleration * age + C_wb @ swing
    H = ca.SX(6, N)
    H[:3, POSITION] = H[3:, VELOCITY] = ca.SX.eye(3)
    H[:3, VELOCITY] = -age * ca.SX.eye(3)
    H[:3, DQ] = sensitivity(q, arm_then + force_b * (age**2 / 2))
    H[3:, DQ] = sensitivity(q, swing - force_b * age)
    H[:3, GYRO] = age * (C_wb @ skew(p.antenna_lever_arm))
    H[3:, GYRO] = -(C_wb @ skew(p.antenna_lever_arm))
    H[:3, ACCEL] = C_wb * (age**2 / 2)
    H[3:, ACCEL] = -C_wb * age
    return offset, velocity, H


def gnss(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix: differences of position and, where it has one, of velocity, component by component in n, with feedback."""
    offset, velocity, H = predicted_fix(p, x, u.gnss_age)
    C_nw = strapdown.C_nw(x.q_ew)
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    measured = geodesy.ned_offset(u.gnss_latitude, u.gnss_longitude, u.gnss_height, latitude, longitude, x.height)
    innovation = ca.vertcat(C_nw @ offset - measured, C_nw @ velocity - u.gnss_velocity_n)
    H = ca.diagcat(C_nw, C_nw) @ H
    P = symmetric.full(x.covariance, N)[DQ, DQ]
    variance = ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma) ** 2 + _curvature(p, x, P)
    present = ca.vertcat(1, 1, 1, *[u.gnss_velocity_valid] * 3)

    rows, test_ratio = fused(x, innovation, H, variance, present)
    return {**rows, "innovation": innovation * present, "test_ratio": test_ratio}


def zero_velocity(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The vehicle is known to stand: its velocity is zero within `standing_sigma`."""
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    return fused(x, x.velocity_w, H, ca.repmat(p.standing_sigma**2, 3, 1), [1, 1, 1])[0]


def _curvature(p: Any, x: Any, P: Any) -> Any:
    """Variances (6) for what a fix's linear sensitivity to dQ leaves out of the lever arm's turn: |Y^T(dQ) U(dQ) a|^2 <= |dQ|^4
    |a|^2, with normal dQ.
    """
    fourth = ca.trace(P) ** 2 + 2 * ca.sumsqr(P)
    swing = ca.cross(x.previous_delta_angle / x.dt, p.antenna_lever_arm)
    position, velocity = fourth * ca.sumsqr(p.antenna_lever_arm), fourth * ca.sumsqr(swing)
    return ca.vertcat(*[position] * 3, *[velocity] * 3)


def output(p: Any, x: Any) -> dict[str, Any]:
    """Navigation in n, and standard deviations; the misalignment about n is 2 Y^T(Q_hat) dQ to first order."""
    C_nw = strapdown.C_nw(x.q_ew)
    P = symmetric.full(x.covariance, N)
    tilt = 2 * C_nw @ Y(x.q_wb).T

    def sigma(matrix: Any, part: slice) -> Any:
        return ca.sqrt(ca.diag(matrix @ P[part, part] @ matrix.T))

    return {
        **strapdown.navigation_outputs(x),
        "gyro_bias": x.gyro_bias,
        "accel_bias": x.accel_bias,
        "position_sigma": sigma(C_nw, POSITION),
        "velocity_sigma": sigma(C_nw, VELOCITY),
        "attitude_sigma": sigma(tilt, DQ),
        "innovation": x.innovation,
        "test_ratio": x.test_ratio,
    }


def consistency_error(x: Values, outputs: Values, truth: Values) -> tuple[Any, Any]:
    """Velocity, position and the rotation 2 Y^T dQ (9) of the estimate, and their covariance."""
    offset, velocity, turn, theta = navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, N)
    tilt = ca.horzcat(2 * Y(x.q_wb).T, ca.SX(3, N - 4))
    level = ca.horzcat(ca.SX(6, N - 6), ca.SX.eye(6))  # the last six states: velocity, position
    chosen = ca.vertcat(level, tilt)
    return ca.vertcat(velocity, offset, turn - theta), chosen @ P @ chosen.T


def estimator(id: str, title: str, spread: Spread) -> Estimator:
    """An estimator on this model; `spread` makes its time update."""
    model = Model(
        id=id,
        title=title,
        parameters=PARAMETERS,
        state=STATE,
        inputs=INPUTS,
        outputs=OUTPUTS,
        steps={
            "sample": Step(sample),
            "predict": Step(lambda p, x, u: predict(p, x, spread), when="predict_due"),
            "gnss": Step(gnss, when="gnss_valid"),
            "zero_velocity": Step(zero_velocity, when="standing"),
        },
        output=output,
        start=start,
    )
    return Estimator(model, kind="navigation", sensors=("gnss",), error=consistency_error)
