"""The bridge from symbolic functions to NumPy arrays."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from insenv.core.numeric import KEPT_COUNT, vectorized


def affine(A, x, scale):
    """A documented function."""
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


def test_takes_lists_integers_and_strided_views():
    A = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    y, same, square = affine_numeric(A, [1, 2, 3], 2)
    np.testing.assert_array_equal(y, 2 * A @ [1, 2, 3])
    np.testing.assert_array_equal(same, A)
    assert square == 14.0 and np.ndim(square) == 0


def test_structural_zeros_and_single_results():
    diagonal = vectorized(lambda v: ca.diag(v), 2)
    np.testing.assert_array_equal(diagonal([[1, 2], [3, 4]]), [[[1, 0], [0, 2]], [[3, 0], [0, 4]]])


def test_empty_stacks():
    y, same, square = affine_numeric(np.empty((0, 2, 3)), [1, 2, 3], 1)
    assert y.shape == (0, 2) and same.shape == (0, 2, 3) and square.shape == (0,)


@pytest.mark.parametrize("count", [1, KEPT_COUNT, KEPT_COUNT + 1])
def test_results_of_a_call_outlive_the_next_one(count):
    twice = vectorized(lambda x: 2.0 * x, ())
    rows = np.arange(float(count))
    first = twice(rows)
    second = twice(rows + 1.0)
    np.testing.assert_array_equal(first, 2.0 * rows)
    np.testing.assert_array_equal(second, 2.0 * (rows + 1.0))


def test_leading_axes_of_the_same_count_have_their_own_shape():
    total = vectorized(lambda x, y: x + y, (), ())
    assert total(np.ones((2, 3)), np.ones(3)).shape == (2, 3)
    assert total(np.ones((3, 2)), 1.0).shape == (3, 2)
    np.testing.assert_array_equal(total(np.arange(6.0), [[1.0]]), [np.arange(1.0, 7.0)])


def test_threads_have_their_own_rows():
    square = vectorized(lambda x: x * x, ())

    def squares(start):
        return all(np.array_equal(square(rows), rows * rows) for rows in start + np.arange(2000.0)[:, None])

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(squares, range(4)))


def test_arguments_are_left_alone_and_the_trace_is_lazy():
    traces = []

    def square(x):
        traces.append(x)
        return x * x

    numeric = vectorized(square, ())
    assert not traces
    x = np.array([1.0, 2.0])
    np.testing.assert_array_equal(numeric(x), [1, 4])
    np.testing.assert_array_equal(numeric(x), [1, 4])
    np.testing.assert_array_equal(x, [1, 2])
    assert len(traces) == 1


def test_wrong_calls_are_named():
    assert affine_numeric.__name__ == "affine" and affine_numeric.__doc__ == "A documented function."
    with pytest.raises(ValueError, match=r"affine: argument 1 has shape \(4,\), not \('\.\.\.', 3\)"):
        affine_numeric(np.eye(2, 3), np.zeros(4), 1)
    with pytest.raises(ValueError, match="argument 0"):
        affine_numeric(np.zeros(3), np.zeros(3), 1)
    with pytest.raises(
        ValueError, match=r"affine: the leading axes \(\) and \(2,\) and \(3,\) of the arguments do not broadcast"
    ):
        affine_numeric(np.eye(2, 3), np.zeros((2, 3)), np.zeros(3))
    with pytest.raises(TypeError, match="takes 3 arguments, not 1"):
        affine_numeric(1.0)


@pytest.mark.parametrize("value", [None, "1", True, 1j, [1.0, None, 2.0], [True, False, True], np.ones(3, "M8[s]")])
def test_what_is_not_of_real_numbers_is_refused(value):
    total = vectorized(lambda x: x + 1.0, np.shape(value))
    with pytest.raises(TypeError, match=r"argument 0 is of type .*, allowed are real numbers"):
        total(value)
