"""The bridge from symbolic functions to NumPy arrays (insenv/core/numeric.py)."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from insenv.core.numeric import MAX_IDLE_COUNT, vectorized


def affine(A, x, scale):
    return scale * ca.mtimes(A, x), A, ca.dot(x, x)


affine_numeric = vectorized(affine, (2, 3), 3, ())


def test_broadcasts_leading_axes_and_keeps_rows_as_rows():
    rng = np.random.default_rng(0)
    A, x, scale = rng.normal(size=(5, 1, 2, 3)), rng.normal(size=(4, 3)), rng.normal(size=4)
    y, same, square = affine_numeric(A, x, scale)
    assert y.shape == (5, 4, 2) and same.shape == (5, 4, 2, 3) and square.shape == (5, 4)
    np.testing.assert_allclose(y, scale[:, None] * np.einsum("aijk,bk->abj", A, x), rtol=1e-13)
    np.testing.assert_array_equal(same, np.broadcast_to(A, (5, 4, 2, 3)))
    np.testing.assert_allclose(square, np.broadcast_to((x**2).sum(-1), (5, 4)), rtol=1e-14)
    assert affine_numeric(np.empty((0, 2, 3)), [1, 2, 3], 1)[0].shape == (0, 2)
    strided = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    y, same, square = affine_numeric(strided, [1, 2, 3], 2)
    np.testing.assert_array_equal(y, 2 * strided @ [1, 2, 3])
    np.testing.assert_array_equal(same, strided)
    assert square == 14.0 and np.ndim(square) == 0
    diagonal = vectorized(lambda v: ca.diag(v), 2)  # with structural zeros
    np.testing.assert_array_equal(diagonal([[1, 2], [3, 4]]), [[[1, 0], [0, 2]], [[3, 0], [0, 4]]])


@pytest.mark.parametrize("count", [MAX_IDLE_COUNT, MAX_IDLE_COUNT + 1])
def test_results_of_a_call_outlive_the_next_one_and_it_is_traced_once(count):
    traces, rows = [], np.arange(float(count))
    twice = vectorized(lambda x: traces.append(x) or 2.0 * x, ())
    assert not traces
    first, second = twice(rows), twice(rows + 1.0)
    np.testing.assert_array_equal(first, 2.0 * np.arange(count))
    np.testing.assert_array_equal(second, 2.0 * (rows + 1.0))
    assert len(traces) == 1


def test_threads_have_their_own_rows():
    square = vectorized(lambda x: x * x, ())

    def squares(start):
        return all(np.array_equal(square(rows), rows * rows) for rows in start + np.arange(1000.0)[:, None])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(squares, range(4)))


def test_a_wrong_shape_is_named():
    with pytest.raises(ValueError, match=r"affine: argument 1 has shape \(4,\), not \('\.\.\.', 3\)"):
        affine_numeric(np.eye(2, 3), np.zeros(4), 1)


@pytest.mark.parametrize("value", ["1", True, 1j, [1.0, None, 2.0]])
def test_what_is_not_of_real_numbers_is_refused(value):
    with pytest.raises(TypeError, match=r"argument 0 is of type .*, allowed are real numbers"):
        vectorized(lambda x: x + 1.0, np.shape(value))(value)
