"""Theory of the in-run standard deviation: how much the heading of one run moves about its own mean.

With the gyros exact, the vectors of the paper observe a tilt a and a heading psi, y_k = a + psi W cos L t_k + n_k, with
the horizontal Earth rate W cos L and white n.  With h_k = (1, W cos L t_k) and A_k the sum of h h^T up to k, the q-method
solves A_i x = sum of h_k n_k.  The Kalman filter on the integral K_j = A_j dt takes all observations for equally noisy:

    sum over j <= i of K_j^2  x = sum over j <= i of K_j (sum over k <= j of h_k n_k) dt

Both errors are sums of the n_k with known weights, so their covariance over the times of a run is known, and with it the mean
of the standard deviation of a run about its own mean.
"""

from __future__ import annotations

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array

STEP_S = 0.05
"""s: the noise of the samples in a step is averaged; far below all times here."""


def scatter_deg(tilt_sigma: float, interval: float, latitude: float, times: Array, integrated: bool) -> float:
    """Mean over runs of the standard deviation in time of the heading error, degrees.

    tilt_sigma: white noise per sample, rad. interval: of the samples, s. latitude: rad. times (n,) s: records, in order.
    integrated: the Kalman filter on the integral, with its noise known; otherwise the q-method.
    """
    count = round(times[-1] / STEP_S)
    h = np.stack([np.ones(count), geodesy.OMEGA_IE * np.cos(latitude) * STEP_S * (np.arange(count) + 0.5)], axis=1)
    A = np.cumsum(h[:, :, None] * h[:, None, :], axis=0)
    records = np.round(times / STEP_S).astype(int) - 1
    weights = np.zeros((len(times), count))
    before = np.concatenate([np.zeros((1, 2, 2)), np.cumsum(A, axis=0)])
    for row, i in enumerate(records):
        if integrated:
            solve = np.linalg.inv(np.einsum("jab,jbc->ac", A[: i + 1], A[: i + 1]))
            weights[row, : i + 1] = np.einsum("a,kab,kb->k", solve[1], before[i + 1] - before[: i + 1], h[: i + 1])
        else:
            weights[row, : i + 1] = h[: i + 1] @ np.linalg.inv(A[i])[1]
    moves = weights - weights.mean(axis=0)
    squares = np.linalg.eigvalsh(moves @ moves.T / len(times))
    return float(np.degrees(tilt_sigma * np.sqrt(interval / STEP_S)) * _mean_root(np.maximum(squares, 0.0)))


def _mean_root(squares: Array) -> float:
    """Mean of the root of a sum of squares of independent normal numbers with these variances (n,).

    Of a positive x it is the integral over u > 0 of (1 - E exp(-u^2 x)) / u^2, divided by the root of pi.
    """
    scale = np.sqrt(squares.sum())
    u = np.geomspace(1e-6, 1e6, 20001) / scale
    characteristic = np.exp(-0.5 * np.log1p(2 * np.outer(u**2, squares)).sum(axis=1))
    values = (1 - characteristic) / u  # du = u d(log u)
    return float(np.sum((values[1:] + values[:-1]) / 2 * np.diff(np.log(u))) / np.sqrt(np.pi))
