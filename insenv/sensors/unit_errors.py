"""The true errors of an inertial unit, as an error model of its increments has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def true_unit_errors(state: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Array]:
    """The errors of a unit in body axes, SI: biases, scale factors and g-sensitivity (3), couplings xy, xz, yx, yz, zx, zy (6).

    state: that of a plant, by row name.  parameters: its parameters.  With y measured and x true, x = (I - S - M) (y - b dt):
    I - S - M is the inverse of the matrix of `insenv.sensors.imu`.  The g-sensitivity is that of each gyro along its own axis.
    """
    found: dict[str, Array] = {}
    warm = state["imu_temperature"] - parameters["imu_temperature_reference"]
    for triad in ("gyro", "accel"):
        thermal = 1.0 + np.multiply(parameters[f"{triad}_scale_factor_slope"], warm)
        measured = state["C_bs"] @ np.diag(np.broadcast_to(thermal, 3)) @ state[f"{triad}_error_matrix"]
        left = np.eye(3) - np.linalg.inv(measured)
        found[f"{triad}_bias"] = np.array(state[f"{triad}_bias_true"])
        found[f"{triad}_scale"] = np.diag(left).copy()
        found[f"{triad}_misalignment"] = left[~np.eye(3, dtype=bool)]
    found["gyro_g_sensitivity"] = np.diag(state["C_bs"] @ state["gyro_g_matrix"]).copy()
    return found
