"""Run many instances of a model at once: rows in blocks of lanes, blocks distributed over threads.

Row i is bit-identical to the single run with seed + i, whatever the number of rows, lanes or threads.  Callers see
arrays of shape (rows, elements); internally a block of rows is stored lane by lane, so that one instruction serves a
whole block.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.compile import batch_library_path, load, pointer
from insenv.core.model import Model
from insenv.core.runner import InterpreterRunner, check_inputs, cycle_size, made, watched_spans
from insenv.core.tables import Vector


def make_batch(
    model: Model,
    rows: int,
    parameters: Mapping[str, Any] | Vector | None = None,
    *,
    threads: int = 1,
    lanes: int | None = None,
    backend: str | None = None,
) -> Batch:
    """Make and start a batch of `rows` instances.

    parameters: by name or flat, the same for all rows except that row i has seed + i; or an array (rows,
        parameters.size).
    threads: number of worker threads (the GIL is released).
    lanes: rows per block; None: as many as a vector register of this processor holds (8 with AVX-512, else 4).
    backend: as for `make_runner`.
    Raises `InputError` for a number below 1 or parameters that do not fit.
    """
    if rows < 1 or threads < 1 or (lanes is not None and lanes < 1):
        raise InputError(f"rows = {rows}, threads = {threads}, lanes = {lanes}: each must be at least 1")
    return made(NativeBatch, InterpreterBatch, backend)(model, row_parameters(model, rows, parameters), threads, lanes)


def row_parameters(model: Model, rows: int, parameters: Mapping[str, Any] | Vector | None) -> Vector:
    """Parameters of every row, (rows, parameters.size); the seed increases by one per row unless all rows are given."""
    if isinstance(parameters, np.ndarray) and parameters.ndim == 2:
        if parameters.shape != (rows, model.parameters.size):
            raise InputError(f"parameters of shape {parameters.shape}: allowed is {(rows, model.parameters.size)}")
        return np.array(parameters, dtype=np.float64)
    one = parameters if isinstance(parameters, np.ndarray) else model.parameters.pack(parameters or {})
    every = np.tile(np.asarray(one, dtype=np.float64), (rows, 1))
    if model.is_random:
        every[:, model.parameters.slice("seed").start] += np.arange(rows)
    return every


class Batch:
    """Many instances of a model, made by `make_batch`."""

    def __init__(self, model: Model, p: Vector, threads: int) -> None:
        self.model, self.rows, self.threads = model, len(p), threads

    def start(self) -> None:
        """Set every row to the start state that its parameters define."""
        raise NotImplementedError

    def starts(self, p: Vector) -> Vector:
        """The start states (k, state.size) that parameters (k, parameters.size) define; no row takes them."""
        raise NotImplementedError

    def start_rows(self, rows: NDArray[np.intp], p: Vector) -> None:
        """Set the parameters p (k, parameters.size) of some rows, each named once, and restart them."""
        raise NotImplementedError

    def set_parameters(self, rows: NDArray[np.intp], p: Vector) -> None:
        """Set the parameters p (k, parameters.size) of some rows and keep their states."""
        raise NotImplementedError

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], Vector], Vector]:
        """A function to call repeatedly, and the buffer (rows, inputs.size) to write its inputs to before each call.

        Each call runs `step` in every row regardless of its condition, then advances n times with these inputs.  It returns
        a new array (rows, n * watched elements + outputs.size): the state rows `watched` after each advance, then the
        outputs.  The inputs must be finite.
        """
        raise NotImplementedError

    def run(self, n: int, inputs: Vector | None = None, every: int = 0) -> Vector:
        """Advance every row n times.

        inputs: (rows, n, inputs.size); or (rows, inputs.size) or (inputs.size,), constant over the n advances; zeros if
        None. Returns the outputs after every `every`-th advance, (rows, n // every, outputs.size); none if `every` is
        0.
        """
        raise NotImplementedError

    def output(self) -> Vector:
        """The outputs of the current states, (rows, outputs.size)."""
        raise NotImplementedError

    @property
    def p(self) -> Vector:
        """A copy of the parameters, (rows, parameters.size); `set_parameters` changes them."""
        raise NotImplementedError

    @property
    def x(self) -> Vector:
        """A copy of the states, (rows, state.size); assign the whole array to change them."""
        raise NotImplementedError

    @x.setter
    def x(self, value: Vector) -> None:
        raise NotImplementedError

    def _held(self, n: int, inputs: Vector | None) -> Vector:
        """Inputs as (rows, 1 or n, inputs.size)."""
        width = self.model.inputs.size
        if inputs is None:
            return np.zeros((self.rows, 1, width))
        array = np.asarray(inputs, dtype=np.float64)
        if array.ndim == 3:
            return check_inputs(array, (self.rows, n, width))
        return np.broadcast_to(check_inputs(array, (self.rows, width)), (self.rows, width))[:, None, :]


class NativeBatch(Batch):
    """A batch run by generated C, one vector lane per row."""

    def __init__(self, model: Model, p: Vector, threads: int, lanes: int | None) -> None:
        super().__init__(model, p, threads)
        self._library = load(batch_library_path(model, lanes))
        self.lanes = int(self._library.insenv_lanes())
        self._blocks = -(-self.rows // self.lanes)
        blocks = np.linspace(0, self._blocks, min(threads, self._blocks) + 1).astype(int)
        edges = np.minimum(blocks * self.lanes, self.rows).tolist()
        self._shares = list(zip(blocks[:-1].tolist(), edges[:-1], edges[1:], strict=True))
        self._p = _on_a_line((self._blocks, model.parameters.size, self.lanes))
        self._x = _on_a_line((self._blocks, model.state.size, self.lanes))
        self._p[:] = self._into_lanes(p)
        self.start()

    def start(self) -> None:
        self._library.insenv_start(self._blocks, pointer(self._p), pointer(self._x))

    def run(self, n: int, inputs: Vector | None = None, every: int = 0) -> Vector:
        u = np.ascontiguousarray(self._held(n, inputs))
        y = np.empty((self.rows, n // every if every else 0, self.model.outputs.size))
        stride = u.shape[2] if u.shape[1] == n > 1 else 0
        of_row, to_row = u.shape[1] * u.shape[2], y.shape[1] * y.shape[2]

        def work(block: int, first: int, last: int) -> None:
            at_p, at_x, at_u, at_y = (pointer(array) for array in (self._p[block:], self._x[block:], u[first:], y[first:]))
            self._library.insenv_run(last - first, at_p, at_x, at_u, stride, of_row, at_y, to_row, every, n)

        self._shared(work)
        return y

    def starts(self, p: Vector) -> Vector:
        compact = self._into_lanes(p)
        x = np.empty((len(compact), self.model.state.size, self.lanes))
        self._library.insenv_start(len(compact), pointer(compact), pointer(x))
        return x.transpose(0, 2, 1).reshape(len(compact) * self.lanes, -1)[: len(p)]

    def start_rows(self, rows: NDArray[np.intp], p: Vector) -> None:
        self.set_parameters(rows, p)
        if len(rows) == self.rows:
            self.start()
        else:
            self._x[rows // self.lanes, :, rows % self.lanes] = self.starts(p)

    def set_parameters(self, rows: NDArray[np.intp], p: Vector) -> None:
        self._p[rows // self.lanes, :, rows % self.lanes] = p

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], Vector], Vector]:
        u, spans = np.zeros((self.rows, self.model.inputs.size)), watched_spans(self.model, watched)
        rows, size, number = self.rows, cycle_size(self.model, watched, n), list(self.model.steps).index(step)
        at_p, at_x, at_u, at_spans = (array.ctypes.data for array in (self._p, self._x, u, spans))
        run, width, count = self._library.insenv_cycle, u.shape[1], len(spans)
        of_p, of_x, of_u, of_y = (8 * self.lanes * elements for elements in (self._p.shape[1], self._x.shape[1], width, size))

        def call() -> Vector:
            y = np.empty((rows, size))
            at_y = pointer(y)

            def work(block: int, first: int, last: int) -> None:
                at = at_p + block * of_p, at_x + block * of_x, at_u + block * of_u
                run(last - first, number, *at, width, at_spans, count, n, at_y + block * of_y, size)

            self._shared(work)
            return y

        call.buffers = u, spans  # type: ignore[attr-defined]  # their addresses must stay valid as long as the call
        return call, u

    def _shared(self, work: Callable[[int, int, int], None]) -> None:
        """Call `work(block, first, last)` for half-open ranges of rows that begin with a block, one per thread."""
        if len(self._shares) == 1:
            work(*self._shares[0])
        else:
            list(_pool(self.threads).map(work, *zip(*self._shares, strict=True)))

    def output(self) -> Vector:
        y = np.empty((self._blocks, self.model.outputs.size, self.lanes))
        self._library.insenv_output(self._blocks, pointer(self._p), pointer(self._x), pointer(y))
        return self._from_lanes(y)

    @property
    def p(self) -> Vector:
        return self._from_lanes(self._p)

    @property
    def x(self) -> Vector:
        return self._from_lanes(self._x)

    @x.setter
    def x(self, value: Vector) -> None:
        self._x[:] = self._into_lanes(np.asarray(value, dtype=np.float64))

    def _into_lanes(self, array: Vector) -> Vector:
        """(rows, elements) as blocks (blocks, elements, lanes); copies of the last row fill an incomplete block."""
        missing = -len(array) % self.lanes
        padded = np.concatenate([array, np.repeat(array[-1:], missing, axis=0)]) if missing else array
        return np.ascontiguousarray(padded.reshape(len(padded) // self.lanes, self.lanes, -1).transpose(0, 2, 1))

    def _from_lanes(self, array: Vector) -> Vector:
        rows = np.array(array.transpose(0, 2, 1), order="C")  # a copy even for one lane, where it would be a view
        return rows.reshape(self._blocks * self.lanes, array.shape[1])[: self.rows]


def _on_a_line(shape: tuple[int, ...]) -> Vector:
    """Zeros that begin at a cache line: vectors of 64 bytes that lie across two take longer to load and store."""
    size, line = int(np.prod(shape)), 64
    space = np.zeros(size + line // 8)
    first = -space.ctypes.data % line // 8
    return space[first : first + size].reshape(shape)


class InterpreterBatch(Batch):
    """A batch run row by row on the interpreter: bit-identical results without a compiler."""

    def __init__(self, model: Model, p: Vector, threads: int, lanes: int | None) -> None:
        super().__init__(model, p, threads)
        self._runners = [InterpreterRunner(model, row) for row in p]

    def start(self) -> None:
        for runner in self._runners:
            runner.start()

    def starts(self, p: Vector) -> Vector:
        runner, states = InterpreterRunner(self.model), np.empty((len(p), self.model.state.size))
        for row, state in zip(p, states, strict=True):
            runner.p[:] = row
            runner.start()
            state[:] = runner.x
        return states

    def start_rows(self, rows: NDArray[np.intp], p: Vector) -> None:
        self.set_parameters(rows, p)
        for row in rows:
            self._runners[row].start()

    def set_parameters(self, rows: NDArray[np.intp], p: Vector) -> None:
        for row, values in zip(rows, p, strict=True):
            self._runners[row].p[:] = values

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], Vector], Vector]:
        inputs, size = np.zeros((self.rows, self.model.inputs.size)), cycle_size(self.model, watched, n)
        cycles = [runner.cycle(step, watched, n) for runner in self._runners]

        def call() -> Vector:
            results = np.empty((self.rows, size))
            for runner, (run, buffer), u, y in zip(self._runners, cycles, inputs, results, strict=True):
                runner._u[:] = u
                run()
                y[:] = buffer
            return results

        return call, inputs

    def run(self, n: int, inputs: Vector | None = None, every: int = 0) -> Vector:
        held = self._held(n, inputs)
        outputs = np.empty((self.rows, n // every if every else 0, self.model.outputs.size))
        for runner, u, y in zip(self._runners, held, outputs, strict=True):
            y[:] = runner.run(n, u if len(u) == n else u[0], every)
        return outputs

    def output(self) -> Vector:
        return np.array([runner.output() for runner in self._runners])

    @property
    def p(self) -> Vector:
        return np.array([runner.p for runner in self._runners])

    @property
    def x(self) -> Vector:
        return np.array([runner.x for runner in self._runners])

    @x.setter
    def x(self, value: Vector) -> None:
        for runner, row in zip(self._runners, value, strict=True):
            runner.x[:] = row


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="insenv")
