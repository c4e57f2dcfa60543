"""Tables: the named rows, with units, that form a model's parameters, state, inputs and outputs.

A table is the only description of a vector of numbers in insenv.  The same rows name the symbols of the equations,
define the layout of the flat float64 vector of the generated code, check user values, label result files and become the
variables of an FMU.

Layout: the rows follow one another in their order; a matrix is stored row by row (C order), as in NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, nearest

Array = NDArray[np.float64]
"""Real numbers of any shape."""
Vector = Array
"""The numbers of a table, one after another."""
Spans = tuple[slice, ...]


@dataclass(frozen=True)
class Row:
    """One named quantity of a table.

    Parameters
    ----------
    name: the field's standard name, with direction and frame (``velocity_n``, ``q_nb``).
    meaning: one line, a full sentence without its full stop.
    unit: SI unit (``"m/s"``, ``"rad"``), ``"1"`` for a pure number.
    shape: ``()`` scalar, ``(n,)`` vector, ``(r, c)`` matrix.
    frame: the frame of the components (``"n"``, ``"b"``, ...), or empty.
    start: start value, a number for every element or a nested sequence of the row's shape.
    lower, upper: inclusive bounds of every element.
    flag: whether it is 0 (no) or 1 (yes) and nothing between; an FMU shows it as a Boolean.
    whole: whether it is a whole number.
    """

    name: str
    meaning: str
    unit: str = "1"
    shape: tuple[int, ...] = ()
    frame: str = ""
    start: Any = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    flag: bool = False
    whole: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise InputError(f"row {self.name!r}: allowed is a name of letters, digits and '_'")
        shape = self.shape
        if (
            not isinstance(shape, tuple)
            or len(shape) > 2
            or not all(isinstance(n, (int, np.integer)) and n >= 0 for n in shape)
        ):
            raise InputError(f"row {self.name!r}: shape = {shape!r}: allowed is (), (n,) or (rows, columns)")
        try:
            start = self.flat_start()
        except (TypeError, ValueError):
            raise InputError(f"row {self.name!r}: start = {self.start!r}: allowed is {_values_of(shape)}") from None
        if not np.isfinite(start).all():
            raise InputError(f"row {self.name!r}: start = {self.start!r}: allowed is a finite number")
        if not self.lower <= self.upper:
            raise InputError(f"row {self.name!r}: lower = {self.lower!r} exceeds upper = {self.upper!r}")
        if (start < self.lower).any() or (start > self.upper).any():
            raise InputError(f"row {self.name!r}: start = {self.start!r}: allowed is {self.lower:g} to {self.upper:g}")

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def kind(self) -> str:
        """What its elements are, in messages."""
        return "a whole number" if self.whole or self.flag else "a finite number"

    def flat_start(self) -> Vector:
        """Start value as a flat vector of `size` elements."""
        return np.array(np.broadcast_to(np.asarray(self.start, dtype=np.float64), self.shape)).ravel()

    def check(self, value: Vector) -> None:
        """Raise `InputError` if an element is not finite, outside the bounds, or not whole though it must be."""
        bad = ~np.isfinite(value) | (value < self.lower) | (value > self.upper)
        if self.whole or self.flag:
            bad |= value != np.floor(value)
        if bad.any():
            place = "" if self.size == 1 else f"[{int(np.argmax(bad))}]"
            wrong = float(value[np.argmax(bad)])
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise InputError(
                f"{self.name}{place} = {wrong:g}{unit}: allowed is {self.kind} "
                f"from {self.lower:g} to {self.upper:g}{unit} ({self.meaning})"
            )


def _values_of(shape: tuple[int, ...]) -> str:
    """What a row of that shape can hold, in messages."""
    return f"a number or an array of shape {shape}" if shape else "a number"


@dataclass(frozen=True)
class Table:
    """An ordered set of rows and the layout of their flat vector."""

    rows: tuple[Row, ...] = ()
    size: int = field(init=False, repr=False, compare=False)
    """Length of the flat vector."""
    _slices: dict[str, slice] = field(init=False, repr=False, compare=False)
    _named: dict[str, Row] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.rows, (tuple, list)) or not all(isinstance(row, Row) for row in self.rows):
            raise InputError(f"Table: rows is of type {type(self.rows).__name__}: allowed is a tuple of Row")
        slices: dict[str, slice] = {}
        position = 0
        for row in self.rows:
            if row.name in slices:
                raise InputError(f"two rows are named {row.name!r}: the names of the rows of a table must differ")
            slices[row.name] = slice(position, position + row.size)
            position += row.size
        object.__setattr__(self, "size", position)
        object.__setattr__(self, "_slices", slices)
        object.__setattr__(self, "_named", {row.name: row for row in self.rows})

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __contains__(self, name: str) -> bool:
        return name in self._slices

    def __getitem__(self, name: str) -> Row:
        self.slice(name)
        return self._named[name]

    def __add__(self, other: Table) -> Table:
        return Table(self.rows + other.rows)

    @property
    def names(self) -> tuple[str, ...]:
        """The rows' names, in order."""
        return tuple(self._slices)

    def slice(self, name: str) -> slice:
        """The slice of row `name` in the flat vector."""
        try:
            return self._slices[name]
        except KeyError:
            raise InputError(f"no row named {name!r}{nearest(str(name), self.names)}") from None

    def spans(self, names: Iterable[str]) -> Spans:
        """The slices of rows in the flat vector, those of adjacent rows joined."""
        spans: list[slice] = []
        for name in names:
            part = self.slice(name)
            first = spans.pop().start if spans and spans[-1].stop == part.start else part.start
            spans.append(slice(first, part.stop))
        return tuple(spans)

    def start_vector(self) -> Vector:
        """The start values as one flat vector."""
        return np.array(self._start)

    @cached_property
    def _start(self) -> Vector:
        return np.concatenate([row.flat_start() for row in self.rows] or [np.zeros(0)])

    def pack(self, values: Mapping[str, Any], base: Vector | None = None) -> Vector:
        """Flat vector with `values` by name written over `base` (the start values if None), each checked.

        Raises `InputError` for an unknown name, a wrong shape, or an element that is not finite or out of bounds.
        """
        vector = self.start_vector() if base is None else np.array(base, dtype=np.float64)
        for name, value in values.items():
            part, row = self.slice(name), self[name]
            try:
                array = np.asarray(value, dtype=np.float64)
                array = array if array.shape == row.shape else np.broadcast_to(array, row.shape)
            except (TypeError, ValueError):
                raise InputError(f"{name} = {value!r}: allowed is {_values_of(row.shape)}") from None
            row.check(array.ravel())
            vector[part] = array.ravel()
        return vector

    def unpack(self, vector: Vector, names: Iterable[str] | None = None) -> dict[str, Any]:
        """Values by name from a flat vector, or from an array of them along the last axis; only those of `names`."""
        vector = np.asarray(vector)
        if vector.shape[-1:] != (self.size,):
            raise InputError(f"vector of shape {vector.shape}: this table has {self.size} elements")
        rows = self.rows if names is None else [self[name] for name in names]
        return {row.name: vector[..., self._slices[row.name]].reshape(vector.shape[:-1] + row.shape) for row in rows}

    def symbols(self, flat: Any) -> SimpleNamespace:
        """CasADi symbols by name, taken from the flat symbol vector: scalars, columns or matrices."""
        names = {}
        for row in self.rows:
            part = flat[self._slices[row.name]]
            # CasADi stores by columns: read the row-major block transposed
            names[row.name] = part.reshape((row.shape[1], row.shape[0])).T if len(row.shape) == 2 else part
        return SimpleNamespace(**names)

    def assemble(self, values: Mapping[str, Any]) -> Any:
        """Flat CasADi vector from expressions by name.

        Raises `InputError` for an unknown or missing row or a wrong shape.
        """
        import casadi as ca

        for name in values:
            self.slice(name)
        missing = [name for name in self.names if name not in values]
        if missing:
            raise InputError(f"row {missing[0]!r} is missing: allowed is a value for every row ({', '.join(self.names)})")
        parts = []
        for row in self.rows:
            shape = (row.shape + (1, 1))[:2]
            value = values[row.name]
            try:
                value = value if isinstance(value, ca.SX) else ca.SX(value)
            except NotImplementedError:
                kind = type(value).__name__
                raise InputError(f"row {row.name!r} is of type {kind}: allowed is a CasADi expression or a number") from None
            if value.shape != shape:
                raise InputError(f"row {row.name!r} has the shape {value.size1()} x {value.size2()}: allowed is {row.shape}")
            parts.append(ca.vec(value.T) if len(row.shape) == 2 else value)
        return ca.vertcat(*parts) if parts else ca.SX(0, 1)


def check_rows(values: Any, table: Table) -> Mapping[str, Any]:
    """`values` if it is a mapping with names of the table's rows.  Raises `InputError` otherwise."""
    for name in check_mapping(values):
        table.slice(name)
    return values


def check_mapping(values: Any) -> Mapping[str, Any]:
    """`values` if it is a mapping.  Raises `InputError` otherwise."""
    if not isinstance(values, Mapping):
        raise InputError(f"the result is of type {type(values).__name__}: allowed is a dict of values by row name")
    return values


def flag_of(name: str, names: Collection[str]) -> str | None:
    """The name of the flag ``X_valid`` of an input ``X_...``, the longest X first; None if `names` has none."""
    words = name.split("_")
    for count in range(len(words), 0, -1):
        flag = "_".join([*words[:count], "valid"])
        if flag in names and flag != name:
            return flag
    return None
