"""Flicker noise by its Allan deviation."""

from typing import Any

import allantools
import numpy as np
from scipy.stats import chi2
from sensor_plant import CHANCE, simulate

from insenv.sensors.imu_tables import FLICKER_PARTS, FLICKER_SIGMA, FLICKER_TIMES


def allan_of_the_processes(time: Any) -> Any:
    """Allan deviation of the sum of Gauss-Markov processes of floor 1, in closed form."""
    total = 0.0
    for T in FLICKER_TIMES:
        u = time / T
        total = total + 2 * FLICKER_SIGMA**2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    return np.sqrt(total)


def test_it_has_the_floor_that_is_asked_for() -> None:
    """The Allan deviation of 3 axes of both triads; the processes are nearly flat from ten seconds to half a day."""
    flat = allan_of_the_processes(np.logspace(1, np.log10(5e4), 200))
    assert 0.92 < flat.min() < flat.max() < 1.01
    floor = {"gyro_flicker": (1e-7, 2e-7, 4e-7), "accel_flicker": (1e-4, 2e-4, 5e-5)}
    n, seeds, times = 20_000, 2, np.array([10, 30, 100, 300])
    ratios = []
    for seed in range(seeds):
        out = simulate(n, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, **floor})
        for output, name in (("delta_angle", "gyro_flicker"), ("delta_velocity", "accel_flicker")):
            for rate, size in zip(out[output].T, floor[name], strict=True):
                ratios.append(allantools.oadev(rate, 1.0, "freq", times)[1] / size)
    mean = np.sqrt(np.mean(np.square(ratios), axis=0))
    # 6 axes a seed of n / (2 time) independent differences each
    bound = 5.0 / np.sqrt(6 * seeds * n / times)
    assert (np.abs(mean / allan_of_the_processes(times) - 1.0) < bound + 0.01).all(), mean
    assert (np.abs(mean - 1.0) < 0.1).all(), mean


def test_it_is_stationary_from_the_first_sample_on() -> None:
    """Over many units: the variance of the bias after the first sample and after half a minute is the same."""
    units, floor = 200, np.array([1e-7, 2e-7, 3e-7])
    biases = []
    for seed in range(units):
        out = simulate(30, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, "gyro_flicker": floor})
        biases.append(out["gyro_bias_true"][[0, 1, 29]] / floor)
    variance = np.mean(np.square(biases), axis=(0, 2))
    expected = FLICKER_PARTS * FLICKER_SIGMA**2
    low, high = chi2.ppf([CHANCE, 1 - CHANCE], 3 * units) / (3 * units)
    assert (low * expected < variance).all() and (variance < high * expected).all()
