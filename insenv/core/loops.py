"""A long function as loops over expressions of the same form: the update of a covariance is thousands of equal ones.

Compilers need more than proportional time for a long function, and a processor more time to fetch instructions than to run
them.  The instructions are therefore cut into expressions at every value that is used more than once.  Expressions of the
same form that do not use each other become one loop (`Unit`); what is left is written out, in pieces that are short enough
for a compiler.  Values go from one unit to the next through an array `w`; a place in it is used again once its value has been
used for the last time.  No operation and no operand changes, so that no result changes.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush

from insenv.core.instructions import Instruction

LONG = 3000
"""Instructions from which a function is written in loops and pieces."""
LONGEST = 1500
"""Statements of a piece."""
SMALLEST_LOOP = 6
"""Expressions of the same form that are worth a loop."""


@dataclass(frozen=True)
class Unit:
    """Expressions of the same form; none uses another.  One expression is written out, several are a loop.

    roots: the last instruction of each.
    work: the instructions of the first one, in order.
    operands: by instruction of `work`, the places in `columns` of its sources; None for a source that is in `work`.
    columns: each operand of the first expression, as a tuple of that operand of all expressions: instructions whose values are
        there before, elements of arguments, or constants.
    """

    roots: tuple[int, ...]
    work: tuple[int, ...]
    operands: dict[int, tuple[int | None, ...]]
    columns: tuple[tuple[int, ...], ...]

    @cached_property
    def sources(self) -> set[int]:
        """All operands."""
        return {k for column in self.columns for k in column}

    @property
    def statements(self) -> int:
        """Statements that it is written as."""
        return len(self.work) + len(self.columns) + 1


@dataclass(frozen=True)
class Plan:
    """pieces: the units in order, in lists that are functions.  places: place in w by instruction whose value goes through it.
    size: of w.  single_size: of the array beside it for values of single precision."""

    pieces: list[list[Unit]]
    places: dict[int, int]
    size: int
    single_size: int


def plan(steps: Sequence[Instruction], least: int = SMALLEST_LOOP, longest: int = LONGEST) -> Plan:
    """How a function of these instructions is written; it may not change its arguments."""
    pieces: list[list[Unit]] = [[]]
    room = longest
    for unit in _in_order(steps, _units(steps, least)):
        if pieces[-1] and unit.statements > room:
            pieces.append([])
            room = longest
        pieces[-1].append(unit)
        room -= unit.statements
    return Plan(pieces, *_places(steps, pieces))


def _units(steps: Sequence[Instruction], least: int) -> list[Unit]:
    """The expressions, of which those of the same form and depth are together if there are at least `least` of them."""
    uses = [0] * len(steps)
    for step in steps:
        for source in step.sources:
            uses[source] += 1
    ends = [not step.is_leaf and (step.name == "OUTPUT" or uses[k] != 1) for k, step in enumerate(steps)]

    numbers: dict[tuple[object, ...], int] = {}  # of the forms
    form, depth = [0] * len(steps), [0] * len(steps)  # depth: expressions that must come before, one after the other
    alike = defaultdict(list)
    for k, step in enumerate(steps):
        if step.is_leaf:
            shape: tuple[object, ...] = (step.name, step.single, step.place[0], step.value.hex())
        else:
            shape = (step.name, step.single, *("value" if ends[source] else form[source] for source in step.sources))
            depth[k] = max((depth[source] + ends[source] for source in step.sources), default=0)
        form[k] = numbers.setdefault(shape, len(numbers))
        if ends[k]:
            alike[depth[k], form[k]].append(k)

    groups = (group for roots in alike.values() for group in ([roots] if len(roots) >= least else [[root] for root in roots]))
    return [_unit(steps, ends, group) for group in groups]


def _unit(steps: Sequence[Instruction], ends: Sequence[bool], roots: Sequence[int]) -> Unit:
    """The unit of expressions of the same form; ends: whether an expression ends with the instruction."""
    rows = []
    for root in roots:
        work, row = [root], list[int]()
        for k in work:  # grows
            for source in steps[k].sources:
                (row if ends[source] or steps[source].is_leaf else work).append(source)
        rows.append((work, row))
    work = rows[0][0]
    inside = set(work)
    columns = list(zip(*(row for _, row in rows), strict=True))
    different = {column: c for c, column in enumerate(dict.fromkeys(columns))}
    operand = iter(columns)
    operands = {k: tuple(None if source in inside else different[next(operand)] for source in steps[k].sources) for k in work}
    return Unit(tuple(roots), tuple(sorted(work)), operands, tuple(different))


def _in_order(steps: Sequence[Instruction], units: Sequence[Unit]) -> list[Unit]:
    """The units in an order in which each has its operands; of those that have them, the one first in the function."""
    unit_of = {root: number for number, unit in enumerate(units) for root in unit.roots}
    needs = [{unit_of[k] for k in unit.sources if not steps[k].is_leaf} for unit in units]
    users: list[list[int]] = [[] for _ in units]
    for number, needed in enumerate(needs):
        for source in needed:
            users[source].append(number)
    missing = [len(needed) for needed in needs]
    ready: list[tuple[int, int]] = []
    for number, count in enumerate(missing):
        if not count:
            heappush(ready, (units[number].roots[0], number))
    order = []
    while ready:
        number = heappop(ready)[1]
        order.append(units[number])
        for user in users[number]:
            missing[user] -= 1
            if not missing[user]:
                heappush(ready, (units[user].roots[0], user))
    return order


def _places(steps: Sequence[Instruction], pieces: Sequence[Sequence[Unit]]) -> tuple[dict[int, int], int, int]:
    """Place in w of each value that another piece or a loop uses, those of a loop side by side; and the sizes of w and of the
    array beside it for single precision."""
    last: dict[int, Unit] = {}
    stored = set()
    for piece in pieces:
        here = {unit.roots[0] for unit in piece if len(unit.roots) == 1}
        for unit in piece:
            for k in unit.sources:
                if not steps[k].is_leaf:
                    last[k] = unit
                    if len(unit.roots) > 1 or k not in here:
                        stored.add(k)
    ending = defaultdict(list)
    for k in stored:
        ending[last[k].roots].append(k)
    places: dict[int, int] = {}
    arrays = {False: bytearray(), True: bytearray()}
    for unit in (unit for piece in pieces for unit in piece):
        if not stored.isdisjoint(unit.roots):
            count, taken = len(unit.roots), arrays[steps[unit.roots[0]].single]
            at = taken.find(bytes(count))
            if at < 0:
                at = len(taken.rstrip(b"\0"))
            taken[at : at + count] = b"\1" * count
            places.update(zip(unit.roots, range(at, at + count), strict=True))
        for k in ending[unit.roots]:  # after the unit's own: it reads them while it writes
            arrays[steps[k].single][places[k]] = 0
    return places, len(arrays[False]), len(arrays[True])
