"""Biases as first-order Gauss-Markov processes, stepped over an interval of any length.

    b <- a b + w,   a = exp(-T / time),   variance of w = sigma^2 (1 - a^2)

so that a variance of sigma^2 stays sigma^2. The estimate of the bias decays as the bias does: between measurements the
best estimate of b(T) is a b(0). Gelb (1974), chapter 3.
"""

from __future__ import annotations

from typing import Any

from insenv.core.elementary import exp


def decay(duration: Any, time: Any) -> Any:
    """a over `duration` with the correlation time `time` (s): 1 / exp(duration / time) by its series.

    Within 1e-12 up to a hundredth of the time, 2e-4 up to half of it, and between 0 and 1 for any duration; the variance
    stays sigma^2 with every a.
    """
    x = duration / time
    return 1 / (1 + x * (1 + x * (1 / 2 + x * (1 / 6 + x / 24))))


def decays(p: Any, duration: Any) -> tuple[Any, Any]:
    """Factors a of the gyro and of the accelerometer biases over `duration` (s).

    p: rows `gyro_correlation_time`, `accel_correlation_time` (s).
    """
    return decay(duration, p.gyro_correlation_time), decay(duration, p.accel_correlation_time)


def driven_variance(sigma: Any, decay: Any) -> Any:
    """Variance that the driving noise adds to each component of a bias of standard deviation `sigma`."""
    return sigma**2 * (1 - decay) * (1 + decay)


def correlated_again(variance: Any, since: Any, time: Any) -> Any:
    """Variance to add to a measurement whose error is a first-order Gauss-Markov process, `since` seconds after the last one.

    Of a constant, such an error of variance s^2 leaves the information 1 / s^2 at the first measurement and
    (1 - r) / (1 + r) / s^2 at each further one, r = exp(-since / time): as if its variance were s^2 (1 + r) / (1 - r).
    """
    r = exp(-since / time)
    return variance * (2 * r / (1 - r + 1e-12))
