"""Turn a symbolic function into a NumPy function of stacked arguments."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache, wraps
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from insenv.core.elementary import quick_operators

MAX_IDLE_COUNT = 256
"""Largest number of rows whose memory is reused by the next call: making it costs more than the evaluation."""


class _Evaluation:
    """A CasADi function with arrays of its own for arguments and results, (entries,) each, rows one after another."""

    def __init__(self, function: ca.Function) -> None:
        self.arguments = [np.empty(function.nnz_in(i)) for i in range(function.n_in())]
        self.results = [np.empty(function.nnz_out(i)) for i in range(function.n_out())]
        self.buffer: Any  # the type stub of CasADi lacks memoryview
        self.buffer, self.evaluate = function.buffer()
        for i, array in enumerate(self.arguments):
            self.buffer.set_arg(i, array.data)
        for i, array in enumerate(self.results):
            self.buffer.set_res(i, array.data)


def vectorized(function: Callable[..., Any], *shapes: int | tuple[int, ...]) -> Callable[..., Any]:
    """A NumPy version of a function of SX, broadcasting over leading axes.

    ``shapes`` gives the shape of each argument: ``()`` a scalar, ``3`` or ``(3,)`` a vector, ``(3, 3)`` a matrix. Any
    axes before these broadcast against those of the other arguments. Results are float64 arrays of shape (leading...,
    own...), where 1x1 is a scalar and n x 1 a vector; a tuple if the function returns a tuple.

        to_dcm = vectorized(attitude.to_dcm, 4)
        to_dcm(q)    # (..., 4) -> (..., 3, 3)

    The symbolic function is traced at the first call. Raises TypeError for an argument that is not of real numbers, ValueError
    for one whose last axes do not have its shape and for leading axes that do not broadcast.
    """
    argument_shapes = [(shape,) if isinstance(shape, int) else tuple(shape) for shape in shapes]
    name = getattr(function, "__name__", "function")

    @cache
    def traced() -> tuple[ca.Function, list[tuple[int, ...]], bool]:
        flat = [ca.SX.sym(f"x{i}", prod(shape)) for i, shape in enumerate(argument_shapes)]
        with quick_operators():
            returned = function(*(_from_row_major(x, shape) for x, shape in zip(flat, argument_shapes, strict=True)))
        is_tuple = isinstance(returned, (tuple, list))
        results = [ca.SX(result) for result in (returned if is_tuple else (returned,))]
        # CasADi stores by columns, NumPy by rows
        graph = ca.Function("vectorized", flat, [ca.densify(ca.vec(result.T)) for result in results])
        return graph, [_numpy_shape(result) for result in results], is_tuple

    @lru_cache(maxsize=4)
    def mapped(count: int) -> ca.Function:
        return traced()[0].map(count)

    idle: dict[int, list[_Evaluation]] = {}

    def evaluation_of(count: int) -> _Evaluation:
        try:
            return idle[count].pop()  # atomic: no two threads evaluate in the same memory
        except LookupError:
            return _Evaluation(mapped(count))

    @wraps(function)
    def call(*arguments: Any) -> Any:
        if len(arguments) != len(argument_shapes):
            raise TypeError(f"{name} takes {len(argument_shapes)} arguments, not {len(arguments)}")
        arrays = [np.asarray(argument) for argument in arguments]
        lead = _leading(name, arrays, argument_shapes)
        _, result_shapes, is_tuple = traced()
        if count := prod(lead):
            evaluation = evaluation_of(count)
            for memory, array, shape in zip(evaluation.arguments, arrays, argument_shapes, strict=True):
                memory.reshape(lead + shape)[...] = array
            evaluation.evaluate()
            pairs = zip(evaluation.results, result_shapes, strict=True)
            results = [memory.reshape(lead + shape).copy() for memory, shape in pairs]
            if count <= MAX_IDLE_COUNT:
                idle.setdefault(count, []).append(evaluation)
        else:
            results = [np.empty(lead + shape) for shape in result_shapes]
        unboxed = tuple(result[()] for result in results)
        return unboxed if is_tuple else unboxed[0]

    # drop the annotations of the symbolic function: arguments and results are arrays
    call.__annotations__ = {}
    return call


def _leading(name: str, arrays: list[np.ndarray], argument_shapes: list[tuple[int, ...]]) -> tuple[int, ...]:
    """The axes before the arguments' own shapes, broadcast."""
    leading = []
    for i, (array, shape) in enumerate(zip(arrays, argument_shapes, strict=True)):
        if array.dtype.kind not in "fiu":  # None would be NaN, a text its number
            raise TypeError(f"{name}: argument {i} is of type {array.dtype}, allowed are real numbers")
        split = array.ndim - len(shape)
        if split < 0 or array.shape[split:] != shape:
            raise ValueError(f"{name}: argument {i} has shape {array.shape}, not {('...', *shape)}")
        leading.append(array.shape[:split])
    if len(set(leading)) == 1:
        return leading[0]  # the usual case, much quicker
    try:
        return np.broadcast_shapes(*leading)
    except ValueError:
        shapes = " and ".join(map(str, leading))
        raise ValueError(f"{name}: the leading axes {shapes} of the arguments do not broadcast") from None


def _from_row_major(x: ca.SX, shape: tuple[int, ...]) -> ca.SX:
    return ca.reshape(x, shape[1], shape[0]).T if len(shape) == 2 else x


def _numpy_shape(x: ca.SX) -> tuple[int, ...]:
    rows, columns = x.shape
    return (rows, columns) if columns > 1 else (rows,) if rows > 1 else ()
