"""`aqe-ekf`, `aqe-sukf`: GNSS-aided alignment and navigation from any misalignment, by the additive quaternion error.

Source: the LS-SVM large misalignment paper; the error model and its equations are in
`insenv.estimators.parts.quaternion_error`. The two filters share everything but the time update of the nonlinear part,
[C(Q_hat) - C(Q)] times the integrals of the specific force.

`aqe-ekf` linearises it at the estimate: of (9) it keeps 2 Y^T(dQ) U(Q_hat) f.

`aqe-sukf` is a simplified unscented Kalman filter: the measurement is linear, so only the time update uses sigma
points, and of these only the ones that differ in dQ, because the model is linear in the other states. With dQ first in
the Cholesky factor, with its three dimensions on the tangent of the unit sphere, these are the centre and 6 of the 27
points of the paper's 13 states.

- The points lie at +-sqrt(3) times the columns of the factor (n + kappa = 3 matches the fourth moment of a normal
  distribution).
- The last axis is the rotation about the specific force: it alone changes no velocity, so the regression preserves
  exactly what is unobservable.
- The covariance of the residual of the regression comes from second differences (Norgaard, Poulsen and Ravn, "New
  developments in state estimation for nonlinear systems", Automatica 36 (2000)): no weight is negative, so it stays
  positive.
- Three points between the axes show the products of two errors, which points on the axes do not: a tilt seen from an
  unknown heading. Without them the filter becomes overconfident in its heading while it levels.

After a measurement the estimate is normalised and the covariance moved to its new tangent: dQ by left multiplication
with the rotation from the old to the new estimate, dv and dr by its matrix, as errors that are fixed in the body. So
the rotation about the specific force, which gravity cannot show, is still unknown after the correction. With a
projection onto the new tangent instead, the filter becomes overconfident in its heading while it levels: errors of
degrees at a stated tenth of a degree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.elementary import maximum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator, Notes
from insenv.estimators.parts import gnss_fix, lever_arm, rows, strapdown
from insenv.estimators.parts.applicability import linear_start, together, unmodelled_motion, unseen_heading
from insenv.estimators.parts.error_model import turned, variances
from insenv.estimators.parts.kalman import decays, measure_joseph
from insenv.estimators.parts.quaternion_error import (
    ACCEL,
    DQ,
    GYRO,
    POSITION,
    VELOCITY,
    N,
    Nonlinear,
    Spread,
    U,
    Y,
    left,
    process_noise,
    sensitivity,
    start_covariance,
    transition,
)
from insenv.estimators.parts.strapdown import compensated

SPREAD = 3.0  # n + kappa
_ROOT = 1.7320508075688772

PARAMETERS = rows.START + rows.START_SIGMAS + rows.START_BIASES + rows.chosen(
    rows.SENSORS, gyro_bias_sigma=1e-6, accel_bias_sigma=1e-2, angle_random_walk=1e-5, velocity_random_walk=1e-3
) + rows.LEVER_ARM + rows.STANDING_SIGMA + rows.FIX_WANDER + rows.MOTION_ERRORS + Table((
    Row("filter_interval", "Longest interval between time updates", "s", start=1.0, lower=0.0, upper=10.0),
))  # fmt: skip

SINCE_PROPAGATION = Table((
    Row("since_propagation", "Time since the last time update", "s"),
    Row("since_propagation_q_wb", "Attitude at the last time update", "1", (4,), "w", (1, 0, 0, 0)),
    Row("since_propagation_turn", "Rotation since: takes b components to components in b then", "1", (4,), "b then",
        (1, 0, 0, 0)),
    Row("since_propagation_velocity", "Integral of the specific force since", "m/s", (3,), "b then"),
    Row("since_propagation_distance", "Its integral", "m", (3,), "b then"),
    Row("since_propagation_C", "Integral of the matrix of that rotation", "s", (3, 3), "b then"),
))  # fmt: skip
"""What is integrated from one time update or correction to the next."""

STATE = strapdown.STATE + rows.BIASES + Table((
    Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
    Row("dt", "Interval of the last sample", "s", start=1.0),
    *SINCE_PROPAGATION,
    Row("omega_ie_w", "Earth rate at the last sample", "rad/s", (3,), "w"),
    Row("omega_ew_w", "Transport rate at the last sample", "rad/s", (3,), "w"),
    Row("acceleration_w", "Acceleration over the Earth in the last sample", "m/s^2", (3,), "w"),
    Row("predict_due", "1 when the time update is due"),
    Row("since_fix", "Time since the epoch of the last fix", "s", start=1e9),
)) + lever_arm.MEMORY + rows.FIX_REPORTED  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The stated start; frame w is NED there."""
    navigation = strapdown.start_state(p)
    return {
        **navigation,
        "since_propagation_q_wb": navigation["q_wb"],
        "gyro_bias": p.start_gyro_bias,
        "accel_bias": p.start_accel_bias,
        "covariance": symmetric.triangle(start_covariance(p, navigation["q_wb"])),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: mechanization with the estimated quaternion and biases, and integrals over the interval."""
    delta_angle = u.delta_angle - x.gyro_bias * u.dt
    delta_velocity = u.delta_velocity - x.accel_bias * u.dt
    moved = strapdown.move(x, delta_angle, delta_velocity, u.dt)
    rotation, increment = compensated(x, delta_angle, delta_velocity)
    C = attitude.to_dcm(x.since_propagation_turn)
    turn = attitude.renormalize(attitude.multiply(x.since_propagation_turn, attitude.from_small_rotation_vector(rotation)))
    gained = C @ increment
    since_propagation = x.since_propagation + u.dt
    due = ca.logic_or(since_propagation + u.dt / 2 > p.filter_interval, ca.logic_or(u.gnss_valid, u.standing))
    return {
        **moved.rows,
        "dt": u.dt,
        "since_fix": x.since_fix + u.dt,
        "since_propagation": since_propagation,
        "since_propagation_turn": turn,
        "since_propagation_velocity": x.since_propagation_velocity + gained,
        "since_propagation_distance": x.since_propagation_distance + (x.since_propagation_velocity + gained / 2) * u.dt,
        "since_propagation_C": x.since_propagation_C + (C + attitude.to_dcm(turn)) * (u.dt / 2),
        "omega_ie_w": moved.omega_ie_w,
        "omega_ew_w": moved.omega_ew_w,
        "acceleration_w": (moved.rows["velocity_w"] - x.velocity_w) / u.dt,
        **lever_arm.followed(x, delta_angle / u.dt, u.dt, x.samples == 0),
        "predict_due": select(due, 1.0, 0.0),
    }


def predicted(p: Any, x: Any, spread: Spread) -> dict[str, Any]:
    """State rows of a time update over the samples since the last one, without those of `SINCE_PROPAGATION`."""
    P = symmetric.full(x.covariance, N)
    part = spread(x.since_propagation_q_wb, P[DQ, DQ], x.since_propagation_velocity, x.since_propagation_distance)
    Phi = transition(p, x, part)
    gyro_decay, accel_decay = decays(p, x.since_propagation)
    moved = attitude.rotate(x.since_propagation_q_wb, x.since_propagation_velocity) + ca.vertcat(
        0, 0, geodesy.NOMINAL_GRAVITY * x.since_propagation
    )
    motion = variances(p, attitude.to_rotation_vector(x.since_propagation_turn), moved)
    P = Phi @ P @ Phi.T + process_noise(p, x.since_propagation, x.q_wb, motion)
    moving = [*range(N)[VELOCITY], *range(N)[POSITION]]
    P[moving, moving] = P[moving, moving] + part.extra
    return {
        **strapdown.moved_back(x, part.mean[3:])[1],
        "velocity_w": x.velocity_w - part.mean[:3],
        "gyro_bias": gyro_decay * x.gyro_bias,
        "accel_bias": accel_decay * x.accel_bias,
        "covariance": symmetric.triangle(P),
    }


def linearised(q_hat: Any, P: Any, velocity: Any, distance: Any) -> Nonlinear:
    """The nonlinear part by its derivative at the estimate."""
    G = ca.vertcat(sensitivity(q_hat, velocity), sensitivity(q_hat, distance))
    return Nonlinear(G, ca.SX.zeros(6), ca.SX(6, 6), attitude.to_dcm(q_hat))


def unscented(q_hat: Any, P: Any, velocity: Any, distance: Any) -> Nonlinear:
    """The nonlinear part by sigma points in dQ, each normalised."""
    axes = U(q_hat) @ basis(velocity)  # 4x3: dQ of rotations about the body's axes, up to a factor
    L, inverse = cholesky(axes.T @ P @ axes)
    C_hat = attitude.to_dcm(q_hat)

    def error(dQ: Any) -> tuple[Any, Any]:
        C = attitude.to_dcm(attitude.normalize(q_hat - dQ))
        return ca.vertcat((C_hat - C) @ velocity, (C_hat - C) @ distance), C

    first, ahead, extra, mean, C_mean = [], [], ca.SX(6, 6), ca.SX.zeros(6), C_hat
    for i in range(3):
        point = _ROOT * axes @ L[:, i]
        (plus, C_plus), (minus, C_minus) = error(point), error(-point)
        ahead.append(plus)
        first.append((plus - minus) / (2 * _ROOT))
        second = plus + minus  # that of the centre is 0
        mean = mean + second / (2 * SPREAD)
        C_mean = C_mean + (C_plus + C_minus - 2 * C_hat) / (2 * SPREAD)
        extra = extra + (SPREAD - 1) / (4 * SPREAD**2) * (second @ second.T)
    # products of two errors: a tilt seen from an unknown heading
    for i, j in ((0, 1), (0, 2), (1, 2)):
        both = error(_ROOT * axes @ (L[:, i] + L[:, j]))[0]
        product = (both - ahead[i] - ahead[j]) / SPREAD
        extra = extra + product @ product.T
    # regression G L = [first]: back substitution
    G: list[Any] = [None] * 3
    for j in reversed(range(3)):
        G[j] = (first[j] - sum((G[k] * L[k, j] for k in range(j + 1, 3)), ca.SX.zeros(6))) * inverse[j]
    return Nonlinear(ca.horzcat(*G) @ axes.T, mean, extra, C_mean)


def cholesky(P: Any) -> tuple[Any, list[Any]]:
    """Lower factor (n x n) of a positive semidefinite matrix, and the inverses of its diagonal (0 for a zero pivot)."""
    n = P.shape[0]
    L, inverse = ca.SX(n, n), []
    for j in range(n):
        pivot = P[j, j] - ca.sumsqr(L[j, :j]) if j else P[j, j]
        regular = pivot > 1e-12 * P[j, j]
        inverse.append(select(regular, 1 / ca.sqrt(select(regular, pivot, 1.0)), 0.0))
        for i in range(j, n):
            L[i, j] = (P[i, j] - (L[i, :j] @ L[j, :j].T if j else 0)) * inverse[j]
    return L, inverse


def basis(direction: Any) -> Any:
    """Orthonormal axes (3x3, columns), the last along `direction`; without branches.

    Duff et al., "Building an orthonormal basis, revisited", J. Computer Graphics Techniques 6 (2017).
    """
    direction = direction + ca.vertcat(0, 0, 1e-9)
    x, y, z = ca.vertsplit(direction / ca.sqrt(ca.sumsqr(direction)))
    sign = select(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return ca.horzcat(
        ca.vertcat(1 + sign * x * x * a, sign * b, -sign * x), ca.vertcat(b, sign + y * y * a, -y), ca.vertcat(x, y, z)
    )


def fix_sensitivity(p: Any, x: Any, age: Any, antenna: gnss_fix.Antenna) -> Any:
    """Derivative (6x16) of the antenna's position and velocity in w with respect to the error state."""
    q, C_wb = x.q_wb, antenna.C_wb
    arm_by_rate, swing_by_rate = lever_arm.by_rate(antenna.rate_b, p.antenna_lever_arm, age)
    force_b = C_wb.T @ antenna.specific_force_w
    H = ca.SX(6, N)
    H[:3, POSITION] = H[3:, VELOCITY] = ca.SX.eye(3)
    H[:3, VELOCITY] = -age * ca.SX.eye(3)
    H[:3, DQ] = sensitivity(q, antenna.arm_b + force_b * (age**2 / 2))
    H[3:, DQ] = sensitivity(q, antenna.swing_b - force_b * age)
    H[:3, GYRO] = C_wb @ arm_by_rate
    H[3:, GYRO] = C_wb @ swing_by_rate
    H[:3, ACCEL] = C_wb * (age**2 / 2)
    H[3:, ACCEL] = -C_wb * age
    return H


def gnss(p: Any, x: Any, u: Any, form: Form) -> dict[str, Any]:
    """One fix, position and, where it has one, velocity, component by component in n, with feedback."""
    antenna = gnss_fix.antenna(p, x, u.gnss_age)
    C_nw = strapdown.C_nw(x.q_ew)
    innovation = gnss_fix.innovation(x, u, antenna)
    H = ca.diagcat(C_nw, C_nw) @ fix_sensitivity(p, x, u.gnss_age, antenna)
    present = gnss_fix.present(u)
    changed, test_ratio = fused(x, innovation, H, form.fix_variance(p, x, u, antenna), present, partial(form.turn, p))
    return {
        **changed,
        **lever_arm.lagged(u.gnss_age),
        **gnss_fix.counted(x, present, present, test_ratio),  # there is no gate
        "innovation": innovation * present,
        "test_ratio": test_ratio,
        "since_fix": form.since_fix(u.gnss_age),
    }


def zero_velocity(p: Any, x: Any, u: Any, form: Form) -> dict[str, Any]:
    """The vehicle is known to be at rest: its velocity is zero within `standing_sigma`."""
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    return fused(x, x.velocity_w, H, ca.repmat(p.standing_sigma**2, 3, 1), [1, 1, 1], partial(form.turn, p))[0]


def receiver_variance(p: Any, x: Any, u: Any, antenna: gnss_fix.Antenna) -> Any:
    """Variances (6) of position and velocity of a fix, as the receiver states them."""
    return ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma) ** 2


def fix_variance(p: Any, x: Any, u: Any, antenna: gnss_fix.Antenna) -> Any:
    """`receiver_variance`, what the sensitivity to dQ omits, and what the error shares with that of the last fix."""
    P = symmetric.full(x.covariance, N)[DQ, DQ]
    variance = receiver_variance(p, x, u, antenna) + _curvature(p, antenna, P)
    since = maximum(x.since_fix - u.gnss_age, 0.0)  # between the epochs of the two fixes
    return variance + gnss_fix.correlated_variance(p, since)


def _curvature(p: Any, antenna: gnss_fix.Antenna, P: Any) -> Any:
    """Variances (6) of what the linear sensitivity to dQ omits of the lever arm's rotation.

    For normal dQ with covariance P (4x4): |Y^T(dQ) U(dQ) a|^2 <= |dQ|^4 |a|^2.
    """
    fourth = ca.trace(P) ** 2 + 2 * ca.sumsqr(P)
    position, velocity = fourth * ca.sumsqr(p.antenna_lever_arm), fourth * ca.sumsqr(antenna.swing_b)
    return ca.vertcat(*[position] * 3, *[velocity] * 3)


@dataclass(frozen=True)
class Form:
    """What the filters of the error model differ in.

    spread: ``p -> Spread``, the nonlinear part of a time update.
    fix_variance: ``(p, x, u, antenna) -> (6)``, variances of position (m^2) and velocity (m^2/s^2) of a fix, n.
    turn: ``(p, q) -> (4)``, by which the errors turn where a correction turns the attitude by q.
    since_fix: row `since_fix` after a fix of some age (s).  parameters: further rows.
    """

    spread: Callable[[Any], Spread]
    fix_variance: Callable[[Any, Any, Any, gnss_fix.Antenna], Any] = fix_variance
    turn: Callable[[Any, Any], Any] = lambda p, q: q
    since_fix: Callable[[Any], Any] = lambda age: age
    parameters: Table = field(default_factory=Table)


def fused(
    x: Any, innovation: Any, H: Any, variance: Any, present: Any, turn: Callable[[Any], Any] = lambda q: q
) -> tuple[dict[str, Any], Any]:
    """State rows after the measurements `innovation` = H error + noise with feedback, and the test ratios.

    The measurements are processed one after another, those with `present` 1. turn: of the turn of the attitude, that
    of the errors.
    """
    P, correction, ratios = symmetric.full(x.covariance, N), ca.SX.zeros(N), []
    for i in range(H.shape[0]):
        P, correction, ratio = measure_joseph(P, correction, H[i, :], innovation[i], variance[i], present[i])
        ratios.append(ratio)
    q_wb = attitude.normalize(x.q_wb - correction[DQ])
    step = turn(attitude.multiply(q_wb, attitude.conjugate(x.q_wb)))
    C = attitude.to_dcm(step)
    P = turned(P, ((DQ, left(step)), (VELOCITY, C), (POSITION, C)))
    changed = {
        **strapdown.moved_back(x, correction[POSITION])[1],
        "velocity_w": x.velocity_w - correction[VELOCITY],
        **rows.at_start(SINCE_PROPAGATION),
        "since_propagation_q_wb": q_wb,
        "q_wb": q_wb,
        "gyro_bias": x.gyro_bias + correction[GYRO],
        "accel_bias": x.accel_bias + correction[ACCEL],
        "covariance": symmetric.triangle(P),
    }
    return changed, ca.vertcat(*ratios)


def output(p: Any, x: Any, spread: Spread) -> dict[str, Any]:
    """Navigation in n, and standard deviations; the misalignment about n is 2 Y^T(Q_hat) dQ to first order."""
    x = Values(**{**vars(x), **predicted(p, x, spread)})  # what the filter knows between two time updates
    C_nw = strapdown.C_nw(x.q_ew)
    P = symmetric.full(x.covariance, N)
    tilt = 2 * C_nw @ Y(x.q_wb).T

    def sigma(matrix: Any, part: slice, common: Any = 0.0) -> Any:
        return ca.sqrt(ca.diag(matrix @ P[part, part] @ matrix.T) + common)

    return {
        **strapdown.navigation_outputs(x),
        "position_sigma": sigma(C_nw, POSITION, p.fix_common_sigma**2),
        "velocity_sigma": sigma(C_nw, VELOCITY),
        "attitude_sigma": sigma(tilt, DQ),
        **rows.values_of(x, (rows.BIASES + rows.FIX_REPORTED).names),
    }


def consistency_error(x: Values, outputs: Values, truth: Values) -> tuple[Any, Any]:
    """Errors of velocity, position and attitude (2 Y^T dQ, (9)), and their covariance (9x9)."""
    offset, velocity, turn, theta = strapdown.navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, N)
    tilt = ca.horzcat(2 * Y(x.q_wb).T, ca.SX(3, N - 4))
    level = ca.horzcat(ca.SX(6, N - 6), ca.SX.eye(6))  # the last six states: velocity, position
    selected = ca.vertcat(level, tilt)
    return ca.vertcat(velocity, offset, turn - theta), selected @ P @ selected.T


def estimator(id: str, title: str, form: Form, applicability: Notes) -> Estimator:
    """A filter of the error model."""

    def predict(p: Any, x: Any, u: Any) -> dict[str, Any]:
        return {**predicted(p, x, form.spread(p)), **rows.at_start(SINCE_PROPAGATION), "since_propagation_q_wb": x.q_wb}

    model = Model(
        id=id,
        title=title,
        parameters=PARAMETERS + form.parameters,
        state=STATE,
        inputs=rows.SAMPLE_INPUTS + rows.FIX_INPUTS + rows.STANDING_INPUT,
        outputs=rows.AIDED_OUTPUTS,
        steps={
            "sample": Step(sample),
            "predict": Step(predict, when="predict_due"),
            "gnss": Step(lambda p, x, u: gnss(p, x, u, form), when="gnss_valid"),
            "zero_velocity": Step(lambda p, x, u: zero_velocity(p, x, u, form), when="standing"),
        },
        output=lambda p, x: output(p, x, form.spread(p)),
        start=start,
    )
    return Estimator(
        model,
        kind="navigation",
        sensors=("gnss",),
        error=consistency_error,
        applicability=applicability,
        max_measurement_age_s=gnss_fix.OLDEST,
    )


BOTH = together(unseen_heading, unmodelled_motion)
TITLE = "large misalignment: additive quaternion error"
ESTIMATORS = (
    estimator(
        "aqe-ekf",
        f"{TITLE}, extended Kalman filter",
        Form(lambda p: linearised),
        together(linear_start, unmodelled_motion),
    ),
    estimator("aqe-sukf", f"{TITLE}, simplified unscented Kalman filter", Form(lambda p: unscented), BOTH),
)
