"""The linearised error equations of a strapdown mechanization in Earth axes, over steps of a trajectory.

Errors are estimate minus truth, C_est = (I + [psi x]) C_eb, all in Earth axes e:

    psi' = -Omega x psi + C eps_g
    dv'  = -f x psi - 2 Omega x dv + Gamma dr + C eps_a
    dr'  = dv

Gamma is the gradient of gravity (with the centrifugal part, as in normal gravity).  Over a step A is the integral of the
matrix of these equations, and the transition is I + A + A^2 / 2.  This is the mechanization of the truth, linearised on the
truth; no estimator's equations are used.  Source: Groves 2013, section 14.2.3 (with the opposite sign of attitude), with the
gradient of the whole gravity vector.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.evaluation.limits.steps import Steps

Array = NDArray[np.float64]

PSI, DV, DR = slice(0, 3), slice(3, 6), slice(6, 9)
OMEGA_IE_E = np.array([0.0, 0.0, geodesy.OMEGA_IE])
_HEIGHT, _LATITUDE = 10.0, 1e-4
"""Differences for the gradient of gravity, m and rad: gravity is smooth over thousands of kilometres."""


def earth_axes(latitude: Array, longitude: Array) -> Array:
    """C_en (m, 3, 3)."""
    return np.asarray(geodesy.numeric.C_en(latitude, longitude))


def gravity_gradient_n(latitude: Array, height: Array) -> Array:
    """Change of the gravity vector per displacement, in axes that keep their direction, (m, 3, 3), 1/s^2.

    Gravity points down along the ellipsoid's normal, which turns by a displacement over the radius of curvature.
    """

    def gravity(latitude: Array, height: Array) -> Array:
        return np.asarray(geodesy.numeric.normal_gravity(np.sin(latitude), height))

    R_M, R_N = geodesy.numeric.radii(np.sin(latitude))
    g = gravity(latitude, height)
    found = np.zeros((len(latitude), 3, 3))
    found[:, 0, 0] = -g / (R_M + height)
    found[:, 1, 1] = -g / (R_N + height)
    found[:, 2, 2] = -(gravity(latitude, height + _HEIGHT) - gravity(latitude, height - _HEIGHT)) / (2 * _HEIGHT)
    by_latitude = (gravity(latitude + _LATITUDE, height) - gravity(latitude - _LATITUDE, height)) / (2 * _LATITUDE)
    found[:, 2, 0] = by_latitude / (R_M + height)
    return found


def integrals(steps: Steps, C_en: Array, thrust_n: Array) -> Array:
    """A (m, 9, 9): integral of the matrix of the error equations over each step.

    thrust_n (m, 3): integral of the specific force in n, m/s.
    """
    count, length = len(steps.time), steps.length[:, None, None]
    turning = attitude.numeric.skew(OMEGA_IE_E) * length
    C_ne = C_en.swapaxes(1, 2)
    A = np.zeros((count, 9, 9))
    A[:, PSI, PSI] = -turning
    A[:, DV, PSI] = -attitude.numeric.skew((C_en @ thrust_n[..., None])[..., 0])
    A[:, DV, DV] = -2 * turning
    A[:, DV, DR] = C_en @ gravity_gradient_n(steps.latitude, steps.height) @ C_ne * length
    A[:, DR, DV] = np.eye(3) * length
    return A


def local(steps: Steps, C_en: Array) -> Array:
    """W (m, 9, 9): from (psi, dv, dr) in e to the misalignment (rad), velocity (m/s) and position errors (m) in n.

    An error of position turns the axes n of the estimate: phi = C_ne psi - dtheta, dv_n = C_ne dv - dtheta x v_n, with
    dtheta = (dE / (R_N + h), -dN / (R_M + h), -dE tan L / (R_N + h)).
    """
    R_M, R_N = geodesy.numeric.radii(np.sin(steps.latitude))
    turn = np.zeros((len(steps.time), 3, 3))
    turn[:, 0, 1] = 1 / (R_N + steps.height)
    turn[:, 1, 0] = -1 / (R_M + steps.height)
    turn[:, 2, 1] = -np.tan(steps.latitude) / (R_N + steps.height)
    C_ne = C_en.swapaxes(1, 2)
    W = np.zeros((len(steps.time), 9, 9))
    for block in (PSI, DV, DR):
        W[:, block, block] = C_ne
    W[:, PSI, DR] = -turn @ C_ne
    W[:, DV, DR] = attitude.numeric.skew(steps.velocity_n) @ turn @ C_ne
    return W


def euler_jacobian(q_nb: Array) -> Array:
    """d(roll, pitch, heading)/d(misalignment about n) (m, 3, 3)."""
    _, pitch, heading = attitude.numeric.to_euler(q_nb)
    cosine = np.where(np.abs(np.cos(pitch)) < 1e-6, 1e-6, np.cos(pitch))
    c, s = np.cos(heading), np.sin(heading)
    J = np.zeros((len(q_nb), 3, 3))
    J[:, 0, 0], J[:, 0, 1] = c / cosine, s / cosine
    J[:, 1, 0], J[:, 1, 1] = -s, c
    J[:, 2, 0], J[:, 2, 1], J[:, 2, 2] = c * np.sin(pitch) / cosine, s * np.sin(pitch) / cosine, 1.0
    return J
