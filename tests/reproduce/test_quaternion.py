"""Theory of the in-run standard deviation, against runs of the linear model that it is about."""

import numpy as np
import pytest

from insenv import geodesy
from insenv.reproduce.quaternion import scatter_deg

LATITUDE, SIGMA, STEP = 0.56, 63e-6, 0.05
TIMES = np.arange(150.0, 200.01, 0.5)


def errors(runs):
    """Heading errors (runs, times) of the q-method and of the Kalman filter on the integral, deg, by recursion of the sums."""
    count = round(TIMES[-1] / STEP)
    t = geodesy.OMEGA_IE * np.cos(LATITUDE) * STEP * (np.arange(count) + 0.5)
    noise = SIGMA * np.random.default_rng(4).standard_normal((runs, count))
    A = [np.cumsum(np.ones(count)), np.cumsum(t), np.cumsum(t * t)]
    s = [np.cumsum(noise, axis=1), np.cumsum(noise * t, axis=1)]
    K = [np.cumsum(A[0] ** 2 + A[1] ** 2), np.cumsum(A[1] * (A[0] + A[2])), np.cumsum(A[1] ** 2 + A[2] ** 2)]
    z = [np.cumsum(A[0] * s[0] + A[1] * s[1], axis=1), np.cumsum(A[1] * s[0] + A[2] * s[1], axis=1)]
    at = np.round(TIMES / STEP).astype(int) - 1
    return [
        np.degrees((m[0] * v[1][:, at] - m[1] * v[0][:, at]) / (m[0] * m[2] - m[1] ** 2))
        for m, v in (([a[at] for a in A], s), ([k[at] for k in K], z))
    ]


def test_the_standard_deviation_in_time_is_that_of_many_runs():
    for integrated, found in zip((False, True), errors(400), strict=True):
        found = found.std(axis=1)
        expected = scatter_deg(SIGMA, STEP, LATITUDE, TIMES, integrated)
        assert found.mean() == pytest.approx(expected, abs=4 * found.std() / np.sqrt(len(found)))
        assert found.std() > 0.3 * found.mean(), "one run can be far from the mean"
