"""Theoretical limits of alignment: the attitude error that sensor errors cause, whatever the method.

The mean errors of the sensors rotate the apparent vertical and the apparent east: no algorithm that knows only the
place can distinguish this from attitude. With the components of the mean errors in n (biases rotate with the body), the
errors of attitude, estimate minus truth, are

    about north = -b_aE / g,   about east = b_aN / g,   about down = (b_aE / g) tan L - b_gE / (omega_ie cos L)

This is (42) of the ECEF fine-alignment paper and (15) of the swaying-base paper. Correction to (42), which gives the
two parts of heading the same sign: the balance omega_ie x phi = -b_g of the paper's own error equation gives them
opposite signs, and its simulated heading (-0.00944 deg) agrees with that limit (-0.0096), not with the printed one
(-0.01195).

White noise adds, over an observation time T, with angle random walk N and velocity random walk V,

    about north = V / (g sqrt(T)),   about east = 2 V / (g sqrt(T)),
    about down = sqrt(N^2 / T + 12 V^2 / (g^2 T^3)) / (omega_ie cos L)

These are the errors of the best linear unbiased estimates of a drift from a Brownian path (N), and of a constant, of
the end and of the slope of a line from white noise (V): the tilt about east follows a line whose slope is the heading
error times the horizontal Earth rate. `noise_bound` is the Cramer-Rao bound of both noises together, at all times: the
covariance of the optimal filter that knows the vehicle to be at rest, from the tilt rows of the error model of the
navigation filters.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.evaluation.errors import ATTITUDE

Array = NDArray[np.float64]

BOUND_STEPS = 3000


def bias_tilts(gyro_error_n: Array, accel_error_n: Array, latitude: Any, height: Any) -> Array:
    """Attitude errors about north, east, down (..., 3, rad) from mean sensor errors in n (..., 3; rad/s, m/s^2).

    latitude rad, height m (...). The sign is that of the rotation vector of estimate times inverse truth, in n.
    """
    g = geodesy.numeric.normal_gravity(np.sin(latitude), height)
    north, east = -accel_error_n[..., 1] / g, accel_error_n[..., 0] / g
    down = -north * np.tan(latitude) - gyro_error_n[..., 1] / (geodesy.OMEGA_IE * np.cos(latitude))
    return np.stack([north, east, down], axis=-1)


def noise_tilts(angle_random_walk: float, velocity_random_walk: float, latitude: float, height: float, time: float) -> Array:
    """Standard deviations about north, east, down (3, rad) from white noise after `time` seconds."""
    g = float(geodesy.numeric.normal_gravity(np.sin(latitude), height))
    tilt = 2 * velocity_random_walk / (g * np.sqrt(time))
    drift = angle_random_walk**2 / time + 12 * velocity_random_walk**2 / (g**2 * time**3)
    return np.array([tilt / 2, tilt, np.sqrt(drift) / (geodesy.OMEGA_IE * np.cos(latitude))])


def noise_bound(angle_random_walk: Any, velocity_random_walk: Any, latitude: Any, height: Any, times: Array) -> Array:
    """Cramer-Rao bound of alignment at rest: standard deviations about north, east, down (..., n, 3, rad).

    times (n): s, rising. The vehicle is known to be at rest; specific force is measured with white noise V, attitude is
    propagated by gyros with white noise N, and nothing is known of the attitude at time 0. N (rad/s^0.5), V (m/s^1.5),
    latitude (rad) and height (m) broadcast (...).
    """
    N, V, latitude, height = np.broadcast_arrays(angle_random_walk, velocity_random_walk, latitude, height)
    shape = N.shape
    models = [_tilt_model(float(lat), float(h)) for lat, h in zip(latitude.ravel(), height.ravel(), strict=True)]
    tilt_rate, force_per_tilt = (np.stack(part) for part in zip(*models, strict=True))
    step = float(times[-1]) / BOUND_STEPS
    carry = np.eye(3) + tilt_rate * step
    grown = np.eye(3) * (N.reshape(-1, 1, 1) ** 2 * step)
    # information on the tilts from the force of one step; a floor keeps that of a noiseless sensor finite
    gained = force_per_tilt.swapaxes(1, 2) @ force_per_tilt * (step / np.maximum(V.reshape(-1, 1, 1), 1e-12) ** 2)
    P, found = np.tile(np.eye(3) * np.pi**2, (N.size, 1, 1)), np.empty((BOUND_STEPS + 1, N.size, 3))
    found[0] = np.pi
    for k in range(BOUND_STEPS):
        P = carry @ P @ carry.swapaxes(1, 2) + grown
        P = P @ np.linalg.inv(np.eye(3) + gained @ P)
        P = (P + P.swapaxes(1, 2)) / 2
        found[k + 1] = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    grid = np.linspace(0.0, float(times[-1]), BOUND_STEPS + 1)
    bounds = [[np.interp(times, grid, found[:, i, axis]) for axis in range(3)] for i in range(N.size)]
    return np.array(bounds).swapaxes(1, 2).reshape(*shape, len(times), 3)


def _tilt_model(latitude: float, height: float) -> tuple[Array, Array]:
    """d(tilt rate)/d(tilt) (1/s) and d(specific force error)/d(tilt) (m/s^2) at rest in n, (3x3) each."""
    import casadi as ca

    from insenv.estimators.parts.error_model import TILT, VELOCITY, Interval, transition

    g = float(geodesy.numeric.normal_gravity(np.sin(latitude), height))
    rest = Interval(1.0, ca.SX([0, 0, -g]), ca.SX.eye(3), ca.SX(ca.DM(geodesy.numeric.earth_rate_n(latitude))), ca.SX.zeros(3))
    A = ca.DM(ca.evalf(transition(rest, g, 1e9, 1e9))).full()
    return A[TILT, TILT], A[VELOCITY, TILT]


def alignment_limit(bias: Array, noise: Array, heading: float) -> dict[str, float]:
    """Limit in degrees by channel name; see `alignment_limits`."""
    return dict(zip(ATTITUDE, alignment_limits(bias, noise, heading).tolist(), strict=True))


def alignment_limits(bias: Array, noise: Array, heading: Any) -> Array:
    """Limits of roll, pitch and heading (..., 3), degrees: root sum square of the bias and noise parts.

    bias, noise (..., 3): errors about north, east, down, rad. heading (..., rad): rotates tilts to roll and pitch.
    """
    c, s = np.cos(heading), np.sin(heading)
    north, east, down = np.moveaxis(bias, -1, 0)
    # tilts about the forward and right axes of the level body
    bias = np.stack([c * north + s * east, c * east - s * north, down], axis=-1)
    return np.degrees(np.hypot(bias, noise))
