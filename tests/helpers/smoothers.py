"""Two fixed-interval smoothers of a filter's recorded pass, in NumPy, as a reference for the compiled one.

They start from the same record and are equal in exact arithmetic:

bryson_frazier  the adjoint filter of `insenv.estimators.parts.adjoint`; inverts nothing.
rts             Rauch, Tung and Striebel (1965): each filtered state corrected by the smoothed state after it.

The error state is relative to the filter's state after feedback: just after the measurements of an instant its estimate is
0, and at a measurement the state that it refers to jumps by the correction fed back. A filter without feedback is the same
case: its estimate is the state and its correction the jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scalars:
    """The scalar measurements of one instant in the order used.

    H (m, n): sensitivities. gain (m, n). weight (m): inverse variances of the innovations; 0 with a gain of 0: not used.
    left (m): innovations minus what the measurements before them explained.
    """

    H: Array
    gain: Array
    weight: Array
    left: Array

    @property
    def correction(self) -> Array:
        """The error state estimated and fed back, (n,)."""
        return self.left @ self.gain


@dataclass(frozen=True)
class Pass:
    """A filter's pass over K instants of a system of n states.

    transition (K, n, n), noise (K, n, n): of the interval that *ends* at each instant, so transition[k] takes the error
    state at k - 1 to k; that of the first instant is not used. covariance (K, n, n): after the measurements of each instant.
    scalars: of each instant.
    """

    transition: Array
    noise: Array
    covariance: Array
    scalars: Sequence[Scalars]

    def predicted(self, k: int) -> Array:
        """Covariance at instant k before its measurements."""
        return self.transition[k] @ self.covariance[k - 1] @ self.transition[k].T + self.noise[k]


def bryson_frazier(run: Pass) -> tuple[Array, Array]:
    """Smoothed error states (K, n) about the fed-back states, and their covariances (K, n, n)."""
    states, covariances = _like(run)
    n = run.covariance.shape[-1]
    s, L = np.zeros(n), np.zeros((n, n))
    for k in reversed(range(len(run.covariance))):
        P = run.covariance[k]
        states[k], covariances[k] = P @ s, P - P @ L @ P
        now = run.scalars[k]
        for h, gain, weight, left in reversed(list(zip(now.H, now.gain, now.weight, now.left, strict=True))):
            closed = np.eye(n) - np.outer(gain, h)
            s = closed.T @ s + h * (weight * left)
            L = closed.T @ L @ closed + np.outer(h, h) * weight
        s, L = run.transition[k].T @ s, run.transition[k].T @ L @ run.transition[k]
    return states, covariances


def rts(run: Pass) -> tuple[Array, Array]:
    """As `bryson_frazier`; every predicted covariance is inverted (scaled to a unit diagonal)."""
    states, covariances = _like(run)
    state, covariance = np.zeros(run.covariance.shape[-1]), run.covariance[-1]
    states[-1], covariances[-1] = state, covariance
    for k in reversed(range(len(run.covariance) - 1)):
        predicted, P = run.predicted(k + 1), run.covariance[k]
        scale = np.sqrt(np.diag(predicted))
        solved = np.linalg.solve(predicted / np.outer(scale, scale), (run.transition[k + 1] @ P) / scale[:, None])
        gain = (solved / scale[:, None]).T
        # the smoothed state at k + 1 less the predicted one: beyond the fed-back state, and the jump to that
        state = gain @ (state + run.scalars[k + 1].correction)
        covariance = P + gain @ (covariance - predicted) @ gain.T
        states[k], covariances[k] = state, covariance
    return states, covariances


def _like(run: Pass) -> tuple[Array, Array]:
    return np.empty(run.covariance.shape[:2]), np.empty(run.covariance.shape)
