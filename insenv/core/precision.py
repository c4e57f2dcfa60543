"""Some rows of a state in single precision: which operations of a function are then done in it, and the conversions.

Two rules say which.  `between_single` keeps to what is in single precision: an operation is done in it if its value is computed
from a value of single precision and one of single precision is computed from it.  So a covariance is propagated and updated in
single precision, with gains and factors of innovations that come from it and return to it; what enters it (transition, noise)
and what leaves it (the corrected state) is in double precision.

`without_effect` adds the operations whose rounding changes no element that is in double precision by more than is tolerated.
The change is the rounding of the operation and of its operands times the derivative of the element with respect to it, along
the way through the function that gives most, at samples of a run; both branches of a choice are ways.  So an attitude is summed
up in double precision and each of its increments computed in single.

Where the precision changes, an instruction SINGLE or DOUBLE converts the value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.instructions import Instruction
from insenv.core.tables import Array

ROUNDING = 2.0**-24
"""Largest relative error of a number in single precision."""
RANGE = 1e-30, 1e30
"""Magnitudes whose products and quotients with those of a filter stay within single precision."""


@dataclass(frozen=True, eq=False)
class Tolerance:
    """What the rounding of one operation may change.

    between: whether each element of the state is one between which all operations are in single precision.  state, outputs:
    the largest change of each element; infinity: any.  points: by name of a function of the model, the values (points, size)
    of its arguments at samples at which it runs.
    """

    between: Sequence[bool]
    state: Sequence[float]
    outputs: Sequence[float]
    points: Mapping[str, Sequence[Array]]


def in_precisions(steps: Sequence[Instruction], single: Sequence[bool]) -> list[Instruction]:
    """The instructions of a function with those of single precision marked, and the conversions between.

    single: whether each instruction is done in single precision; of a constant it is not used, it may be in both.

    Raises `InputError` for a constant that single precision cannot hold.
    """
    written: list[Instruction] = []
    holder: dict[tuple[int, bool], int] = {}  # by instruction and precision, the one that holds its value

    def hold(k: int, precision: bool, step: Instruction) -> None:
        holder[k, precision] = len(written)
        written.append(step._replace(single=precision))

    def value(k: int, precision: bool) -> int:
        """The instruction that holds the value of instruction k in this precision."""
        if (k, precision) not in holder:
            if steps[k].name == "CONST":
                hold(k, precision, steps[k]._replace(value=_rounded(steps[k].value) if precision else steps[k].value))
            else:
                hold(k, precision, Instruction("SINGLE" if precision else "DOUBLE", (holder[k, not precision],)))
        return holder[k, precision]

    for k, step in enumerate(steps):
        if step.name != "CONST":
            hold(k, single[k], step._replace(sources=tuple([value(source, single[k]) for source in step.sources])))
    return written


def between_single(steps: Sequence[Instruction], ends: Sequence[bool]) -> list[bool]:
    """Whether each instruction is done in single precision: it comes from a value of single precision and goes to one.

    ends: whether each INPUT or OUTPUT is of single precision; of other instructions it is not used.
    """
    comes: list[bool] = []
    for k, step in enumerate(steps):
        comes.append(ends[k] if step.name == "INPUT" else any(comes[source] for source in step.sources))
    goes = [step.name == "OUTPUT" and ends[k] for k, step in enumerate(steps)]
    for k in reversed(range(len(steps))):
        for source in steps[k].sources:
            goes[source] |= goes[k]
    return [ends[k] if step.name in _ENDS else comes[k] and goes[k] for k, step in enumerate(steps)]


_ENDS = ("INPUT", "OUTPUT")
_Partials = Callable[..., tuple[Any, ...]]
_OPERATIONS: Mapping[str, tuple[Callable[..., Any], _Partials]] = {
    "ADD": (np.add, lambda v, a, b: (1.0, 1.0)),
    "SUB": (np.subtract, lambda v, a, b: (1.0, 1.0)),
    "MUL": (np.multiply, lambda v, a, b: (b, a)),
    "DIV": (np.divide, lambda v, a, b: (1.0 / b, v / b)),
    "INV": (np.reciprocal, lambda v, a: (v * v,)),
    "NEG": (np.negative, lambda v, a: (1.0,)),
    "TWICE": (lambda a: 2.0 * a, lambda v, a: (2.0,)),
    "SQ": (np.square, lambda v, a: (2.0 * a,)),
    "SQRT": (np.sqrt, lambda v, a: (0.5 / v,)),
    "FLOOR": (np.floor, lambda v, a: (0.0,)),
    "FABS": (np.fabs, lambda v, a: (1.0,)),
    "LT": (np.less, lambda v, a, b: (0.0, 0.0)),
    "LE": (np.less_equal, lambda v, a, b: (0.0, 0.0)),
    "EQ": (np.equal, lambda v, a, b: (0.0, 0.0)),
    "NE": (np.not_equal, lambda v, a, b: (0.0, 0.0)),
    "NOT": (np.logical_not, lambda v, a: (0.0,)),
    "AND": (np.logical_and, lambda v, a, b: (0.0, 0.0)),
    "OR": (np.logical_or, lambda v, a, b: (0.0, 0.0)),
    "IF_ELSE_ZERO": (lambda a, b: np.where(a != 0.0, b, 0.0), lambda v, a, b: (0.0, 1.0)),  # as if it were chosen
    "ASSIGN": (np.positive, lambda v, a: (1.0,)),
}
"""By operation: its value, and the sizes of its derivatives with respect to the operands."""


def without_effect(
    steps: Sequence[Instruction], single: Sequence[bool], arguments: Sequence[Array], tolerated: Sequence[float]
) -> list[bool]:
    """Whether each instruction is done in single precision: its rounding has no effect that is not tolerated.

    single: of INPUT and OUTPUT; of other instructions: those that are in it in any case, beyond which no effect is followed.
    arguments: values (points, size) of each argument.  tolerated: largest change of each result; infinity: any.
    """
    values: list[Array] = []
    chosen = list(single)
    with np.errstate(all="ignore"):
        for step in steps:
            operands = [values[source] for source in step.sources]
            if step.name == "INPUT":
                values.append(arguments[step.place[0]][:, step.place[1]])
            elif step.name == "CONST":
                values.append(np.array([step.value]))
            else:
                values.append(operands[0] if step.name == "OUTPUT" else np.asarray(_OPERATIONS[step.name][0](*operands), float))
        effect = [np.zeros(1)] * len(steps)  # of a change of the value, in shares of what is tolerated
        for k in reversed(range(len(steps))):
            step, operands = steps[k], [values[source] for source in steps[k].sources]
            if step.name == "OUTPUT":
                (source,) = step.sources
                effect[source] = np.maximum(effect[source], 1.0 / tolerated[step.place[1]])
            elif not step.is_leaf and not single[k]:
                rounded = _times(effect[k], values[k])
                for source, partial in zip(step.sources, _OPERATIONS[step.name][1](values[k], *operands), strict=True):
                    here = _times(effect[k], partial)
                    effect[source] = np.maximum(effect[source], here)
                    rounded = rounded + _times(here, values[source])
                in_range = all(_in_range(value) for value in (values[k], *operands))
                chosen[k] = bool(in_range and np.all(rounded * ROUNDING <= 1.0))  # false where it is no number
    return chosen


def _times(effect: Array, value: Any) -> Array:
    """An effect times the size of a value; nothing has none, though the value may be infinite."""
    return np.where(effect == 0.0, 0.0, effect * np.abs(value))


def _in_range(value: Array) -> bool:
    """Whether single precision holds these numbers."""
    size = np.abs(value)
    return bool(np.all((size == 0.0) | ((size > RANGE[0]) & (size < RANGE[1]))))


def _rounded(value: float) -> float:
    """A constant in single precision."""
    with np.errstate(over="ignore"):
        number = float(np.float32(value))
    if not np.isfinite(number) or (number == 0.0 and value != 0.0):
        raise InputError(f"a constant of the model is {value!r}: allowed in single precision is 1e-38 to 3e38")
    return number
