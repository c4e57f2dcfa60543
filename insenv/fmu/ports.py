"""The connected inputs and all outputs of an instance, as the tables that a master steps through."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError

Row = NDArray[Any]


@dataclass(frozen=True)
class Group:
    """The variables of an instance that one function sets or gets.

    call: the call, which gives a status.  function: its address.  references: of the variables.  values: (elements,), which the
    call reads or fills.
    """

    call: Callable[[], int]
    function: int
    references: Any
    values: Row


@dataclass(frozen=True)
class Step:
    """The function that advances an instance by a step from a time, and its address; flags: those that FMI 3 returns."""

    call: Callable[[float, float], int]
    function: int
    flags: Sequence[Any]


@dataclass(frozen=True)
class Move:
    """Copy `count` values from a place of one row to a place of another."""

    to: Row
    at: int
    source: Row
    place: int
    count: int = 1


Place = tuple[Row, int]
"""A row of values, and a place in it."""


@dataclass
class Ports:
    """An instance in a system.

    name: of its component.  setters: groups of its connected inputs.  getters: groups of its outputs.  inputs, outputs: the
    `Place` of each element by its name.  moves: those of its connections, made before it steps.
    """

    name: str
    version: int
    instance: int
    setters: Sequence[Group]
    getters: Sequence[Group]
    inputs: Mapping[str, Place]
    outputs: Mapping[str, Place]
    do_step: Step
    moves: list[Move] = field(default_factory=list)

    def connect(self, target: str, source: Ports, variable: str) -> None:
        """Take input `target` from the output `variable` of another instance.

        Raises `InputError` for an unknown name and for types between which values would be lost.
        """
        if target not in self.inputs:
            raise InputError(f"{self.name}: no input {target!r}")
        if variable not in source.outputs:
            raise InputError(f"{source.name}: no output {variable!r}")
        (to, at), (given, place) = self.inputs[target], source.outputs[variable]
        if not np.can_cast(given.dtype, to.dtype, "safe"):
            what = f"{source.name}.{variable} ({given.dtype}) to {self.name}.{target} ({to.dtype})"
            raise InputError(f"a connection from {what} would lose values: allowed are types that hold them all")
        append(self.moves, Move(to, at, given, place))


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
