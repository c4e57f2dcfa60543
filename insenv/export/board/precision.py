"""The precisions in which a filter is exported, and what one costs in accuracy, measured on the run of the export.

double: all in double precision, the bits of `insenv run`.  mixed: the covariance, and all operations from it to it, in single
precision (`insenv.core.precision`); navigation, innovations and corrections in double precision.  float32: all in single
precision but the rows `DOUBLE`, and the operations whose rounding would change them or an innovation.  The expected outputs of
such a filter are those of its own C, compiled for this machine.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping

import numpy as np

from insenv.base.errors import InputError
from insenv.core import symmetric
from insenv.core.compile import compile_library, find_compiler, pointer
from insenv.core.model import Model
from insenv.core.precision import Tolerance
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Vector
from insenv.estimators.fusion.composition import NAVIGATION
from insenv.evaluation.errors import errors, stated_sigma, track_of
from insenv.export.board.tuned import Running, Tuned
from insenv.scenario.inputs import SAMPLES

NEEDED: Mapping[str, tuple[str, ...]] = {"double": (), "mixed": ("covariance",), "float32": ("covariance", "q_wb", "q_ew")}
"""By name of a precision, the rows of the state that a filter must have."""
TOGETHER = ("accel_bias", "accel_scale")
"""Error states whose covariance with each other stays in double precision: gravity shows their sum, far better than each."""
DOUBLE: Mapping[str, float] = {
    "q_wb": 1e-10,
    "velocity_w": 1e-7,
    "q_ew": 1e-12,
    "height": 1e-6,
    "way_w": 1e-6,
    "past_way": 1e-6,
    "still_velocity": 1e-8,
    "still_velocity_square": 1e-8,
}
"""Rows that stay in double precision in a filter of float32, SI, and the largest change by the rounding of one operation.

They are sums over all samples: an attitude in single precision turns by up to 3e-8 rad a sample, always in the same direction
while a vehicle drives straight, a velocity of 30 m/s gains 1e-6 m/s, as from an accelerometer bias of 20 ug at 200 Hz; an angle
of 1e-7 rad is 0.6 m on the ground; the way since the start is needed as a difference over a second; and the specific force of a
vehicle at rest scatters by a millionth of its square.
"""
SHOWN: Mapping[str, float] = {"q_nb": 1e-9, "velocity_n": 1e-7, "latitude": 1e-12, "longitude": 1e-12, "height": 1e-6}
"""The same of the outputs."""
INNOVATION = 1e-5
"""The same of the innovations that a filter reports, which are the difference of large numbers, in their unit."""
SHARE = 3e-8
"""The same of the covariance of the states `TOGETHER`, as a share of its last value: less than the rounding of a result."""
_SIGMA = "_estimate_sigma"
BLOCK = 1000
"""Samples of a run in which a step is looked at once, after the first ones."""
POINTS = 20
"""Samples at which the effect of rounding on a step is computed."""
MOST = 0.05
"""Largest difference from double precision, as a share of the stated sigma, with which a filter is exported."""


INSTEAD = "export this filter in double precision"


def single_elements(precision: str, model: Model) -> list[bool]:
    """Whether each element of the state is kept in single precision; empty in double precision.

    Raises `InputError` for another precision than those of `NEEDED`, and for a model without the rows that it needs.
    """
    if precision not in NEEDED:
        raise InputError(f"precision = {precision!r}: allowed is {', '.join(map(repr, NEEDED))}")
    if precision == "double":
        return []
    for name in NEEDED[precision]:
        if name not in model.state:
            raise InputError(
                f"precision = {precision!r}: {model.id} keeps no {name}; allowed is a filter that does, or 'double'"
            )
    covariance, together = model.state.slice("covariance"), _together(model)
    single = [precision == "float32" and row.name not in DOUBLE for row in model.state for _ in range(row.size)]
    single[covariance] = [place not in together for place in range(covariance.stop - covariance.start)]
    return single


def _together(model: Model) -> set[int]:
    """The places in the covariance of the states `TOGETHER`, if the model has them all."""
    names: list[str] = []
    for row in model.outputs:
        if row.name.endswith(_SIGMA):
            names += [row.name.removesuffix(_SIGMA)] * row.size
    states = [NAVIGATION + k for k, name in enumerate(names) if name in TOGETHER] if set(TOGETHER) <= set(names) else []
    return {symmetric.place(i, j) for i in states for j in states}


def tolerance(precision: str, ready: Tuned) -> Tolerance | None:
    """By which operations of a filter are in single precision; None: by the elements of its state (`insenv.core.precision`)."""
    if precision != "float32":
        return None
    model, known = ready.estimator.model, points(ready)
    single, covariance = single_elements(precision, model), model.state.slice("covariance")
    between = [single[k] and covariance.start <= k < covariance.stop for k in range(model.state.size)]
    state, outputs = (
        [rows.get(row.name, math.inf) for row in table for _ in range(row.size)]
        for rows, table in ((DOUBLE, model.state), (SHOWN, model.outputs))
    )
    for row in model.state:
        if row.name.endswith("innovation"):
            state[model.state.slice(row.name)] = [INNOVATION] * row.size
    last = known["output"][1][-1]
    for k in range(covariance.start, covariance.stop):
        if not single[k] and last[k] != 0.0:
            state[k] = SHARE * abs(float(last[k]))
    return Tolerance(between, state, outputs, known)


def points(ready: Tuned) -> dict[str, tuple[Array, ...]]:
    """The arguments of the functions of a filter at samples of its run: the first ones, and then those of most measurements.

    By name of the function, parameters, state before the sample and inputs (points, size each); of a step those samples, if
    there are any, at which it runs.
    """
    model, runner = ready.estimator.model, make_runner(ready.estimator.model, ready.parameters)
    before, taken, after = [], [], []
    flags = [model.inputs.slice(row.name).start for row in model.inputs if row.flag]
    first = SAMPLES
    for part in ready.inputs():
        first = min(first, len(part))
        stops = [*range(first), *(k + int(part[k : k + BLOCK, flags].sum(1).argmax()) for k in range(first, len(part), BLOCK))]
        done = first = 0
        for stop in stops:
            runner.run(stop - done, part[done:stop], 0)
            before.append(runner.x.copy())
            runner.run(1, part[stop : stop + 1], 0)
            after.append(runner.x.copy())
            done = stop + 1
        taken.append(part[stops])
        runner.run(len(part) - done, part[done:], 0)
    p, x, moved, u = ready.parameters[None], np.array(before), np.array(after), np.vstack(taken)
    found: dict[str, tuple[Array, ...]] = {"start": (p, np.zeros((1, 0))), "output": (p, moved[:: -(-len(moved) // POINTS)])}
    for name, step in model.steps.items():
        here = np.ones(len(u), bool)
        if step.when is not None:
            table, column = (model.state, moved) if step.when in model.state else (model.inputs, u)
            here = column[:, table.slice(step.when).start] != 0.0
        chosen = np.flatnonzero(here if here.any() else ~here)
        chosen = chosen[np.linspace(len(chosen) // 2, len(chosen) - 1, min(POINTS, len(chosen))).astype(int)]
        found[name] = (p, x[chosen], u[chosen], np.zeros((1, 0)))
    return found


class Compiled:
    """An exported filter, compiled for this machine; it is run as an `insenv.core.runner.Runner` is.

    source: C text of the filter, its header and ``c/run.c`` in one.  parameters: flat.

    Raises `InputError` without a C compiler, and where the filter does, as one whose variances become negative.
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
            raise InputError(f"precision: {self._model.id} ends with status {status} in it: {INSTEAD}")


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
        raise InputError(f"precision: {worst(shares)}; allowed is {MOST:g}: {INSTEAD}")
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
