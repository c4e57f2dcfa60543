"""Least-squares support vector machine with an RBF kernel, as a scikit-learn estimator.

Training minimises 1/2 |w|^2 + gamma/2 sum of v_k e_k^2 with y_k = w phi(x_k) + b + e_k, which gives the linear system

    [[0, 1^T], [1, K + diag(1 / (gamma v))]] [b; a] = [0; y],   K = exp(-|x_k - x_l|^2 / sigma^2)

(the LS-SVM paper erroneously prints it without the zero and without the term in gamma; its c is gamma/2).  v are the
sample weights; Suykens et al., Least Squares Support Vector Machines (2002), sections 3.4 and 6.

`support`: with fewer support vectors than samples (fixed size), w is restricted to combinations of the phi of the
support vectors, and the same sum over all samples is minimised.  With as many support vectors as samples the two
problems are identical.  The support vectors are the pivots of the Cholesky factorisation of the kernel matrix: a
deterministic greedy choice of the samples that the previous ones represent worst.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from insenv.core.tables import Array
from insenv.estimators.lssvm import kernel

BLOCK = 4096  # rows of the kernel matrix that a prediction computes at once


class LSSVMRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Least-squares support vector regression with one or many outputs.

    gamma: weight of the errors, > 0.  sigma: width of the kernel, > 0.  support: number of support vectors; None: all
        samples.

    After `fit`: support_ (S, n_features), dual_coef_ (S, n_outputs) and intercept_ (n_outputs).
    """

    def __init__(self, gamma: float = 30.0, sigma: float = 1.0, support: int | None = None) -> None:
        self.gamma = gamma
        self.sigma = sigma
        self.support = support

    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> LSSVMRegressor:
        """Fit y (n,) or (n, n_outputs) to X (n, n_features).  Raises ValueError for arguments that are out of range."""
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        for name in ("gamma", "sigma"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} = {getattr(self, name)!r}: allowed is a positive number")
        if self.support is not None and self.support < 1:
            raise ValueError(f"support = {self.support!r}: allowed is None or a number from 1 up")
        weights = _check_sample_weight(sample_weight, X, dtype=np.float64)
        if (weights < 0).any() or not weights.any():
            raise ValueError("sample_weight: allowed are numbers from 0 up, not all 0")
        weighted = weights > 0
        X, targets, weights = X[weighted], np.asarray(y, dtype=np.float64)[weighted], weights[weighted]
        targets = targets.reshape(len(X), -1)
        if self.support is None or self.support >= len(X):
            self.support_ = X.copy()
            coefficients, offset = _dual(rbf(X, X, self.sigma), targets, self.gamma * weights)
        else:
            self.support_ = X[pivots(X, self.sigma, self.support)]
            coefficients, offset = _fixed_size(
                rbf(X, self.support_, self.sigma), rbf(self.support_, self.support_, self.sigma), targets, self.gamma * weights
            )
        self._single = np.ndim(y) == 1
        self.dual_coef_, self.intercept_ = coefficients, offset
        return self

    def predict(self, X: Any) -> Array:
        """Outputs (n,) or (n, n_outputs), in the shape that was fitted."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        blocks = [rbf(X[i : i + BLOCK], self.support_, self.sigma) @ self.dual_coef_ for i in range(0, len(X), BLOCK)]
        outputs = np.concatenate(blocks) + self.intercept_
        return outputs[:, 0] if self._single else outputs


def rbf(X: Array, Z: Array, sigma: float) -> Array:
    """Kernel matrix (len(X), len(Z)), with the same exponential as in the model `lssvm`."""
    square = np.maximum(np.sum(X**2, axis=1)[:, None] + np.sum(Z**2, axis=1) - 2 * X @ Z.T, 0.0)
    return kernel(square / sigma**2)


def pivots(X: Array, sigma: float, count: int) -> NDArray[np.intp]:
    """Indices of up to `count` samples, the pivots of the Cholesky factorisation of the kernel matrix."""
    rest, factor = np.ones(len(X)), np.zeros((len(X), count))
    chosen: list[int] = []
    for k in range(min(count, len(X))):
        # take the first within 1e-9 of the largest, so that rounding does not decide between equals
        place = int(np.argmax(rest >= rest.max() * (1 - 1e-9)))
        if rest[place] <= 1e-12:
            break
        row = rbf(X, X[place : place + 1], sigma)[:, 0] - factor[:, :k] @ factor[place, :k]
        factor[:, k] = row / np.sqrt(rest[place])
        rest = np.maximum(rest - factor[:, k] ** 2, 0.0)
        rest[place] = 0.0
        chosen.append(place)
    return np.array(chosen)


def _dual(K: Array, targets: Array, weights: Array) -> tuple[Array, Array]:
    """Coefficients (n, outputs) and offsets (outputs) that solve the linear system above."""
    from scipy.linalg import cho_factor, cho_solve

    factor = cho_factor(K + np.diag(1.0 / weights), lower=True)
    ones, free = cho_solve(factor, np.ones(len(K))), cho_solve(factor, targets)
    offset = free.sum(axis=0) / ones.sum()
    return free - np.outer(ones, offset), offset


def _fixed_size(C: Array, Omega: Array, targets: Array, weights: Array) -> tuple[Array, Array]:
    """The same with w a combination of the support vectors: least squares of the rows sqrt(v) (C a + b - y) and
    Omega^(1/2) a.

    C (n, S): kernel of the samples with the support vectors; Omega (S, S): kernel of the support vectors with each
    other.
    """
    from scipy.linalg import eigh, lstsq

    values, vectors = eigh(Omega)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    scale = np.sqrt(weights)[:, None]
    stacked = np.block([[scale * C, scale], [root, np.zeros((len(root), 1))]])
    right = np.concatenate([scale * targets, np.zeros((len(root), targets.shape[1]))])
    solution = lstsq(stacked, right, cond=1e-15)[0]
    return solution[:-1], solution[-1]
