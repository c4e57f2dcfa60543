"""Make the steps of a system of FMUs: natively by fmu/c/master.c, or in Python where there is no C compiler.

Both do what the tables say (`insenv.fmu.instance`), in the same order, and give bit-identical results.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from insenv.base.resources import fmu_folder
from insenv.core.compile import CompileError, compile_library, find_compiler
from insenv.core.runner import Progress, resolve_backend
from insenv.fmu.instance import Group, Move, Ports, append
from insenv.fmu.reading import Array

DOING = ("setting the inputs", "the step", "reading the outputs")
STEP = DOING.index("the step")
KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?")
"""The types of values, in the order of fmu/c/master.c."""
BLOCK_SECONDS = 0.1
"""About the time between two calls of the progress function, for which an interrupt waits."""


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
        for place, (given, at) in enumerate(place for part in self.parts for place in part.outputs.values()):
            append(moves, Move(row, place, given, at))
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
    records = plan.records

    def block(first: int, steps: int) -> tuple[int, Stopped | None]:
        for k in range(first, first + steps):
            for number, part in enumerate(plan.parts):
                stopped = _step(part, number, plan.start + k * plan.step, plan.step)
                if stopped is not None:
                    return k - first, stopped
            if (k + 1) % plan.every == 0:
                for m in records:
                    plan.values[k // plan.every, m.at : m.at + m.count] = m.source[m.place : m.place + m.count]
        return steps, None

    return block


def _step(part: Ports, number: int, now: float, step: float) -> Stopped | None:
    for m in part.moves:
        m.to[m.at : m.at + m.count] = m.source[m.place : m.place + m.count]
    for group in part.setters:
        if (status := group.call()) > 1:
            return Stopped(number, 0, status)
    if (status := part.do_step.call(now, step)) > 1 or part.do_step.flags[1].value:
        return Stopped(number, STEP, status)
    for group in part.getters:
        if (status := group.call()) > 1:
            return Stopped(number, 2, status)
    return None


class _Move(ctypes.Structure):
    _fields_ = (
        ("to", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
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
    parts, kept = (_Part * len(plan.parts))(), []
    for place, part in enumerate(plan.parts):
        moves, setters, getters = _moves(part.moves), _groups(part.setters), _groups(part.getters)
        kept += [moves, setters, getters]
        flags = (ctypes.addressof(flag) for flag in part.do_step.flags)
        tables = (ctypes.addressof(table) for table in (moves, setters, getters))
        counts = (len(moves), len(setters), len(getters))
        parts[place] = _Part(part.instance, part.do_step.function, *flags, *tables, *counts, part.version)
    records = _moves(plan.records, in_row=True)
    rows, size = plan.values.ctypes.data, plan.values.strides[0]

    def block(first: int, steps: int, kept: Any = kept) -> tuple[int, Stopped | None]:
        stop = _Stop(-1, 0, 0)
        tables = (parts, len(parts), records, len(records), rows, size)
        made = function(*tables, first, steps, plan.start, plan.step, plan.every, ctypes.byref(stop))
        return made, None if stop.part < 0 else Stopped(stop.part, stop.doing, stop.status)

    return block


def _moves(moves: Sequence[Move], in_row: bool = False) -> ctypes.Array[_Move]:
    """The moves as C reads them; in_row: their targets are places in a row, not addresses."""
    table = (_Move * len(moves))()
    for place, m in enumerate(moves):
        to = m.at * m.to.itemsize + (0 if in_row else m.to.ctypes.data)
        table[place] = _Move(to, m.source.ctypes.data + m.place * m.source.itemsize, m.count, _kind(m.to), _kind(m.source))
    return table


def _groups(groups: Sequence[Group]) -> ctypes.Array[_Group]:
    table = (_Group * len(groups))()
    for place, g in enumerate(groups):
        references = ctypes.addressof(g.references)
        table[place] = _Group(g.function, references, g.values.ctypes.data, len(g.references), g.values.size)
    return table


def _kind(row: Any) -> int:
    return [np.dtype(kind) for kind in KINDS].index(row.dtype)


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
