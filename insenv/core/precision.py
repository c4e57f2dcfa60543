"""Some rows of a state in single precision: which operations of a function are then done in it, and the conversions.

An operation is done in single precision if its value is computed from a value of single precision and one of single precision
is computed from it.  So the covariance is propagated and updated in single precision, with gains and factors of innovations
that come from it and return to it; what enters it (transition, noise) and what leaves it (the corrected state) is in double
precision.  Where the precision changes, an instruction SINGLE or DOUBLE converts the value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from insenv.base.errors import InputError
from insenv.core.instructions import Instruction


def in_precisions(steps: Sequence[Instruction], argument: int, results: Sequence[bool]) -> list[Instruction]:
    """The instructions of a function with those of single precision marked, and the conversions between.

    argument: number of the one that is of single precision.  results: whether each result is.

    Raises `InputError` for a constant that single precision cannot hold.
    """
    single = _single(steps, argument, results)
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


def _single(steps: Sequence[Instruction], argument: int, results: Sequence[bool]) -> list[bool]:
    """Whether each instruction is done in single precision; a constant may be in both."""
    comes: list[bool] = []
    for step in steps:
        comes.append(step.place[0] == argument if step.name == "INPUT" else any(comes[source] for source in step.sources))
    goes = [step.name == "OUTPUT" and results[step.place[1]] for step in steps]
    for k in reversed(range(len(steps))):
        for source in steps[k].sources:
            goes[source] |= goes[k]
    at_ends = {"INPUT": comes, "OUTPUT": goes}
    return [at_ends[step.name][k] if step.name in at_ends else comes[k] and goes[k] for k, step in enumerate(steps)]


def _rounded(value: float) -> float:
    """A constant in single precision."""
    with np.errstate(over="ignore"):
        number = float(np.float32(value))
    if not np.isfinite(number) or (number == 0.0 and value != 0.0):
        raise InputError(f"a constant of the model is {value!r}: allowed in single precision is 1e-38 to 3e38")
    return number
