"""From a coarse alignment in place to an error-state filter: the covariance of attitude and sensor biases.

What biases do to an alignment in place does not average out, so attitude and biases are correlated from the start. In
place, with the misalignment phi and the biases left in the measurements (b, in n) as in (12) and (22) of the ECEF
fine-alignment paper, the specific force and the Earth's rotation balance at

    phi_N = b_aE / g,   phi_E = -b_aN / g,   phi_D = b_gE / (omega_ie cos L) - phi_N tan L

A filter that starts without these correlations takes the attitude for a measurement of its own, and states too little.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import geodesy
from insenv.core.elementary import maximum, sin_cos

LEAST_NOISE = 1e-12  # rad^2


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
    noise = maximum(sigma**2 - ca.diag(biases), LEAST_NOISE)
    return Aligned(biases + ca.diag(noise), tilt_accel, tilt_gyro)
