"""White noise of an inertial unit from its own log, by differences of mean rates.

The mean rates y over averaging times tau have white noise of variance N^2 / tau. Their k-th differences have (2k)!/(k!)^2
times that, and remove a polynomial of degree k - 1: a constant rate for k = 1 (then N^2 / tau is the Allan variance), smooth
motion for a high k.

Fourth differences are used. At rest they are taken over `REST_TIMES`: slow enough for an engine's vibration to average out and
for the low-pass filter in front of many logs to be passed, fast enough for the rocking of a parked vehicle to be smooth. The
median of their sizes is insensitive to a knock on the vehicle. In motion they are taken over shorter times, in the quietest
tenth of the log. Of several averaging times the one with the largest noise counts, because a low-pass filter hides noise at
the shortest.
"""

from __future__ import annotations

from math import comb

import numpy as np

from insenv.logs.units import Array

ORDER = 4
REST_TIMES = (0.04, 0.08, 0.16)
"""Averaging times at rest (s)."""
MOTION_TIMES = (0.0, 0.02, 0.04, 0.08)
"""Averaging times in motion (s); 0: of one sample."""
WINDOW_S = 2.0
QUIET = 0.1
_MEDIAN = 0.6744897501960817  # of |z| for a standard normal z
_LEAST = 8  # differences below which a time is not used


def noise_at_rest(increments: Array, interval: float) -> float:
    """White noise density of the noisiest axis of a unit at rest (rad/s^0.5 or m/s^1.5); 0 without scatter.

    increments (n, 3): rad or m/s, over samples of `interval` (s); 100 samples or more.
    """
    found = [0.0]
    for tau in REST_TIMES:
        samples = _samples(tau, interval)
        differences = _differences(increments, interval, samples)
        if len(differences) >= _LEAST or not found[1:]:
            sizes = np.median(np.abs(differences), axis=0) / _MEDIAN if len(differences) else np.zeros(3)
            found.append(float(sizes.max() * np.sqrt(samples * interval)))
    return max(found)


def noise_in_motion(increments: Array, interval: float) -> float:
    """The same of a vehicle that moves: of its quietest tenth, which motion and vibration disturb least."""
    length = min(max(round(WINDOW_S / interval), 6 * _LEAST), len(increments))
    starts = range(0, len(increments) - length + 1, length)
    found = [0.0]
    for tau in MOTION_TIMES:
        samples = _samples(tau, interval)
        windows = [_differences(increments[i : i + length], interval, samples) for i in starts]
        if windows and len(windows[0]) >= _LEAST:
            sizes = [np.sqrt(np.mean(window**2, axis=0)) for window in windows]
            found.append(float(np.quantile(sizes, QUIET, axis=0).max() * np.sqrt(samples * interval)))
    return max(found)


def _samples(tau: float, interval: float) -> int:
    return max(round(tau / interval), 1)


def _differences(increments: Array, interval: float, samples: int) -> Array:
    """Differences of the mean rates over `samples` samples, scaled to the standard deviation of one mean rate."""
    count = len(increments) // samples
    means = increments[: count * samples].reshape(count, samples, -1).sum(axis=1) / (samples * interval)
    if count <= ORDER:
        return np.zeros((0, increments.shape[1]))
    return np.diff(means, ORDER, axis=0) / np.sqrt(comb(2 * ORDER, ORDER))
