"""Symmetric matrices over CasADi symbols, stored as their upper triangle column by column.

A covariance is a state row of n (n + 1) / 2 elements: half the memory, and symmetric by construction.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


def triangle_size(n: int) -> int:
    """Number of elements of the upper triangle of an n x n matrix."""
    return n * (n + 1) // 2


def place(i: int, j: int) -> int:
    """Index of element (i, j) in the stored triangle."""
    i, j = min(i, j), max(i, j)
    return j * (j + 1) // 2 + i


def full(triangle: Any, n: int) -> Any:
    """The n x n symmetric matrix of a stored triangle."""
    return block(triangle, slice(0, n))


def block(triangle: Any, part: slice) -> Any:
    """The block on the diagonal of a stored triangle, as a full matrix."""
    places = range(part.start, part.stop)
    return ca.reshape(triangle[[place(i, j) for i in places for j in places]], len(places), len(places))


def triangle(matrix: Any) -> Any:
    """The stored triangle of a symmetric matrix; elements below the diagonal are not read."""
    n = matrix.shape[0]
    return ca.densify(ca.vec(matrix)[[i + n * j for j in range(n) for i in range(j + 1)]])


def diagonal_places(n: int) -> list[int]:
    """Indices of the diagonal elements in the stored triangle."""
    return [place(i, i) for i in range(n)]


def triangle_of_diagonal(diagonal: Any) -> np.ndarray:
    """Stored triangle (NumPy) of a diagonal matrix."""
    diagonal = np.asarray(diagonal, dtype=np.float64)
    stored = np.zeros(triangle_size(diagonal.size))
    stored[diagonal_places(diagonal.size)] = diagonal
    return stored


def full_array(stored: np.ndarray, n: int) -> np.ndarray:
    """The matrices (..., n, n) of stored triangles (..., n (n + 1) / 2), NumPy."""
    index = np.array([[place(i, j) for j in range(n)] for i in range(n)])
    return np.asarray(stored)[..., index]
