"""Run one instance of a model, on CasADi's interpreter or natively through generated C.

Both runners have the same interface and give bit-identical results.  All numbers are float64.  Parameters, inputs and
state may be read and written between calls; ``runner.x.copy()`` is a complete snapshot, which ``runner.x[:] =
snapshot`` restores.
"""

from __future__ import annotations

import ctypes
import functools
import inspect
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, nearest
from insenv.base.installing import install_extra
from insenv.core import noise
from insenv.core.compile import NoRoomError, begin_libraries, find_compiler, library_path, load, pointer
from insenv.core.model import Model
from insenv.core.tables import Vector

BACKENDS = ("native", "interpreter")
LONG_CYCLE = 50
"""A cycle of at least this many advances releases the GIL."""


def make_runner(model: Model, parameters: Mapping[str, Any] | Vector | None = None, backend: str | None = None) -> Runner:
    """Make and start a runner of `model`.

    parameters: values by row name (checked), or the flat vector; absent rows have the table's start values.
    backend: "native", "interpreter", or None: the environment's INSENV_BACKEND, else native if a C compiler is found.
    If no folder can hold compiled models, the interpreter is used with a warning, unless "native" is requested.
    Raises `InputError` for values that do not fit, an unknown backend, or "native" without a C compiler.
    """
    return made(NativeRunner, InterpreterRunner, backend)(model, parameters)


Made = TypeVar("Made")


def made(native: Callable[..., Made], interpreter: Callable[..., Made], backend: str | None) -> Callable[..., Made]:
    """The function that makes a runner or a batch on the backend; see `make_runner`."""
    if resolve_backend(backend) != "native":
        return interpreter

    def make(*arguments: Any) -> Made:
        try:
            return native(*arguments)
        except NoRoomError as error:
            if _requested(backend):
                raise
            _warn_interpreter(f"{error}: models run on the interpreter (slower, the same numbers)")
            return interpreter(*arguments)

    return make


def _requested(backend: str | None) -> str:
    """The backend that the caller or the environment asks for; "" if neither does."""
    return backend or os.environ.get("INSENV_BACKEND") or ""


def prepare(models: Iterable[Model], backend: str | None = None) -> None:
    """Announce models that runners will be made of: natively, they are then compiled at the same time."""
    if resolve_backend(backend) == "native":
        begin_libraries(models)


def resolve_backend(backend: str | None = None) -> str:
    """The backend to use: `backend`, else native if there is a C compiler; warns once if there is none."""
    chosen = _requested(backend)
    if chosen and chosen not in BACKENDS:
        raise InputError(f"backend = {chosen!r}: allowed is {' or '.join(BACKENDS)} (INSENV_BACKEND)")
    if chosen == "interpreter":
        return chosen
    if find_compiler() is not None:
        return "native"
    if chosen == "native":
        raise InputError(f"backend 'native' needs a C compiler: cc, gcc or clang on the path, or {install_extra('native')}")
    _warn_interpreter(
        f"no C compiler found: models run on the interpreter (slower, the same numbers); {install_extra('native')} brings one"
    )
    return "interpreter"


@functools.cache
def _warn_interpreter(message: str) -> None:
    warnings.warn(message, RuntimeWarning, stacklevel=2)


class Runner:
    """One instance of a model with parameters `p` and state `x`, made by `make_runner`.

    p, x: float64 vectors in table order; they may be read and written in place between calls.
    """

    backend = ""

    def __init__(self, model: Model, parameters: Mapping[str, Any] | Vector | None = None) -> None:
        self.model = model
        if isinstance(parameters, np.ndarray):
            self.p = np.array(parameters, dtype=np.float64)
            model.parameters.unpack(self.p)
        else:
            self.p = model.parameters.pack(parameters or {})
        self.x = np.zeros(model.state.size)
        self._u = np.zeros(model.inputs.size)
        self._y = np.zeros(model.outputs.size)

    @property
    def state(self) -> dict[str, Any]:
        """The state by row name (copies)."""
        return self.model.state.unpack(self.x.copy())

    def start(self) -> None:
        """Set the state to the start state that the parameters define."""
        raise NotImplementedError

    def step(self, name: str, inputs: Mapping[str, Any] | Vector | None = None) -> None:
        """Run one step regardless of its condition; inputs by name or flat, those of the previous call if None."""
        if name not in self.model.steps:
            raise InputError(f"model {self.model.id!r} has no step {name!r}{nearest(name, self.model.steps)}")
        self._set_inputs(inputs)
        self._step(name)

    def advance(self, inputs: Mapping[str, Any] | Vector | None = None) -> None:
        """Run the steps once, in order; inputs by name or flat, those of the previous call if None."""
        self._set_inputs(inputs)
        self._advance()

    def run(self, n: int, inputs: Vector | None = None, every: int = 1) -> Vector:
        """Advance n times and return the outputs after every `every`-th advance (0: none).

        inputs: (n, inputs.size), one row per advance, or (inputs.size,), constant; those of the previous call if None.
        Returns an array of shape (n // every, outputs.size).
        """
        raise NotImplementedError

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], None], Vector]:
        """A function to call repeatedly, and the buffer (n * watched elements + outputs.size,) that it fills.

        Each call runs `step` regardless of its condition, advances n times with the current inputs, and writes to the
        buffer the state rows `watched` after each advance, then the outputs.
        """
        raise NotImplementedError

    def output(self) -> Vector:
        """The outputs of the current state, as a new vector."""
        self._output()
        return self._y.copy()

    def outputs(self) -> dict[str, Any]:
        """The outputs by row name."""
        return self.model.outputs.unpack(self.output())

    def _step(self, name: str) -> None:
        raise NotImplementedError

    def _advance(self) -> None:
        raise NotImplementedError

    def _output(self) -> None:
        raise NotImplementedError

    def _set_inputs(self, inputs: Mapping[str, Any] | Vector | None) -> None:
        if isinstance(inputs, np.ndarray):
            self._u[:] = check_inputs(inputs, (self.model.inputs.size,))
        elif inputs is not None:
            self._u[:] = self.model.inputs.pack(inputs, base=self._u)


class InterpreterRunner(Runner):
    """A runner on CasADi's virtual machine, which needs no compiler."""

    backend = "interpreter"

    def __init__(self, model: Model, parameters: Mapping[str, Any] | Vector | None = None) -> None:
        super().__init__(model, parameters)
        self._steps: dict[str, tuple[Callable[[], None], Vector, list[tuple[Vector, Vector]]]] = {}
        for name, step in model.steps.items():
            kernel, r = model.kernels[name], np.zeros(step.uniforms)
            changed = np.zeros(kernel.function.size1_out(0))
            pieces = [(self.x[span], changed[part]) for span, part in kernel.pieces]
            call = _prepared(kernel.function, (self.p, self.x, self._u, r), changed)
            self._steps[name] = (call, r, pieces)
        self._output = _prepared(model.kernels["output"].function, (self.p, self.x), self._y)  # type: ignore[method-assign]
        self._order = [(name, None if step.when is None else self._x_or_u(step.when)) for name, step in model.steps.items()]
        self._noise: dict[str, tuple[float, int, Vector]] = {}
        self.start()

    def start(self) -> None:
        r = noise.uniforms(self._seed, 0, noise.START_STREAM, self.model.start_uniforms)
        self.x[:] = np.asarray(self.model.kernels["start"].function(self.p, r)).ravel()
        self._noise.clear()

    def run(self, n: int, inputs: Vector | None = None, every: int = 1) -> Vector:
        rows = check_inputs(inputs, (n, self._u.size)) if inputs is not None else self._u
        outputs = np.empty((n // every if every else 0, self._y.size))
        for k in range(n):
            if rows.ndim == 2:
                self._u[:] = rows[k]
            elif k == 0:
                self._u[:] = rows
            self._advance()
            if every and (k + 1) % every == 0:
                self._output()
                outputs[k // every] = self._y
        return outputs

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], None], Vector]:
        spans = watched_spans(self.model, watched)
        buffer = np.zeros(cycle_size(self.model, watched, n))

        def call() -> None:
            self._step(step)
            done = 0
            for _ in range(n):
                self._advance()
                for start, stop in spans:
                    buffer[done : done + stop - start] = self.x[start:stop]
                    done += int(stop - start)
            self._output()
            buffer[done:] = self._y

        return call, buffer

    def _x_or_u(self, name: str) -> Vector:
        """A view of the element that a condition tests."""
        if name in self.model.state:
            return self.x[self.model.state.slice(name)]
        return self._u[self.model.inputs.slice(name)]

    def _advance(self) -> None:
        for name, condition in self._order:
            if condition is None or condition[0] != 0:
                self._step(name)

    def _step(self, name: str) -> None:
        call, r, pieces = self._steps[name]
        if r.size:
            self._draw(name, r)
        call()
        for place, changed in pieces:
            place[:] = changed

    @property
    def _seed(self) -> float:
        return float(self.p[self.model.parameters.slice("seed")][0]) if self.model.is_random else 0.0

    def _draw(self, name: str, r: Vector) -> None:
        """Write a step's uniforms to r; being functions of seed and step number, they are computed many steps ahead."""
        now, seed = int(self.x[self.model.state.slice("step")][0]), self._seed
        known, first, block = self._noise.get(name, (seed, 0, np.zeros((0, 0))))
        if known != seed or not first <= now < first + len(block):
            first, stream = now, list(self.model.steps).index(name)
            block = noise.uniforms(seed, now + np.arange(256), stream, r.size)
            self._noise[name] = (seed, first, block)
        r[:] = block[now - first]


class NativeRunner(Runner):
    """Generated C, compiled once and cached."""

    backend = "native"

    def __init__(self, model: Model, parameters: Mapping[str, Any] | Vector | None = None) -> None:
        super().__init__(model, parameters)
        path = library_path(model)
        self._library = load(path)
        # single calls are shorter than giving up the GIL would take
        quick = ctypes.PyDLL(path)
        places = (ctypes.c_void_p * 4)(*(pointer(a) for a in (self.p, self.x, self._u, self._y)))
        at = ctypes.c_void_p(ctypes.addressof(places))
        self._places = places
        self._advance = functools.partial(quick.insenv_advance_at, at)  # type: ignore[method-assign]
        self._output = functools.partial(quick.insenv_output_at, at)  # type: ignore[method-assign]
        self._steps = {name: functools.partial(quick.insenv_step_at, at, k) for k, name in enumerate(model.steps)}
        self.start()

    def start(self) -> None:
        self._library.insenv_start(1, pointer(self.p), pointer(self.x))

    def run(self, n: int, inputs: Vector | None = None, every: int = 1) -> Vector:
        rows = np.ascontiguousarray(check_inputs(inputs, (n, self._u.size)) if inputs is not None else self._u)
        outputs = np.empty((n // every if every else 0, self._y.size))
        stride = rows.shape[1] if rows.ndim == 2 else 0
        self._library.insenv_run(1, pointer(self.p), pointer(self.x), pointer(rows), stride, 0, pointer(outputs), 0, every, n)
        if n:
            self._u[:] = rows[-1] if rows.ndim == 2 else rows
        return outputs

    def cycle(self, step: str, watched: Sequence[str], n: int) -> tuple[Callable[[], None], Vector]:
        spans = watched_spans(self.model, watched)
        buffer = np.zeros(cycle_size(self.model, watched, n))
        places = (ctypes.c_void_p * 5)(*(a.ctypes.data for a in (self.p, self.x, self._u, spans, buffer)))
        # the tuple lives as long as the call and keeps the addresses valid
        buffers = (places, spans, buffer, self.p, self.x, self._u)
        number = list(self.model.steps).index(step)
        sizes = (ctypes.c_int64(number), ctypes.c_int64(len(spans)), ctypes.c_int64(n))
        # releasing the GIL takes longer than a short call
        library = ctypes.PyDLL(self._library._name) if n < LONG_CYCLE else self._library
        call = functools.partial(library.insenv_cycle_at, ctypes.c_void_p(ctypes.addressof(places)), *sizes)
        call.buffers = buffers  # type: ignore[attr-defined]
        return call, buffer

    def _step(self, name: str) -> None:
        self._steps[name]()


def watched_spans(model: Model, watched: Sequence[str]) -> NDArray[np.int64]:
    """Start and stop of the state rows `watched` in the state vector, (k, 2); adjacent rows are joined."""
    spans = [(span.start, span.stop) for span in model.state.spans(watched)]
    return np.array(spans, dtype=np.int64).reshape(-1, 2)


def cycle_size(model: Model, watched: Sequence[str], n: int) -> int:
    """Number of elements that a cycle of n advances returns."""
    return n * sum(model.state[name].size for name in watched) + model.outputs.size


def check_inputs(inputs: Vector, shape: tuple[int, ...]) -> Vector:
    """`inputs` as float64 of `shape` or of its last axis; raises `InputError` for other shapes or non-finite values."""
    array = np.asarray(inputs, dtype=np.float64)
    if array.shape not in (shape, shape[-1:]):
        raise InputError(f"inputs of shape {array.shape}: allowed is {shape} or {shape[-1:]}")
    if not np.isfinite(array).all():
        place = np.argwhere(~np.isfinite(array))[0].tolist()
        raise InputError(f"inputs{place} = {array[tuple(place)]}: allowed is a finite number")
    return array


def _prepared(function: Any, arguments: tuple[Vector, ...], result: Vector) -> Callable[[], None]:
    """A call of a CasADi function on fixed buffers, without conversion or allocation."""
    buffer, trigger = function.buffer()
    for i, array in enumerate(arguments):
        buffer.set_arg(i, memoryview(array))  # type: ignore[arg-type]
    buffer.set_res(0, memoryview(result))  # type: ignore[arg-type]

    # the buffer object must live as long as the call
    def call(trigger: Callable[[], None] = trigger, owner: Any = (buffer, arguments, result)) -> None:
        trigger()

    return call


# The function that long work calls to report its progress.

Progress = Callable[[int, int], None]
"""Callback with the numbers of samples done and in all."""


def check_progress(progress: object, takes: tuple[str, ...] = ("done", "total")) -> None:
    """Raise `InputError` unless `progress` is None or a function that can be called with the arguments `takes`."""
    if progress is None:
        return
    try:
        inspect.signature(progress).bind(*takes)  # type: ignore[arg-type]
    except TypeError:
        raise InputError(f"progress = {progress!r}: allowed is None or a function of ({', '.join(takes)})") from None
    except ValueError:  # a function of C that shows no signature
        return
