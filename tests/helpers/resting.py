"""Estimators on the samples of a unit at rest."""

import numpy as np
from driven import fed
from scipy.spatial.transform import Rotation

from insenv import attitude, geodesy
from insenv.estimators import get

ATTITUDES = [
    *np.eye(4),
    *np.array([[1, 1, 1, 1], [1, 0, 1, 0], [0, 1, 0, -1], [0.2, -1.4, 0.2, 1.4]]) / [[2], [2**0.5], [2**0.5], [2]],
]
"""Level, half turns, the vertical, and others (q_nb)."""


def samples(q_nb, latitude, seconds, dt=0.05, gyro_bias=(0, 0, 0), accel_bias=(0, 0, 0), accel_noise=0.0):
    """Columns of delta_angle, delta_velocity and dt at rest; biases (3) or one row for each sample; noise: m/s^2 per sample."""
    C_nb, n = attitude.numeric.to_dcm(q_nb), round(seconds / dt)
    gravity = float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))
    force = C_nb.T @ [0, 0, -gravity] + np.broadcast_to(accel_bias, (n, 3))
    force = force + accel_noise * np.random.default_rng(1).normal(size=(n, 3))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(latitude) + gyro_bias
    return {"delta_angle": np.tile(rate * dt, (n, 1)), "delta_velocity": force * dt, "dt": np.full(n, dt)}


def at_rest(id, q_nb, latitude, seconds, dt=0.05, parameters=None, backend=None, **errors):
    """The runner of an estimator after `seconds` of `samples`."""
    columns = samples(q_nb, latitude, seconds, dt, **errors)
    return fed(get(id).model, columns, {"latitude": latitude, **(parameters or {})}, backend)


def attitude_error(runner, q_nb):
    """Rotation vector (3, n, rad) of the attitude error."""
    return attitude.numeric.error_rotation_vector(runner.outputs()["q_nb"], q_nb)


def drawn(rng):
    """An attitude (4), any one as likely as another."""
    return Rotation.random(random_state=rng).as_quat(scalar_first=True)
