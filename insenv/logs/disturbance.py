"""What disturbs the readings of an instrument, as a white noise that filters count; and readings that are none.

Variations with the standard deviation s that last for a time T (the integral of their autocorrelation, on both sides of 0) have
at low frequency the spectrum of a white noise with the standard deviation s sqrt(T / interval).
"""

from __future__ import annotations

import numpy as np

from insenv.core.tables import Array
from insenv.logs.recorded import Readings, RecordedLog

DISTURBED = 1.5
"""Ratio to the stated noise from which variations are a disturbance."""
LONGEST_S = 30.0
"""Time over which variations are compared with themselves, s."""

LEAST = 50
"""Readings that show anything."""
STUCK = 0.2
"""rad: a turn that changes the readings."""


def turned_by(log: RecordedLog) -> float:
    """The largest angle (rad) by which the gyros turn; a bias does not turn the vehicle."""
    angle = np.cumsum(log.delta_angle, axis=0)
    return float(np.ptp(angle - np.linspace(angle[0], angle[-1], len(angle)), axis=0).max())


def is_stuck(readings: Readings, turned: float) -> bool:
    """Whether all readings are the same although the vehicle has turned (rad)."""
    return len(readings.time) >= LEAST and turned > STUCK and not np.ptp(readings.values, axis=0).any()


def white_noise(spread: float, lasting: float, interval: float) -> float:
    """The standard deviation of readings every `interval` (s) for variations of `spread` that last for `lasting` (s)."""
    return spread * float(np.sqrt(max(lasting / interval, 1.0)))


def lasting_of(values: Array, interval: float) -> float:
    """The time (s) that variations (n,) last: the integral of their autocorrelation until it vanishes, on both sides of 0."""
    power = np.abs(np.fft.rfft(values - values.mean(), 2 * len(values))) ** 2
    correlation = np.fft.irfft(power)[: min(round(LONGEST_S / interval), len(values) // 2) + 1]
    if correlation[0] <= 0.0:
        return 0.0
    below = np.flatnonzero(correlation <= 0.0)
    until = below[0] if below.size else len(correlation)
    return interval * float(1.0 + 2.0 * correlation[1:until].sum() / correlation[0])


def interval_of(readings: Readings) -> float:
    """Median interval of readings (s)."""
    return max(float(np.median(np.diff(readings.time))), 1e-3)
