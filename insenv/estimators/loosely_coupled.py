"""`loosely-coupled`: strapdown navigation with GNSS positions and velocities, a 15-state filter with full feedback.

Source: the airborne-navigation paper's GPS/SINS filter (15 states, first-order Gauss-Markov drift and bias), with the
wander-azimuth mechanization of `insenv.estimators.parts.strapdown` and the psi-angle error model of
`insenv.estimators.parts.error_model`. A fix is used at its own time (`insenv.estimators.parts.gnss_fix`).

The mechanization runs at every sample. The covariance is propagated once `covariance_interval` has passed or a
measurement comes; the integrals of specific force and attitude over that interval are kept, so no motion is lost.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, gnss_fix, lever_arm, motion_errors, rows, standing, strapdown
from insenv.estimators.parts.error_model import ACCEL, GYRO, POSITION, TILT, VELOCITY, Interval, N, transition
from insenv.estimators.parts.gauss_markov import decays, driven_variance
from insenv.estimators.parts.invariant import covariance_after
from insenv.estimators.parts.kalman import Scalar, Update, innovation_variance, measure, propagate
from insenv.estimators.parts.rest_bias import bias_of_tilt, bias_sigma

PATIENCE = 10  # fixes rejected in a row before the gate opens

PARAMETERS = (
    rows.AIDED_PARAMETERS
    + Table((
        Row("covariance_interval", "Longest interval between covariance propagations", "s", start=0.05, lower=0, upper=1),
        Row("innovation_gate", "Innovations beyond this many standard deviations are rejected; 0: none is",
            start=5.0, lower=0, upper=1e12),
    ))
    + standing.PARAMETERS
    + rows.FIX_WANDER
    + rows.MOTION_ERRORS
)  # fmt: skip
OWN_PARAMETERS = PARAMETERS + Table((
    Row("covariance_kept", "1: feedback leaves the covariance as it is, the conventional filter of small angles", lower=0,
        upper=1, flag=True),
))  # fmt: skip
"""Those of this filter; the smoother has `PARAMETERS`."""

STATE = (
    strapdown.STATE
    + rows.BIASES
    + Table((
        Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
        Row("dt", "Interval of the last sample", "s", start=1.0),
        Row("stretch", "Time since the covariance was propagated", "s"),
        Row("stretch_velocity_w", "Integral of the specific force over that time", "m/s", (3,), "w"),
        Row("stretch_C_wb", "Integral of the attitude matrix over that time", "s", (3, 3), "w"),
        Row("omega_ie_w", "Earth rate at the last sample", "rad/s", (3,), "w"),
        Row("omega_ew_w", "Transport rate at the last sample", "rad/s", (3,), "w"),
        Row("covariance_due", "1 when the covariance is to be propagated"),
        Row("stretch_angle", "Rotation over that time", "rad", (3,), "b"),
        Row("stretch_change_w", "Change of velocity over that time", "m/s", (3,), "w"),
    ))
    + standing.STATE
    + rows.SINCE_FIX
    + Table((
        Row("acceleration_w", "Acceleration over the Earth in the last sample", "m/s^2", (3,), "w"),
    ))
    + lever_arm.MEMORY
    + rows.FIX_RESIDUALS
    + rows.FIX_HEALTH
    + Table((
        Row("rejected", "Scalar measurements rejected by the gate", "1"),
        Row("refusals", "Fixes in a row with an innovation beyond the gate", "1"),
    ))
)  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The given start; frame w is NED there, so the covariance needs no rotation."""
    sigma = ca.vertcat(
        p.position_sigma,
        p.velocity_sigma,
        p.tilt_sigma,
        p.tilt_sigma,
        p.heading_sigma,
        ca.repmat(bias_sigma(p), 3, 1),
        ca.repmat(p.accel_bias_sigma, 3, 1),
    )
    P = ca.diag(sigma * sigma)
    shared = bias_of_tilt(p) @ P[TILT, TILT]
    P[GYRO, TILT], P[TILT, GYRO] = shared, shared.T
    P[GYRO, GYRO] = P[GYRO, GYRO] + shared @ bias_of_tilt(p).T
    return {
        **strapdown.start_state(p),
        "gyro_bias": p.start_gyro_bias,
        "accel_bias": p.start_accel_bias,
        "covariance": symmetric.triangle(P),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: mechanization with the estimated biases subtracted."""
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
        **lever_arm.followed(x, delta_angle * (1 / u.dt), u.dt, x.samples == 0),
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance and the biases over the samples since the last time."""
    interval = Interval(x.stretch, x.stretch_velocity_w, x.stretch_C_wb, x.omega_ie_w, x.omega_ew_w)
    A = transition(interval, geodesy.NOMINAL_GRAVITY, p.gyro_correlation_time, p.accel_correlation_time)
    gyro_decay, accel_decay = decays(p, x.stretch)
    by_rotation, by_thrust = motion_errors.variances(p, x.stretch_angle, x.stretch_change_w)
    noise = ca.vertcat(
        ca.SX.zeros(3),
        ca.repmat(p.velocity_random_walk**2 * x.stretch + by_thrust, 3, 1),
        ca.repmat(p.angle_random_walk**2 * x.stretch + by_rotation, 3, 1),
        ca.repmat(driven_variance(p.gyro_bias_sigma, gyro_decay), 3, 1),
        ca.repmat(driven_variance(p.accel_bias_sigma, accel_decay), 3, 1),
    )
    return {
        "gyro_bias": gyro_decay * x.gyro_bias,
        "accel_bias": accel_decay * x.accel_bias,
        "covariance": propagate(x.covariance, A, noise),
        "stretch": 0,
        "stretch_angle": ca.SX.zeros(3),
        "stretch_change_w": ca.SX.zeros(3),
        "stretch_velocity_w": ca.SX.zeros(3),
        "stretch_C_wb": ca.SX.zeros(3, 3),
    }


def fix_sensitivity(p: Any, age: Any, antenna: gnss_fix.Antenna) -> Any:
    """Derivative (6x15) of the antenna's position and velocity in w with respect to the error state."""
    C_wb = antenna.C_wb
    arm_by_rate, swing_by_rate = lever_arm.by_rate(antenna.rate_b, p.antenna_lever_arm, age)
    H = ca.SX(6, N)
    H[:3, POSITION] = H[3:, VELOCITY] = ca.SX.eye(3)
    H[:3, VELOCITY] = -age * ca.SX.eye(3)
    arm, swing, force = skew(C_wb @ antenna.arm_b), skew(C_wb @ antenna.swing_b), skew(antenna.specific_force_w)
    # the Earth's rate, seen from a tilted platform, is a rate of the lever arm
    seen = C_wb.T @ skew(antenna.earth_rate_w)
    H[:3, GYRO], H[3:, GYRO] = C_wb @ arm_by_rate, C_wb @ swing_by_rate
    H[:3, TILT] = arm + force * (age**2 / 2) + H[:3, GYRO] @ seen
    H[3:, TILT] = swing - force * age + H[3:, GYRO] @ seen
    H[:3, ACCEL], H[3:, ACCEL] = C_wb * (age**2 / 2), -C_wb * age
    return H


def gnss_update(p: Any, x: Any, u: Any) -> tuple[Update, dict[str, Any]]:
    """One fix, position and, where it has one, velocity, component by component in n, gated; and its state rows."""
    antenna = gnss_fix.antenna(p, x, u.gnss_age)
    C_nw = strapdown.C_nw(x.q_ew)
    innovation = gnss_fix.innovation(x, u, antenna)
    H = ca.diagcat(C_nw, C_nw) @ fix_sensitivity(p, u.gnss_age, antenna)
    variance = ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma) ** 2
    since = maximum(x.since_fix - u.gnss_age, 0.0)  # between the epochs of the two fixes
    inflated = variance + ca.vertcat(gnss_fix.correlated_variance(p, since), ca.SX.zeros(3))
    present = gnss_fix.present(u)

    stored, correction = x.covariance, ca.SX.zeros(N)
    # a filter that rejects fix after fix is itself wrong: the gate stays open until fixes and estimate agree again
    gated = select(x.refusals < PATIENCE, 1.0, 0.0)
    scalars, ratios, outside = [], [], ca.SX(0)
    for i in range(6):
        left = innovation[i] - H[i, :] @ correction
        ratio = present[i] * left / ca.sqrt(innovation_variance(stored, H[i, :], variance[i]))
        beyond = select(ca.logic_and(p.innovation_gate > 0, ca.fabs(ratio) > p.innovation_gate), 1.0, 0.0)
        accept = present[i] * (1 - gated * beyond)
        scalars.append(Scalar(stored, H[i, :], left, inflated[i], accept))
        stored, correction = measure(stored, correction, H[i, :], innovation[i], inflated[i], accept)
        ratios.append(ratio)
        outside = outside + beyond
    test_ratio = ca.vertcat(*ratios)
    reported = {
        **gnss_fix.counted(x, present, ca.vertcat(*[scalar.accept for scalar in scalars]), test_ratio),
        "innovation": innovation * present,
        "test_ratio": test_ratio,
        "rejected": x.rejected + gated * outside,
        "refusals": select(outside > 0, x.refusals + 1, 0),
        "since_fix": u.gnss_age,
        **lever_arm.lagged(u.gnss_age),
    }
    return Update(tuple(scalars), correction, stored), reported


def gnss(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix, with feedback."""
    update, reported = gnss_update(p, x, u)
    return {**corrected(x, update.correction), "covariance": covariance_after(update, N, 1.0 - p.covariance_kept), **reported}


def standing_update(p: Any, x: Any) -> Update:
    """The vehicle is at rest: its velocity is zero within `standing_sigma`."""
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
    return {**corrected(x, update.correction), "covariance": covariance_after(update, N, 1.0 - p.covariance_kept)}


def corrected(x: Any, correction: Any) -> dict[str, Any]:
    """State rows with an estimated error state (15) taken out."""
    return {
        **strapdown.corrected(x, correction[POSITION], correction[VELOCITY], correction[TILT]),
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
        **{row.name: getattr(x, row.name) for row in rows.FIX_RESIDUALS + rows.FIX_HEALTH},
    }


def consistency_error(x: Values, outputs: Values, truth: Values) -> tuple[Any, Any]:
    """Errors of position, velocity and psi, and their covariance (9x9)."""
    offset, velocity, turn, _ = strapdown.navigation_error_w(x, truth)
    P = symmetric.full(x.covariance, N)[:9, :9]
    return ca.vertcat(offset, velocity, -turn), P


MODEL = Model(
    id="loosely-coupled",
    title="GNSS/INS, 15 states, position and velocity of GNSS loosely coupled",
    parameters=OWN_PARAMETERS,
    state=STATE,
    inputs=rows.AIDED_INPUTS,
    outputs=rows.AIDED_OUTPUTS,
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

ESTIMATOR = Estimator(
    MODEL,
    kind="navigation",
    sensors=("gnss",),
    error=consistency_error,
    applicability=applicability.linear_start,
    caveats=applicability.together(applicability.unmodelled_motion, applicability.noiseless),
)
