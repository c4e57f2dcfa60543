"""`loosely-coupled`: strapdown navigation aided by GNSS positions and velocities, a 15-state Kalman filter with full feedback.

Source: the airborne-navigation paper's GPS/SINS filter (15 states, first-order Gauss-Markov drift and bias), with the
wander-azimuth mechanization of `insenv.estimators.parts.strapdown` and the psi-angle error model of
`insenv.estimators.parts.error_model`.

A GNSS fix is fused at its own time.  It comes with its age: the time from its validity to the end of the last inertial
sample, which need not be a whole number of samples.  The antenna's place and velocity at that time follow from the present
state and the present specific force, with the sensitivities that belong to them, so the fix may lie between two samples or
be late by some tenths of a second.

The mechanization runs at every sample, the covariance when `covariance_interval` has passed or a measurement comes: in
between the integrals of specific force and attitude are kept, so nothing of the motion is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import exp, select
from insenv.core.model import Model, Step, Values
from insenv.estimators.contract import Estimator
from insenv.estimators.loosely_coupled_tables import INPUTS, OUTPUTS, PARAMETERS, STATE
from insenv.estimators.parts import standing, strapdown
from insenv.estimators.parts.error_model import (
    ACCEL,
    GYRO,
    POSITION,
    TILT,
    VELOCITY,
    Interval,
    N,
    innovation_variance,
    measure,
    propagate,
    transition,
)
from insenv.estimators.parts.navigation_error import navigation_error_w

PATIENCE = 10  # fixes refused in a row before the gate opens
# errors proportional to the motion add up within a manoeuvre and come back with the next: as if white over such a one
COHERENT_ANGLE = 1.0  # rad
COHERENT_SPEED = 10.0  # m/s


def start(p: Any) -> dict[str, Any]:
    """The start as given; w is NED there, so the covariance needs no turning."""
    sigma = ca.vertcat(
        p.position_sigma,
        p.velocity_sigma,
        p.tilt_sigma,
        p.tilt_sigma,
        p.heading_sigma,
        ca.repmat(p.gyro_bias_sigma, 3, 1),
        ca.repmat(p.accel_bias_sigma, 3, 1),
    )
    return {
        **strapdown.start_state(p),
        "gyro_bias": p.start_gyro_bias,
        "accel_bias": p.start_accel_bias,
        "covariance": symmetric.triangle(ca.diag(sigma * sigma)),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: mechanization with the estimated biases taken off."""
    delta_angle = u.delta_angle - x.gyro_bias * u.dt
    delta_velocity = u.delta_velocity - x.accel_bias * u.dt
    moved = strapdown.move(x, delta_angle, delta_velocity, u.dt)
    stretch = x.stretch + u.dt
    change = moved.velocity_w - x.velocity_w
    seen = standing.watched(p, x, delta_angle, delta_velocity, change, u.dt)
    event = ca.logic_or(ca.logic_or(u.gnss_valid, u.standing), seen["still_due"])
    due = ca.logic_or(stretch + u.dt / 2 > p.covariance_interval, event)
    return {
        **strapdown.moved_rows(moved, x, delta_angle, delta_velocity),
        **seen,
        "standing_now": u.standing,
        "since_fix": x.since_fix + u.dt,
        "stretch_angle": x.stretch_angle + delta_angle,
        "stretch_change_w": x.stretch_change_w + change,
        "dt": u.dt,
        "stretch": stretch,
        "stretch_velocity_w": x.stretch_velocity_w + moved.delta_velocity_w,
        "stretch_C_wb": x.stretch_C_wb + moved.C_wb * u.dt,
        "omega_ie_w": moved.omega_ie_w,
        "omega_ew_w": moved.omega_ew_w,
        "covariance_due": select(due, 1.0, 0.0),
        "acceleration_w": change * (1 / u.dt),
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The covariance over the stretch of samples since the last time."""
    interval = Interval(x.stretch, x.stretch_velocity_w, x.stretch_C_wb, x.omega_ie_w, x.omega_ew_w)
    A = transition(interval, geodesy.NOMINAL_GRAVITY, p.gyro_correlation_time, p.accel_correlation_time)
    turned, pushed = ca.sqrt(ca.sumsqr(x.stretch_angle)), ca.sqrt(ca.sumsqr(x.stretch_change_w))
    noise = ca.vertcat(
        ca.SX.zeros(3),
        ca.repmat(p.velocity_random_walk**2 * x.stretch + p.thrust_error**2 * COHERENT_SPEED * pushed, 3, 1),
        ca.repmat(p.angle_random_walk**2 * x.stretch + p.rotation_error**2 * COHERENT_ANGLE * turned, 3, 1),
        ca.repmat(2 * p.gyro_bias_sigma**2 / p.gyro_correlation_time * x.stretch, 3, 1),
        ca.repmat(2 * p.accel_bias_sigma**2 / p.accel_correlation_time * x.stretch, 3, 1),
    )
    return {
        "covariance": propagate(x.covariance, A, noise),
        "stretch": 0,
        "stretch_angle": ca.SX.zeros(3),
        "stretch_change_w": ca.SX.zeros(3),
        "stretch_velocity_w": ca.SX.zeros(3),
        "stretch_C_wb": ca.SX.zeros(3, 3),
    }


def predicted_fix(p: Any, x: Any, age: Any) -> tuple[Any, Any, Any, Any]:
    """What an antenna would have shown `age` ago, and its sensitivities.

    Returns (offset_w, velocity_w, H_position, H_velocity): the antenna's place relative to the present one of the inertial unit
    (m, w), its velocity (m/s, w), and the derivatives (3x15) of the two with respect to the error state.
    """
    C_wb = attitude.to_dcm(x.q_wb)
    force = x.acceleration_w  # of the vehicle; gravity's part does not tilt with psi
    specific_force = x.acceleration_w - ca.vertcat(0, 0, geodesy.normal_gravity(-_down(x), x.height))
    rate_b = x.previous_delta_angle / x.dt
    arm = p.antenna_lever_arm
    arm_then = arm - age * ca.cross(rate_b, arm)  # the arm as it stood `age` ago, in present b components
    swing = ca.cross(rate_b, arm)
    offset = -x.velocity_w * age + force * (age**2 / 2) + C_wb @ arm_then
    velocity = x.velocity_w - force * age + C_wb @ swing
    H_position, H_velocity = ca.SX(3, N), ca.SX(3, N)
    H_position[:, POSITION] = ca.SX.eye(3)
    H_position[:, VELOCITY] = -age * ca.SX.eye(3)
    H_position[:, TILT] = skew(C_wb @ arm_then) + skew(specific_force) * (age**2 / 2)
    H_position[:, GYRO] = age * (C_wb @ skew(arm))
    H_position[:, ACCEL] = C_wb * (age**2 / 2)
    H_velocity[:, VELOCITY] = ca.SX.eye(3)
    H_velocity[:, TILT] = skew(C_wb @ swing) - skew(specific_force) * age
    H_velocity[:, GYRO] = -(C_wb @ skew(arm))
    H_velocity[:, ACCEL] = -C_wb * age
    return offset, velocity, H_position, H_velocity


@dataclass(frozen=True)
class Scalar:
    """One scalar measurement as it was used.

    stored: covariance triangle before it.  H: row (1x15).  left: innovation less what the scalars before it explained.
    variance: of its noise.  accept: 1 if it was used, 0 if not.
    """

    stored: Any
    H: Any
    left: Any
    variance: Any
    accept: Any


@dataclass(frozen=True)
class Update:
    """Scalars in the order used, the estimated error state (15), and the covariance triangle after them."""

    scalars: tuple[Scalar, ...]
    correction: Any
    stored: Any


def gnss_update(p: Any, x: Any, u: Any) -> tuple[Update, dict[str, Any]]:
    """One fix: position, and velocity if it has one, component by component in n, gated; and the rows that report it."""
    offset, velocity, H_position, H_velocity = predicted_fix(p, x, u.gnss_age)
    C_nw = strapdown.C_nw(x.q_ew)
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    measured = geodesy.ned_offset(u.gnss_latitude, u.gnss_longitude, u.gnss_height, latitude, longitude, x.height)
    innovation = ca.vertcat(C_nw @ offset - measured, C_nw @ velocity - u.gnss_velocity_n)
    H = ca.vertcat(C_nw @ H_position, C_nw @ H_velocity)
    variance = ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma) ** 2
    weighed = variance + ca.vertcat(repeated(p, x.since_fix), ca.SX.zeros(3))
    present = ca.vertcat(1, 1, 1, *[u.gnss_velocity_valid] * 3)

    stored, correction = x.covariance, ca.SX.zeros(N)
    # A filter that finds fix after fix wrong is itself wrong: then it must listen, until fixes and estimate agree again
    deaf = select(x.refusals < PATIENCE, 1.0, 0.0)
    scalars, ratios, outside = [], [], ca.SX(0)
    for i in range(6):
        left = innovation[i] - H[i, :] @ correction
        ratio = present[i] * left / ca.sqrt(innovation_variance(stored, H[i, :], variance[i]))
        beyond = select(ca.logic_and(p.innovation_gate > 0, ca.fabs(ratio) > p.innovation_gate), 1.0, 0.0)
        accept = present[i] * (1 - deaf * beyond)
        scalars.append(Scalar(stored, H[i, :], left, weighed[i], accept))
        stored, correction = measure(stored, correction, H[i, :], innovation[i], weighed[i], accept)
        ratios.append(ratio)
        outside = outside + beyond
    told = {
        "innovation": innovation * present,
        "test_ratio": ca.vertcat(*ratios),
        "rejected": x.rejected + deaf * outside,
        "refusals": select(outside > 0, x.refusals + 1, 0),
        "since_fix": u.gnss_age,
    }
    return Update(tuple(scalars), correction, stored), told


def repeated(p: Any, since: Any) -> Any:
    """Variance (3, m^2) that a fix's position takes on top, because its slow error is partly that of the fix `since` before.

    Of a constant, a first-order Gauss-Markov error of variance s^2 leaves the information 1 / s^2 at the first look and
    (1 - r) / (1 + r) / s^2 at each further one, r = exp(-since / time): as if its variance were s^2 (1 + r) / (1 - r).
    """
    r = exp(-since / p.fix_wander_time)
    return p.fix_wander_sigma**2 * (2 * r / (1 - r + 1e-12))


def gnss(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix, with feedback."""
    update, told = gnss_update(p, x, u)
    return {**corrected(x, update.correction), "covariance": update.stored, **told}


def standing_update(p: Any, x: Any) -> Update:
    """The vehicle stands: its velocity is zero within `standing_sigma`."""
    stored, correction = x.covariance, ca.SX.zeros(N)
    scalars = []
    for i in range(3):
        H = ca.SX(1, N)
        H[0, VELOCITY.start + i] = 1
        scalars.append(Scalar(stored, H, x.velocity_w[i] - H @ correction, p.standing_sigma**2, 1))
        stored, correction = measure(stored, correction, H, x.velocity_w[i], p.standing_sigma**2, 1)
    return Update(tuple(scalars), correction, stored)


def zero_velocity(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Zero velocity, with feedback."""
    update = standing_update(p, x)
    return {**corrected(x, update.correction), "covariance": update.stored}


def corrected(x: Any, correction: Any) -> dict[str, Any]:
    """State rows with an estimated error state (15) taken out."""
    dr, dv, psi = correction[POSITION], correction[VELOCITY], correction[TILT]
    # moving the position turns the computed frame by -theta; platform and velocity are then referred to the new one
    theta = geodesy.transport_rate_w(dr, x.q_ew, x.height)
    velocity = x.velocity_w - dv
    return {
        "q_wb": attitude.normalize(attitude.multiply(attitude.from_rotation_vector(psi + theta), x.q_wb)),
        "velocity_w": velocity + ca.cross(theta, velocity),
        "q_ew": attitude.normalize(attitude.multiply(x.q_ew, attitude.from_rotation_vector(-theta))),
        "height": x.height + dr[2],
        "gyro_bias": x.gyro_bias + correction[GYRO],
        "accel_bias": x.accel_bias + correction[ACCEL],
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Navigation in n, and standard deviations; psi stands for the misalignment (they differ by position error / R)."""
    C_nw = strapdown.C_nw(x.q_ew)
    P = symmetric.full(x.covariance, N)

    def sigma(part: slice) -> Any:
        return ca.sqrt(ca.diag(C_nw @ P[part, part] @ C_nw.T))

    return {
        **strapdown.navigation_outputs(x),
        "gyro_bias": x.gyro_bias,
        "accel_bias": x.accel_bias,
        "position_sigma": sigma(POSITION),
        "velocity_sigma": sigma(VELOCITY),
        "attitude_sigma": sigma(TILT),
        "innovation": x.innovation,
        "test_ratio": x.test_ratio,
    }


def _down(x: Any) -> Any:
    """Component of the Earth's axis along Down: minus the sine of the latitude."""
    return geodesy.earth_rate_w(x.q_ew)[2] / geodesy.OMEGA_IE


MODEL = Model(
    id="loosely-coupled",
    title="GNSS/INS, 15 states, position and velocity of GNSS loosely coupled",
    parameters=PARAMETERS,
    state=STATE,
    inputs=INPUTS,
    outputs=OUTPUTS,
    steps={
        "sample": Step(sample),
        "still": Step(standing.found, when="still_due"),
        "covariance": Step(covariance, when="covariance_due"),
        "gnss": Step(gnss, when="gnss_valid"),
        "zero_velocity": Step(zero_velocity, when="standing_now"),
    },
    output=output,
    start=start,
)


def consistency_error(x: Values, outputs: Values, truth: Values) -> tuple[Any, Any]:
    """Position, velocity and psi (9) of the estimate, and their covariance."""
    offset, velocity, turn, _ = navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, N)[:9, :9]
    return ca.vertcat(offset, velocity, -turn), P


ESTIMATOR = Estimator(MODEL, kind="navigation", sensors=("gnss",), error=consistency_error)
