"""Looking up a row of a table in a model, and how it becomes a loop in C.

A model looks up row k of a parameter by a sum over all rows, each times whether it is the one (`row_of`).  Written out, that
is ten thousand instructions for a table of some hundred rows, for which a compiler takes minutes.  A step that does nothing
else is therefore recognised by its instructions (`table_loop`) and written as a loop of the same operations in the same
order, so that its result has the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.instructions import Instruction

LEAST = 32
"""A table with fewer rows is written out."""


def row_of(table: Any, number: Any) -> list[Any]:
    """The elements of row `number` (0, 1, ...) of a table (rows, columns) of symbols; 0 if there is no such row."""
    rows, columns = table.shape
    found = [ca.SX(0)] * columns
    for k in range(rows):
        here = number == float(k)
        found = [value + select(here, table[k, c], 0.0) for c, value in enumerate(found)]
    return found


@dataclass(frozen=True)
class Loop:
    """The look-up of a row: `count` rows; index: argument and place of the number of the row; argument: that of the table;
    firsts, stride: place of each result in row 0, and from row to row."""

    count: int
    index: tuple[int, int]
    argument: int
    firsts: tuple[int, ...]
    stride: int

    def text(self, arguments: str) -> list[str]:
        """Lines of C that write the results to y."""
        table, index = arguments[self.argument], f"{arguments[self.index[0]]}[{self.index[1]}]"
        terms = [f"select0(here, {table}[{first}+{self.stride}*k])" for first in self.firsts]
        return [
            f"const real number = {index};",
            "{",
            "  const int k = 0;",
            "  const real here = equal(number, constant(0.0));",
            *(f"  y[{place}] = {term};" for place, term in enumerate(terms)),
            "}",
            f"for (int k = 1; k < {self.count}; k++) {{",
            "  const real here = equal(number, constant((double)k));",
            *(f"  y[{place}] = y[{place}]+{term};" for place, term in enumerate(terms)),
            "}",
        ]


def table_loop(steps: Sequence[Instruction]) -> Loop | None:
    """The loop of a function that does nothing but look up a row; None for any other function."""
    outputs = [step for step in steps if step.name == "OUTPUT"]
    if {step.name for step in steps} != {"INPUT", "CONST", "EQ", "IF_ELSE_ZERO", "ADD", "OUTPUT"} or not outputs:
        return None
    chains = [_chain(steps, step.sources[0]) for step in outputs]
    if any(chain is None or len(chain) < LEAST for chain in chains):
        return None
    index, argument = chains[0][0][0], chains[0][0][2][0]  # type: ignore[index]
    count, stride = len(chains[0]), chains[0][1][2][1] - chains[0][0][2][1]  # type: ignore[arg-type, index]
    firsts = []
    for chain in chains:
        assert chain is not None
        firsts.append(chain[0][2][1])
        expected = [(index, float(k), (argument, firsts[-1] + stride * k)) for k in range(count)]
        if chain != expected:
            return None
    return Loop(count, index, argument, tuple(firsts), stride)


def _chain(steps: Sequence[Instruction], last: int) -> list[tuple[tuple[int, int], float, tuple[int, int]]] | None:
    """Index, number and place of each term of a sum of selected elements, in order; None if it is no such sum."""
    found = []
    while True:
        step = steps[last]
        one = last if step.name == "IF_ELSE_ZERO" else step.sources[1] if step.name == "ADD" else -1
        term = _term(steps, one)
        if term is None:
            return None
        found.append(term)
        if step.name == "IF_ELSE_ZERO":
            return found[::-1]
        last = step.sources[0]


def _term(steps: Sequence[Instruction], at: int) -> tuple[tuple[int, int], float, tuple[int, int]] | None:
    """Index, number and place of ``number == index ? element : 0``."""
    if at < 0 or steps[at].name != "IF_ELSE_ZERO":
        return None
    condition, element = (steps[k] for k in steps[at].sources)
    if condition.name != "EQ" or element.name != "INPUT":
        return None
    sides = [steps[k] for k in condition.sources]
    inputs = [side.place for side in sides if side.name == "INPUT"]
    numbers = [side.value for side in sides if side.name == "CONST"]
    return (inputs[0], numbers[0], element.place) if len(inputs) == len(numbers) == 1 else None
