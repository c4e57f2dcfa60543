"""The precisions in which a filter is exported, and what one costs in accuracy, measured on the run of the export.

double: all in double precision, the bits of `insenv run`.  mixed: the covariance, and all operations from it to it, in single
precision (`insenv.core.precision`); navigation, innovations and corrections in double precision.  The expected outputs of a
mixed filter are those of its own C, compiled for this machine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.core.compile import compile_library, find_compiler, pointer
from insenv.core.model import Model
from insenv.core.tables import Array, Vector
from insenv.evaluation.errors import errors, stated_sigma, track_of
from insenv.export.board.tuned import Running, Tuned

PRECISIONS: Mapping[str, frozenset[str]] = {"double": frozenset(), "mixed": frozenset({"covariance"})}
"""By name, the rows of the state that are kept in single precision."""
MOST = 0.05
"""Largest difference from double precision, as a share of the stated sigma, with which a filter is exported."""


def single_rows(precision: str, model: Model) -> frozenset[str]:
    """The rows of the state that are kept in single precision.

    Raises `InputError` for another precision than those of `PRECISIONS`, and for a model without these rows.
    """
    if precision not in PRECISIONS:
        raise InputError(f"precision = {precision!r}: allowed is {' or '.join(map(repr, PRECISIONS))}")
    for name in PRECISIONS[precision]:
        if name not in model.state:
            raise InputError(f"precision = {precision!r}: {model.id} keeps no {name}, so that 'double' is allowed alone")
    return PRECISIONS[precision]


class Compiled:
    """An exported filter, compiled for this machine; it is run as an `insenv.core.runner.Runner` is.

    source: C text of the filter, its header and ``c/run.c`` in one.  parameters: flat.

    Raises `InputError` without a C compiler.
    """

    def __init__(self, source: str, model: Model, parameters: Vector) -> None:
        compiler = find_compiler()
        if compiler is None:
            raise InputError("precision: another than 'double' needs a C compiler on this machine (cc, gcc, clang, ziglang)")
        self._model = model
        self._library = ctypes.CDLL(str(compile_library(source, compiler)))
        self._library.run_size.restype = ctypes.c_ulong
        self._memory = ctypes.create_string_buffer(self._library.run_size())
        self._judge(self._library.run_start(self._memory, ctypes.c_void_p(pointer(parameters))))

    def output(self) -> Vector:
        """The outputs of the current state (outputs.size,)."""
        return self._run(0, np.zeros(0), 1)[0]

    def run(self, count: int, inputs: Array, every: int = 1, /) -> Array:
        """Take `count` samples (count, inputs.size); outputs (count // every, outputs.size) after every `every`-th."""
        return self._run(count, np.ascontiguousarray(inputs), every)[: count // every]

    def _run(self, count: int, inputs: Array, every: int) -> Array:
        outputs = np.zeros((max(1, count // every), self._model.outputs.size))
        at, to = ctypes.c_void_p(pointer(inputs)), ctypes.c_void_p(pointer(outputs))
        self._judge(self._library.run_samples(self._memory, at, ctypes.c_long(count), ctypes.c_long(every), to))
        return outputs

    def _judge(self, status: int) -> None:
        if status:
            raise InsenvError(f"the exported {self._model.id} ends with status {status}: the list is in its header")


def run_shares(ready: Tuned, runner: Running) -> dict[str, float]:
    """`largest_shares` over the run of an export, of a filter in another precision from the one in double precision.

    Raises `InputError` as `checked`: a covariance of states that are known far better together than each by
    itself, as tilt and accelerometer bias with centimetre fixes, needs more digits.
    """
    here, expected = (np.vstack([outputs for _, outputs in ready.run(each)]) for each in (runner, ready.runner()))
    return checked(largest_shares(ready.estimator.model, here, expected))


def checked(shares: dict[str, float]) -> dict[str, float]:
    """The shares, each at most `MOST`.  Raises `InputError` if one is larger, or no number."""
    if not all(share <= MOST for share in shares.values()):
        raise InputError(f"precision: {worst(shares)}; allowed is {MOST:g}: export this filter in double precision")
    return shares


def worst(shares: Mapping[str, float]) -> str:
    """What the precision costs, in a sentence."""
    name = max(shares, key=lambda each: np.nan_to_num(shares[each], nan=np.inf))
    return f"outputs differ from those in double precision by up to {shares[name]:.2g} of their stated sigma ({name})"


def largest_shares(model: Model, here: Array, expected: Array) -> dict[str, float]:
    """Largest difference between two series of outputs (n, outputs.size), as a share of the sigma that `expected` states.

    By channel of `insenv.evaluation.errors`, and by row of an estimated error of the unit.
    """
    one, other = model.outputs.unpack(here), model.outputs.unpack(expected)
    time = np.arange(len(here), dtype=np.float64)
    found, sigma = errors(track_of(time, one), track_of(time, other)), stated_sigma(other)
    shares = {name: _largest(found[name], sigma[name]) for name in found if name in sigma}
    for name in model.outputs.names:
        if (stated := f"{name}_estimate_sigma") in model.outputs:
            shares[name] = _largest(one[name] - other[name], other[stated])
    return shares


def _largest(difference: Array, sigma: Array) -> float:
    """Largest difference over sigma; 0 of what is the same, whatever its sigma, and no number if there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(difference == 0.0, 0.0, np.abs(difference) / sigma)))
