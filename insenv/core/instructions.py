"""The instructions of a CasADi function of scalars, and the order in which they are written as C.

CasADi's order finishes one expression before it begins the next: few values are alive at a time, but each instruction
waits for the one before it, and a processor looks only about fifty instructions ahead.  `ordering` therefore simulates
a simple processor that issues `RATE` instructions per cycle and knows the latency of each.  Whenever the next
instruction in CasADi's order would have to wait, the first one that is ready is written before it, provided it is among
the next `WINDOW` that remain: the limit keeps the number of live values, and so the register pressure, low.  The order
changes no result.  It makes a plant and the estimators 10 to 30 % faster, batches more than single rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import accumulate
from typing import Any, NamedTuple

import casadi as ca

from insenv.base.errors import InputError
from insenv.core.elementary import select

RATE = 2.0
"""Instructions that the modelled processor issues per cycle."""
WINDOW = 300
"""How far an instruction may move forward, in instructions."""
_LATENCY = {"DIV": 13, "INV": 13, "SQRT": 18, "FLOOR": 8}  # cycles
_USUAL_LATENCY = 4

EXPRESSIONS = {
    "ADD": "{}+{}",
    "SUB": "{}-{}",
    "MUL": "{}*{}",
    "DIV": "{}/{}",
    "INV": "1.0/{}",
    "NEG": "-{}",
    "TWICE": "2.0*{}",
    "SQ": "square({})",
    "SQRT": "root({})",
    "FLOOR": "whole({})",
    "FABS": "absolute({})",
    "LT": "less({}, {})",
    "LE": "less_or_equal({}, {})",
    "EQ": "equal({}, {})",
    "NE": "not_equal({}, {})",
    "NOT": "negation({})",
    "AND": "both({}, {})",
    "OR": "either({}, {})",
    "IF_ELSE_ZERO": "select0({}, {})",
    "ASSIGN": "{}",
    "CONST": "constant({})",
}
"""The operations that IEEE 754 rounds in exactly one way, and a constant; no others are allowed."""
REPLACED = {
    "SIN": "sin", "COS": "cos", "TAN": "sin_cos", "ASIN": "atan2", "ACOS": "atan2", "ATAN": "atan2", "ATAN2": "atan2",
    "EXP": "exp", "LOG": "log", "POW": "exp and log", "FMIN": "minimum", "FMAX": "maximum",
}  # fmt: skip
"""Functions of `insenv.core.elementary` in place of operations of CasADi that are not among them."""


class Instruction(NamedTuple):
    """One operation.

    name: CasADi's name without ``OP_``.
    sources: numbers of the instructions whose values it uses.
    place: for INPUT and OUTPUT, the number of the argument or result and the element in it.
    value: for CONST, the number.
    single: whether it is done in single precision (`insenv.core.precision`).
    """

    name: str
    sources: tuple[int, ...] = ()
    place: tuple[int, int] = (0, 0)
    value: float = 0.0
    single: bool = False

    @property
    def is_leaf(self) -> bool:
        """Whether it uses no other instruction's value."""
        return self.name in ("INPUT", "CONST")


def instructions(function: Any) -> list[Instruction]:
    """The instructions of an SX function, in CasADi's order."""
    names = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
    holder: dict[int, int] = {}
    listed = []
    name_of, input_of, output_of = function.instruction_id, function.instruction_input, function.instruction_output
    for k in range(function.n_instructions()):
        name, target = names[name_of(k)], output_of(k)
        if name == "CONST":
            listed.append(Instruction(name, value=float(function.instruction_constant(k))))
        elif name == "INPUT":
            argument, element = input_of(k)
            listed.append(Instruction(name, place=(argument, element)))
        elif name == "OUTPUT":
            listed.append(Instruction(name, (holder[input_of(k)[0]],), (target[0], target[1])))
            continue
        else:
            listed.append(Instruction(name, tuple([holder[place] for place in input_of(k)])))
        holder[target[0]] = k
    return listed


def check_exact(function: Any) -> None:
    """Raise `InputError` for an SX function with an operation that is not among the `EXPRESSIONS`."""
    names = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
    allowed = {getattr(ca, f"OP_{name}") for name in (*EXPRESSIONS, "INPUT", "OUTPUT")}
    used = {function.instruction_id(k) for k in range(function.n_instructions())} - allowed
    if used:
        name = names[min(used)]
        instead = (
            f"{REPLACED[name]} of insenv.core.elementary" if name in REPLACED else "the functions of insenv.core.elementary"
        )
        raise InputError(
            f"casadi's {name.lower()} is not exactly rounded: its bits differ between machines: allowed is {instead}"
        )


def ordering(steps: Sequence[Instruction], after: Mapping[int, Sequence[int]]) -> list[int]:
    """The numbers of the instructions in the order to write them; each leaf comes just before its first use.

    after: by instruction, further instructions that must come before it.
    """
    needs = [(*step.sources, *after.get(k, ())) for k, step in enumerate(steps)]
    leaf = [step.is_leaf for step in steps]
    latency = [_LATENCY.get(step.name, _USUAL_LATENCY) for step in steps]
    users: list[list[int]] = [[] for _ in steps]
    missing, soonest = [0] * len(steps), [0.0] * len(steps)
    for k, needed in enumerate(needs):
        for source in set(needed):
            if not leaf[source]:
                users[source].append(k)
                missing[k] += 1
    ready = [k for k in range(len(steps)) if not leaf[k] and not missing[k]]
    waiting: list[tuple[float, int]] = []
    rank = list(accumulate(not is_leaf for is_leaf in leaf))
    written: dict[int, None] = {}  # in order
    time, done = 0.0, 0
    while ready or waiting:
        while waiting and waiting[0][0] <= time:
            heappush(ready, heappop(waiting)[1])
        if not ready or rank[ready[0]] > done + WINDOW:
            time = waiting[0][0]
            continue
        k = heappop(ready)
        for source in needs[k]:
            written[source] = None  # one that is there keeps its place
        written[k] = None
        known = time + latency[k]
        time, done = time + 1.0 / RATE, done + 1
        for user in users[k]:
            missing[user] -= 1
            if known > soonest[user]:
                soonest[user] = known
            if not missing[user]:
                heappush(waiting, (soonest[user], user))
    return list(written)


# Looking up a row of a table in a model, and how it becomes a loop in C.
#
# A model looks up row k of a parameter by a sum over all rows, each times whether it is the one (`row_of`).  Written out, that
# is ten thousand instructions for a table of some hundred rows, for which a compiler takes minutes.  A step that does nothing
# else is therefore recognised by its instructions (`table_loop`) and written as a loop of the same operations in the same
# order, so that its result has the same bits.

SMALLEST_TABLE = 32
"""A table with fewer rows is written out."""


def row_of(table: Any, number: Any) -> list[Any]:
    """The elements of row `number` (0, 1, ...) of a table (rows, columns) of symbols; 0 if there is no such row."""
    rows, columns = table.shape
    elements = [ca.SX(0)] * columns
    for k in range(rows):
        here = number == float(k)
        elements = [value + select(here, table[k, c], 0.0) for c, value in enumerate(elements)]
    return elements


Term = tuple[tuple[int, int], float, tuple[int, int]]
"""Argument and place of the number of the row, the number, argument and place of the element that it selects."""


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
    chains = [chain for step in outputs if (chain := _chain(steps, step.sources[0])) and len(chain) >= SMALLEST_TABLE]
    if len(chains) < len(outputs):
        return None
    (index, _, (argument, first)), (_, _, (_, second)) = chains[0][:2]
    count, stride = len(chains[0]), second - first
    firsts = tuple(chain[0][2][1] for chain in chains)
    for chain, first in zip(chains, firsts, strict=True):
        if chain != [(index, float(k), (argument, first + stride * k)) for k in range(count)]:
            return None
    return Loop(count, index, argument, firsts, stride)


def _chain(steps: Sequence[Instruction], last: int) -> list[Term] | None:
    """Index, number and place of each term of a sum of selected elements, in order; None if it is no such sum."""
    terms = []
    while True:
        step = steps[last]
        selection = last if step.name == "IF_ELSE_ZERO" else step.sources[1] if step.name == "ADD" else -1
        term = _term(steps, selection)
        if term is None:
            return None
        terms.append(term)
        if step.name == "IF_ELSE_ZERO":
            return terms[::-1]
        last = step.sources[0]


def _term(steps: Sequence[Instruction], at: int) -> Term | None:
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
