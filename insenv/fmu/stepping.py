"""Step FMUs in the order of the data: natively by fmu/c/master.c, or in Python where there is no C compiler.

In each step each part takes its inputs, steps, and gives its outputs to the parts after it.  Both ways do what the tables of
a `Plan` say, in the same order, and give bit-identical results.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.resources import fmu_folder
from insenv.core.compile import CompileError, compile_library, find_compiler
from insenv.core.runner import Progress, resolve_backend
from insenv.core.tables import Array

DOING = ("setting the inputs", "the step", "reading the outputs")
SETTING, STEPPING, READING = range(3)
"""What a part does, in the order of fmu/c/master.c."""
KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?")
"""The types of values, in the order of fmu/c/master.c."""
BLOCK_SECONDS = 0.1
"""About the time between two calls of the progress function, for which an interrupt waits."""

Row = NDArray[Any]
Place = tuple[Row, int]
"""A row of values, and a place in it."""


@dataclass(frozen=True)
class Group:
    """Variables that one function of an instance sets or gets.

    function: of the FMU's library.  references: of the variables.  values: (elements,), which the function reads or fills.
    """

    function: Any
    references: Any
    values: Row

    def call(self, version: int, instance: int) -> Callable[[], int]:
        """The call of the function for an instance of this version of FMI, which gives a status."""
        elements = (self.values.size,) if version == 3 else ()
        return partial(self.function, instance, self.references, len(self.references), self.values.ctypes.data, *elements)


@dataclass(frozen=True)
class Move:
    """Copy `count` values to a row, from place `at` on, from `place` on in another.

    source: a row, or a table (steps, n), of which row k is taken in step k.
    """

    to: Row
    at: int
    source: Row
    place: int
    count: int = 1


@dataclass
class Ports:
    """An instance in a system.

    name: of its component.  version: of FMI.  instance: its address.  setters: groups of its connected inputs.  getters: groups
    of its outputs.  inputs, outputs: the `Place` of each element by its name.  do_step: the function of the FMU's library.
    flags: event needed, simulation ended, step ended early, and at which time, which the function of FMI 3 fills.  moves: those
    of its connections, made before it steps.
    """

    name: str
    version: int
    instance: int
    setters: Sequence[Group]
    getters: Sequence[Group]
    inputs: Mapping[str, Place]
    outputs: Mapping[str, Place]
    do_step: Any
    flags: Sequence[Any]
    moves: list[Move] = field(default_factory=list)

    def connect(self, target: str, source: Ports, variable: str) -> None:
        """Take input `target` from the output `variable` of another instance.

        Raises `InputError` for an unknown name and for types between which values would be lost.
        """
        if target not in self.inputs:
            raise InputError(f"{self.name}: no input {target!r}")
        if variable not in source.outputs:
            raise InputError(f"{source.name}: no output {variable!r}")
        (to, at), (row, place) = self.inputs[target], source.outputs[variable]
        if not np.can_cast(row.dtype, to.dtype, "safe"):
            what = f"{source.name}.{variable} ({row.dtype}) to {self.name}.{target} ({to.dtype})"
            raise InputError(f"a connection from {what} would lose values: allowed are types that hold them all")
        append(self.moves, Move(to, at, row, place))

    def follow(self, columns: Mapping[str, Array]) -> None:
        """Take inputs from columns (steps,) by name, whose values their types can hold: row k in step k."""
        table = np.array([columns[name] for name in self.inputs if name in columns], dtype=np.float64).T.copy()
        for column, name in enumerate(name for name in self.inputs if name in columns):
            append(self.moves, Move(*self.inputs[name], table, column))


def append(moves: list[Move], move: Move) -> None:
    """Append a move, as part of the last one if it continues it."""
    last = moves[-1] if moves else None
    if (
        last is not None
        and last.to is move.to
        and last.source is move.source
        and (move.at, move.place) == (last.at + last.count, last.place + last.count)
    ):
        moves[-1] = Move(last.to, last.at, last.source, last.place, last.count + move.count)
    else:
        moves.append(move)


@dataclass(frozen=True)
class Stopped:
    """Why a run ended early: the number of the part, what it was doing (place in `DOING`), and the status of the call."""

    part: int
    doing: int
    status: int


@dataclass(frozen=True)
class Plan:
    """What to do.

    parts: in the order of the data.  values: (records, outputs of all parts), filled after every `every` steps.  start: s.
    step: s.
    """

    parts: Sequence[Ports]
    values: Array
    start: float
    step: float
    every: int

    @property
    def records(self) -> list[Move]:
        """The moves from the outputs to a row of `values`."""
        row, moves = np.empty(self.values.shape[1]), list[Move]()
        for place, (source, at) in enumerate(place for part in self.parts for place in part.outputs.values()):
            append(moves, Move(row, place, source, at))
        return moves


Block = Callable[[int, int], "tuple[int, Stopped | None]"]
"""Function that makes steps: from the first one and their number, the number of those that were completed."""


def prepared(plan: Plan, backend: str | None) -> Block:
    """The steps of a plan by a backend: see `insenv.core.runner.resolve_backend`."""
    return interpreted(plan) if resolve_backend(backend) == "interpreter" else native(plan)


def make_steps(block: Block, steps: int, progress: Progress | None) -> tuple[int, Stopped | None]:
    """Make the steps in blocks; the number of those that were completed, and why they ended early."""
    done, size = 0, 1
    while done < steps:
        begin = time.perf_counter()
        made, stopped = block(done, min(size, steps - done))
        done += made
        if stopped is not None:
            return done, stopped
        size = size * 2 if time.perf_counter() - begin < BLOCK_SECONDS / 2 else max(1, size // 2)
        if progress is not None:
            progress(done, steps)
    return done, None


def interpreted(plan: Plan) -> Block:
    """Steps in Python."""
    parts = [_calls(part) for part in plan.parts]
    records = plan.records

    def block(first: int, steps: int) -> tuple[int, Stopped | None]:
        for k in range(first, first + steps):
            ended = None
            for number, (part, calls) in enumerate(zip(plan.parts, parts, strict=True)):
                for m in part.moves:
                    source = m.source if m.source.ndim == 1 else m.source[k]
                    m.to[m.at : m.at + m.count] = source[m.place : m.place + m.count]
                for doing, call in calls:
                    status = call(plan.start + k * plan.step, plan.step) if doing == STEPPING else call()
                    if status > 1:
                        return k - first, Stopped(number, doing, status)
                if part.version == 3 and part.flags[1].value:
                    ended = ended or Stopped(number, STEPPING, 0)
            if (k + 1) % plan.every == 0:
                for m in records:
                    plan.values[k // plan.every, m.at : m.at + m.count] = m.source[m.place : m.place + m.count]
            if ended is not None:
                return k + 1 - first, ended
        return steps, None

    return block


def _calls(part: Ports) -> list[tuple[int, Callable[..., int]]]:
    """The calls of a step of a part in order, each with what it does."""
    version, instance = part.version, part.instance
    places = tuple(map(ctypes.addressof, part.flags)) if version == 3 else ()

    def step(now: float, length: float) -> int:
        return int(part.do_step(instance, now, length, 1, *places))

    setting, reading = ([group.call(version, instance) for group in groups] for groups in (part.setters, part.getters))
    return [*((SETTING, call) for call in setting), (STEPPING, step), *((READING, call) for call in reading)]


class _Move(ctypes.Structure):
    _fields_ = (
        ("to", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
        ("stride", ctypes.c_int64),
        ("count", ctypes.c_int64),
        ("to_kind", ctypes.c_int32),
        ("source_kind", ctypes.c_int32),
    )


class _Group(ctypes.Structure):
    _fields_ = (
        ("function", ctypes.c_void_p),
        ("references", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("elements", ctypes.c_int64),
    )


class _Part(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("instance", "do_step", "event", "terminate", "early", "last")),
        *((name, ctypes.c_void_p) for name in ("moves", "setters", "getters")),
        *((name, ctypes.c_int64) for name in ("n_move", "n_setter", "n_getter")),
        ("version", ctypes.c_int32),
    )


class _Stop(ctypes.Structure):
    _fields_ = (("part", ctypes.c_int64), ("doing", ctypes.c_int32), ("status", ctypes.c_int32))


def native(plan: Plan) -> Block:
    """Steps in C.  Raises `CompileError` if the compiler fails."""
    function = _library().insenv_master
    parts, tables_of_parts = (_Part * len(plan.parts))(), []
    for place, part in enumerate(plan.parts):
        tables: list[ctypes.Array[Any]] = [_moves(part.moves), _groups(part.setters), _groups(part.getters)]
        tables_of_parts.append(tables)
        addresses = [ctypes.addressof(each) for each in (*part.flags, *tables)]
        counts = [len(table) for table in tables]
        parts[place] = _Part(part.instance, _address(part.do_step), *addresses, *counts, part.version)
    records = _moves(plan.records, in_row=True)
    rows, size = plan.values.ctypes.data, plan.values.strides[0]

    # the tables must live as long as the block, which has their addresses
    def block(first: int, steps: int, owned: Any = (plan, tables_of_parts)) -> tuple[int, Stopped | None]:
        stop = _Stop(-1, 0, 0)
        records_of = (records, len(records), rows, size)
        made = function(parts, len(parts), *records_of, first, steps, plan.start, plan.step, plan.every, ctypes.byref(stop))
        return made, None if stop.part < 0 else Stopped(stop.part, stop.doing, stop.status)

    return block


def _moves(moves: Sequence[Move], in_row: bool = False) -> ctypes.Array[_Move]:
    """The moves as C reads them; in_row: their targets are places in a row, not addresses."""
    table = (_Move * len(moves))()
    for place, m in enumerate(moves):
        to = m.at * m.to.itemsize + (0 if in_row else m.to.ctypes.data)
        stride = m.source.strides[0] if m.source.ndim == 2 else 0
        source = m.source.ctypes.data + m.place * m.source.itemsize
        table[place] = _Move(to, source, stride, m.count, _kind(m.to), _kind(m.source))
    return table


def _groups(groups: Sequence[Group]) -> ctypes.Array[_Group]:
    table = (_Group * len(groups))()
    for place, g in enumerate(groups):
        references = ctypes.addressof(g.references)
        table[place] = _Group(_address(g.function), references, g.values.ctypes.data, len(g.references), g.values.size)
    return table


def _kind(row: Row) -> int:
    return [np.dtype(kind) for kind in KINDS].index(row.dtype)


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@cache
def _library() -> ctypes.CDLL:
    compiler = find_compiler()
    if compiler is None:
        raise CompileError("no C compiler found")
    library = ctypes.CDLL(str(compile_library((fmu_folder() / "c" / "master.c").read_text(encoding="utf-8"), compiler)))
    address, whole, number = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
    tables, run = (address, whole) * 3, (whole, whole, number, number, whole, address)
    library.insenv_master.argtypes = [*tables, *run]
    library.insenv_master.restype = whole
    return library
