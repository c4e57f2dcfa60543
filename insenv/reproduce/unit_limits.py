"""The limit of one unit with known errors, for papers that state the biases of theirs as numbers.

The limit of `insenv.limit` is over an ensemble of units: a bias given as a number counts as one standard deviation.  For one
unit, whose biases no alignment can tell from attitude, the error is that of its biases and what white noise leaves besides.

The mean errors of the sensors rotate the apparent vertical and the apparent east: no algorithm that knows only the
place can distinguish this from attitude. With the components of the mean errors in n (biases rotate with the body), the
errors of attitude, estimate minus truth, are

    about north = -b_aE / g,   about east = b_aN / g,   about down = (b_aE / g) tan L - b_gE / (omega_ie cos L)

This is (42) of the ECEF fine-alignment paper and (15) of the swaying-base paper. Correction to (42), which gives the
two parts of heading the same sign: the balance omega_ie x phi = -b_g of the paper's own error equation gives them
opposite signs, and its simulated heading (-0.00944 deg) agrees with that limit (-0.0096), not with the printed one
(-0.01195).
"""

from __future__ import annotations

from math import erf, exp, pi, sqrt
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE
from insenv.evaluation.limits import Limit
from insenv.runs.ensemble import Ensemble
from insenv.scenario import Plant, build, limit_of

_BIASES = ("gyro_bias_deg_h", "gyro_bias_sigma_deg_h", "accel_bias_ug", "accel_bias_sigma_ug")


def noise_limit(plant: Plant) -> Limit:
    """The limit of a plant's scenario with a unit without biases."""
    imu = plant.scenario.imu.model_copy(update=dict.fromkeys(_BIASES, 0.0))
    return limit_of(build(plant.scenario.model_copy(update={"imu": imu}), plant.seed, plant.duration_s))


def bias_errors_deg(run: Ensemble) -> Array:
    """Errors of roll, pitch and heading (seeds, 3), deg, that the sensor errors of each seed's unit cause."""
    known = run.plants[0].knowledge
    tilts = [bias_tilts(e[:3], e[3:], known.latitude, known.height) for e in run.sensor_error_n]
    return np.degrees(tilts)


def unit_limit(run: Ensemble, bias_deg: Array, from_s: float) -> Array:
    """Limits of roll, pitch and heading (3, deg) over the records from `from_s` on, root mean square.

    bias_deg (seeds, 3): the errors that the biases of each seed's unit cause.
    """
    noise = noise_limit(run.plants[0]).rms(run.time, from_s)
    return np.hypot(np.sqrt(np.mean(bias_deg**2, axis=0)), [noise[name] for name in ATTITUDE])


def mean_limit(sigma_deg: Array, bias_deg: Array) -> float:
    """The limit of the magnitude of the mean error over an interval (deg), averaged over runs.

    sigma_deg (times,): limit of the unit's noise at evenly spaced times. bias_deg (seeds,): the errors that the biases of each
    seed's unit cause. The errors of an optimal estimate of a constant at two times have the covariance of the later one, so the
    variance of the mean is the average of the limit's square with the weights 1, 3, 5, ... The mean of |x| is that of a folded
    normal distribution: it is compared with means of |mean|, and a root mean square with the limit itself.
    """
    count = len(sigma_deg)
    sigma = float(np.sqrt(np.sum((2 * np.arange(count) + 1) * sigma_deg**2) / count**2))
    return float(np.mean([_folded(float(bias), sigma) for bias in bias_deg]))


def _folded(mean: float, sigma: float) -> float:
    """Mean of |x| of a normal distribution."""
    ratio = mean / sigma
    return sigma * sqrt(2 / pi) * exp(-(ratio**2) / 2) + mean * erf(ratio / sqrt(2))


def bias_tilts(gyro_error_n: Array, accel_error_n: Array, latitude: Any, height: Any) -> Array:
    """Attitude errors about north, east, down (..., 3, rad) from mean sensor errors in n (..., 3; rad/s, m/s^2).

    latitude rad, height m (...). The sign is that of the rotation vector of estimate times inverse truth, in n.
    """
    g = geodesy.numeric.normal_gravity(np.sin(latitude), height)
    north, east = -accel_error_n[..., 1] / g, accel_error_n[..., 0] / g
    down = -north * np.tan(latitude) - gyro_error_n[..., 1] / (geodesy.OMEGA_IE * np.cos(latitude))
    return np.stack([north, east, down], axis=-1)
