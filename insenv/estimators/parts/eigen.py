"""Eigenvectors of small symmetric matrices over CasADi symbols, by cyclic Jacobi rotations.

A fixed number of sweeps: no branches, no start vector that could be orthogonal to the result, always the same
operations. Convergence is quadratic; five sweeps of a 4x4 matrix reach rounding. Source: Golub and Van Loan (2013),
section 8.5.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import select

SWEEPS = 5


def largest_eigenvector(matrix: Any) -> Any:
    """Unit eigenvector (n x 1) of the largest eigenvalue of a symmetric n x n matrix (any, if all are equal)."""
    n = matrix.shape[0]
    A = [[matrix[min(i, j), max(i, j)] for j in range(n)] for i in range(n)]
    V = [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
    for _ in range(SWEEPS):
        for i in range(n - 1):
            for j in range(i + 1, n):
                _rotate(A, V, i, j)
    best, vector = A[0][0], [V[k][0] for k in range(n)]
    for i in range(1, n):
        better = A[i][i] > best
        best = select(better, A[i][i], best)
        vector = [select(better, V[k][i], vector[k]) for k in range(n)]
    return ca.vertcat(*vector)


def _rotate(A: list[list[Any]], V: list[list[Any]], i: int, j: int) -> None:
    """The Jacobi rotation that makes A[i][j] zero, in place."""
    n, gap, twice = len(A), A[j][j] - A[i][i], 2 * A[i][j]
    # tangent of the smaller rotation; without division by the off-diagonal element, which may be zero
    length = ca.fabs(gap) + ca.sqrt(gap * gap + twice * twice)
    t = select(gap < 0, -twice, twice) / (length + (length == 0))
    c = 1 / ca.sqrt(1 + t * t)
    s = t * c
    A[i][i], A[j][j] = A[i][i] - t * A[i][j], A[j][j] + t * A[i][j]
    A[i][j] = A[j][i] = ca.SX(0)
    for k in range(n):
        if k not in (i, j):
            A[i][k], A[j][k] = c * A[i][k] - s * A[j][k], s * A[i][k] + c * A[j][k]
            A[k][i], A[k][j] = A[i][k], A[j][k]
        V[k][i], V[k][j] = c * V[k][i] - s * V[k][j], s * V[k][i] + c * V[k][j]
