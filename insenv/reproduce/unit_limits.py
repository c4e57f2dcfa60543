"""The limit of one unit with known errors, for papers that state the biases of theirs as numbers.

The limit of `insenv.limit` is over an ensemble of units: a bias given as a number counts as one standard deviation.  For one
unit, whose biases no alignment can tell from attitude, the error is that of its biases and what white noise leaves besides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.errors import ATTITUDE
from insenv.evaluation.limits import Limit
from insenv.runs.ensemble import Ensemble
from insenv.scenario import Plant, build, limit_of

Array = NDArray[np.float64]

_BIASES = ("gyro_bias_deg_h", "gyro_bias_sigma_deg_h", "accel_bias_ug", "accel_bias_sigma_ug")


def noise_limit(plant: Plant) -> Limit:
    """The limit of a plant's scenario with a unit without biases."""
    imu = plant.scenario.imu.model_copy(update=dict.fromkeys(_BIASES, 0.0))
    return limit_of(build(plant.scenario.model_copy(update={"imu": imu}), plant.seed, plant.duration_s))


def unit_limit(run: Ensemble, bias_deg: Array, from_s: float) -> Array:
    """Limits of roll, pitch and heading (3, deg) over the records from `from_s` on, root mean square.

    bias_deg (seeds, 3): the errors that the biases of each seed's unit cause.
    """
    noise = noise_limit(run.plants[0]).rms(run.time, from_s)
    return np.hypot(np.sqrt(np.mean(bias_deg**2, axis=0)), [noise[name] for name in ATTITUDE])
