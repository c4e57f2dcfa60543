"""The smoother of Rauch, Tung and Striebel (1965) on a filter's recorded pass, in NumPy, as a reference for the compiled one.

The error state is relative to the filter's state after feedback: just after the measurements of an instant its estimate is
0, and at a measurement the state that it refers to jumps by the correction fed back.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scalars:
    """The scalar measurements of one instant in the order used.

    gain (m, n). weight (m): inverse variances of the innovations; 0 with a gain of 0: not used. left (m): innovations minus
    what the measurements before them explained.
    """

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


def rts(run: Pass) -> tuple[Array, Array]:
    """Smoothed error states (K, n) about the fed-back states, and their covariances (K, n, n).

    Every predicted covariance is inverted, scaled to a unit diagonal.
    """
    states, covariances = np.empty(run.covariance.shape[:2]), np.empty(run.covariance.shape)
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
