"""The stored triangle of a symmetric matrix."""

import casadi as ca
import numpy as np

from insenv.core import symmetric


def test_the_triangle_and_the_matrix_belong_together():
    matrix = np.array([[1.0, 2, 4], [2, 3, 5], [4, 5, 6]])
    stored = ca.DM(symmetric.triangle(ca.SX(matrix))).full().ravel()
    assert stored.tolist() == [1, 2, 3, 4, 5, 6]
    assert np.array_equal(symmetric.full_array(stored, 3), matrix)
    assert np.array_equal(ca.DM(symmetric.full(ca.SX(stored), 3)).full(), matrix)
    assert symmetric.triangle_of_diagonal([1, 2]).tolist() == [1, 0, 2]
