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

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.attitude import skew
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
