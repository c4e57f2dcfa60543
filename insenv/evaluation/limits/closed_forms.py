"""Closed forms of alignment at rest, against which the recursion is checked, and the errors that known biases cause.

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
error times the horizontal Earth rate. The sum leaves out that an optimal filter must tell both noises apart, and is 3 to
6 % too low where neither dominates; the limit (`insenv.evaluation.limits`) contains this.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array


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
