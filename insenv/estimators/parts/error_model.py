"""The 15-state error model of inertial navigation in the wander-azimuth frame.

States: position error (m, w), velocity error (m/s, w), misalignment psi (rad, w), gyro bias (rad/s, b), accelerometer
bias (m/s^2, b): the errors of position and velocity are estimate minus truth, psi is the rotation from the computed
frame (w at the computed position) to the platform, C_hat_wb = (I - [psi x]) C_wb, and the biases are what is still left
in the measured rates:

    d(dr)/dt   = dv - omega_ew x dr
    d(dv)/dt   = f x psi + C_wb b_a - (2 omega_ie + omega_ew) x dv + g / R G dr
    d(psi)/dt  = -(omega_ie + omega_ew) x psi - C_wb b_g
    d(b)/dt    = -b / T

G has the diagonal -1, -1, 2 of a sphere's gravity and, between the vertical and the horizontal, the change of normal gravity
with latitude, -k a_z a_xy with the Earth's axis a and k = `geodesy.GRAVITY_CHANGE`; the field is conservative, so G is
symmetric. That change is as large as the Coriolis acceleration of the velocity errors that come with a position error. A
filter whose height is held by a barometer observes the latter, and without the former it is several times too sure of its
position after some hours.

Source: the psi-angle model, Benson, "A comparison of two approaches to pure-inertial and Doppler-inertial error
analysis", IEEE Trans. AES-11 (1975); Groves (2013), section 14.2. First-order Gauss-Markov biases as in the airborne
paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.base.remarks import Remark, declared
from insenv.core import symmetric
from insenv.core.elementary import maximum, select, sin_cos
from insenv.estimators.parts.kalman import Update
from insenv.geodesy import GRAVITY_CHANGE, MEAN_RADIUS, OMEGA_IE

N = 15
POSITION, VELOCITY, TILT, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, N, 3))


@dataclass(frozen=True)
class Interval:
    """An interval of motion as the error model needs it; it may be many samples long.

    duration: s. delta_velocity_w: integral of the specific force in w (3, m/s).
    omega_ie_w, omega_ew_w: Earth and transport rate (3, rad/s).
    """

    duration: Any
    delta_velocity_w: Any
    omega_ie_w: Any
    omega_ew_w: Any


def navigation_transition(interval: Interval, gravity: Any) -> Any:
    """A (9x9) of position, velocity and attitude: integral of F over the interval; gravity in m/s^2."""
    A, dt = ca.SX(9, 9), interval.duration
    A[POSITION, POSITION] = -skew(interval.omega_ew_w) * dt
    A[POSITION, VELOCITY] = ca.SX.eye(3) * dt
    A[VELOCITY, POSITION] = ca.diag(ca.vertcat(-1, -1, 2)) * (gravity / MEAN_RADIUS * dt)
    axis_w = interval.omega_ie_w / OMEGA_IE
    A[3:5, 2] = -GRAVITY_CHANGE * axis_w[2] * axis_w[:2] * (gravity / MEAN_RADIUS * dt)
    A[5, :2] = A[3:5, 2].T
    A[VELOCITY, VELOCITY] = -skew(2 * interval.omega_ie_w + interval.omega_ew_w) * dt
    A[VELOCITY, TILT] = skew(interval.delta_velocity_w)
    A[TILT, TILT] = -skew(interval.omega_ie_w + interval.omega_ew_w) * dt
    return A


# The errors of velocity and attitude as one error of a group: a correction turns both.
#
# A correction turns the platform by psi.  An error that has not been measured, above all the heading of a vehicle at rest, is
# one about the vertical of the platform.  The errors of velocity and attitude (w) therefore turn with the platform, and their
# covariance with them:
#
#     e <- T e,   P <- T P T^T,   T = 1 but for the blocks C of velocity and attitude,   C = exp([psi x])
#
# Without that turn a pure heading error acquires a component of velocity: the next measurement of velocity then seems to
# measure the heading, and its stated sigma falls without information.  With it, velocity and attitude have the left-invariant
# error R^T (v^ - v), R^T R^ in other axes, to first order.  The error of position does not turn: it is known up to errors that
# do not turn, those of receiver and barometer, and turning it alone would count as a measurement of it.
#
# Sources: Barrau and Bonnabel (2017), "The invariant extended Kalman filter as a stable observer", IEEE Trans. Automatic
# Control 62, 1797-1812; biases make the filter an imperfect one, for which convergence is not proved.

TURNING = (VELOCITY, TILT)
"""The parts of the error that turn."""


def turned(matrix: Any, turns: Sequence[tuple[slice, Any]]) -> Any:
    """T M T^T for a matrix (n x n) over the error, T = 1 but for the blocks `turns`: a part of the error and its turn."""
    for part, turn in turns:
        matrix[part, :] = turn @ matrix[part, :]
    for part, turn in turns:
        matrix[:, part] = matrix[:, part] @ turn.T
    return matrix


def with_platform(turn: Any) -> tuple[tuple[slice, Any], ...]:
    """The blocks of T; turn: C (3x3), or its transpose for the way back."""
    return tuple((part, turn) for part in TURNING)


def turn_of(psi: Any) -> Any:
    """C (3x3) of a correction psi (3, rad, w)."""
    return attitude.to_dcm(attitude.from_rotation_vector(psi))


def covariance_after(update: Update, n: int, share: Any = 1.0) -> Any:
    """Covariance triangle of n errors after an update whose correction has been taken out of the state.

    share: 1; 0 leaves the covariance as the conventional Kalman filter of small angles does.
    """
    turn = turn_of(update.correction[TILT] * share)
    return symmetric.triangle(turned(symmetric.full(update.stored, n), with_platform(turn)))


def adjoint_before(adjoint: Any, psi: Any) -> Any:
    """T^T s for the adjoint s (n) of the error after a correction psi."""
    before = ca.SX(adjoint)
    for part in TURNING:
        before[part] = turn_of(psi).T @ adjoint[part]
    return before


# From a coarse alignment in place to an error-state filter: the covariance of attitude and sensor biases.
#
# The effect of biases on an alignment in place does not average out, so its attitude errors are correlated with the biases. In
# place, with the misalignment phi and the remaining biases (b, in n) as in (12) and (22) of the ECEF fine-alignment paper, the
# specific force and the Earth's rotation balance at
#
#     phi_N = b_aE / g,   phi_E = -b_aN / g,   phi_D = b_gE / (omega_ie cos L) - phi_N tan L
#
# A filter that starts without these correlations treats the attitude as an independent measurement: its sigmas are too small.

LEAST_VARIANCE = 1e-12  # rad^2


@dataclass(frozen=True)
class Aligned:
    """Covariances after an alignment in place: of phi (3x3, rad^2), and of phi with the biases (3x3 each), in n."""

    tilt: Any
    tilt_accel: Any
    tilt_gyro: Any


def aligned(sigma: Any, latitude: Any, gravity: Any, gyro_bias_sigma: Any, accel_bias_sigma: Any) -> Aligned:
    """Covariances of an alignment that states `sigma` (3, rad, about n); biases SI, latitude rad, gravity m/s^2.

    What `sigma` has beyond the effect of the biases is noise, independent in the three axes.
    """
    s, c = sin_cos(latitude)
    c = maximum(c, 1e-6)
    by_accel, by_gyro = ca.SX(3, 3), ca.SX(3, 3)
    by_accel[0, 1], by_accel[1, 0], by_accel[2, 1] = 1 / gravity, -1 / gravity, -s / (c * gravity)
    by_gyro[2, 1] = 1 / (geodesy.OMEGA_IE * c)
    tilt_accel, tilt_gyro = by_accel * accel_bias_sigma**2, by_gyro * gyro_bias_sigma**2
    biases = tilt_accel @ by_accel.T + tilt_gyro @ by_gyro.T
    noise = maximum(sigma**2 - ca.diag(biases), LEAST_VARIANCE)
    return Aligned(biases + ca.diag(noise), tilt_accel, tilt_gyro)


# The error of a start gyro bias that was measured at rest; it is correlated with that of the start attitude.
#
# At rest a gyro measures its bias and the Earth's rate. The bias is the mean rate minus the Earth's rate in the start attitude,
# so an error of that attitude leaves a part of the Earth's rate in the bias. With psi as above (the computed attitude is
# I - [psi x] times the true one) the remaining bias, true minus estimated, is
#
#     C_bn (psi x w_ie)
#
# times the share of the bias that was measured at rest. The two errors cancel in the rate of the attitude, so a later
# correction of the heading corrects the bias too.


def bias_of_tilt(p: Any) -> Any:
    """Derivative (3x3) of the remaining start gyro bias (rad/s, b) with respect to psi (rad, n)."""
    C_bn = attitude.to_dcm(attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading)).T
    return -p.start_rest_share * (C_bn @ attitude.skew(geodesy.earth_rate_n(p.start_latitude)))


def bias_sigma(p: Any) -> Any:
    """Standard deviation (rad/s) of the start gyro bias for the start attitude."""
    return select(p.start_gyro_bias_error > 0, p.start_gyro_bias_error, p.gyro_bias_sigma)


# Errors of the unit that are proportional to the motion, as process noise of a filter without states for them.
#
# Scale factors and misalignments are constant: their effect accumulates in a manoeuvre and reverses in the next one. As noise
# they are white over manoeuvres of the sizes below.

COHERENT_ANGLE = 1.0  # rad
COHERENT_SPEED = 10.0  # m/s
ROUNDED = 0.9
"""Part of the unit's value down to which a value set by hand counts as the same."""


_UNDERSTATED = declared(
    "motion-errors-understated",
    "{name} = {set:.2g} mrad is set, that of the unit is {unit:.2g} mrad: in and after manoeuvres the stated sigmas are too "
    "small",
)


def understated(unit: Mapping[str, Any], tuned: Mapping[str, Any]) -> tuple[Remark, ...]:
    """Sentences about errors that are set smaller than the unit's: the filter then states too small sigmas in motion.

    unit, tuned: parameters (by row name) as the data sheet of the unit gives them, and as they are set.
    """
    return tuple(
        _UNDERSTATED.filled(name=name, set=1000 * float(tuned[name]), unit=1000 * float(unit[name]))
        for name in ("rotation_error", "thrust_error")
        if name in tuned and name in unit and float(tuned[name]) < ROUNDED * float(unit[name])
    )


def variances(p: Any, rotation: Any, change: Any) -> tuple[Any, Any]:
    """Variances to add to each attitude (rad^2) and velocity (m^2/s^2) error over an interval.

    p: rows of `rows.MOTION_ERRORS`. rotation (3, rad), change (3, m/s): of attitude and velocity in the interval.
    """
    turned, pushed = ca.sqrt(ca.sumsqr(rotation)), ca.sqrt(ca.sumsqr(change))
    return p.rotation_error**2 * COHERENT_ANGLE * turned, p.thrust_error**2 * COHERENT_SPEED * pushed


# What the linear model omits where the gyros lose a heading soon.


def by_unknown_drift(P: Any, down_b: Any, psi: slice, gyro: slice) -> Any:
    """Rates (3, rad^2/s) of the variances of the attitude errors by a drift about down (3, b) that is not known.

    P: upper triangle of the covariance.  psi, gyro: places of the attitude error and of the gyro biases in it.

    The filter's axes turn with that drift, and with them a level error and the accelerometer bias that hides it.  To first
    order the bias alone turns there, so a turn that never was would seem to tell one from the other.  A constant drift b turns
    the level by b t; as a random walk of the same size at t = 1 / b it hides that turn at all times before.
    """
    drift = ca.dot(down_b, symmetric.block(P, gyro) @ down_b)
    level = (P[symmetric.place(psi.start, psi.start)] + P[symmetric.place(psi.start + 1, psi.start + 1)]) / 2
    return ca.sqrt(maximum(drift, 0.0)) * level * ca.vertcat(1, 1, 0)
