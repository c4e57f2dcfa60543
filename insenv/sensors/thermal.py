"""The thermal errors of a triad as a calibration states them, removed from its increments: the inverse of the sensor's model.

With warmth T - T_0 above the temperature of reference, in sensor axes (`insenv.sensors.imu`):

    y = (1 + k (T - T_0)) d + b (T - T_0) dt
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def without_thermal_errors(increments: Array, dt: Array, warmth: Array, bias_slope: Array, scale_slope: Array) -> Array:
    """Increments (n, 3) of a triad without its thermal errors.

    increments (n, 3), rad or m/s, s; dt (n,), s; warmth (n,), K; bias_slope (3,), rad/s/K or m/s^2/K; scale_slope (3,), 1/K.
    """
    bias = (warmth * dt)[:, None] * bias_slope
    return np.asarray((increments - bias) / (1.0 + warmth[:, None] * scale_slope))
