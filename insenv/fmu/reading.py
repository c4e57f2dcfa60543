"""The model description of an FMU as FMPy reads it: its numeric variables and the names of their elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array, flag_of

KINDS = {  # by type in the model description: dtype of its values, suffix of its functions
    "Real": (np.float64, "Real"),
    "Integer": (np.int32, "Integer"),
    "Enumeration": (np.int32, "Integer"),
    "Boolean": (np.int32, "Boolean"),
    "Float64": (np.float64, "Float64"),
    "Float32": (np.float32, "Float32"),
    "Int8": (np.int8, "Int8"),
    "UInt8": (np.uint8, "UInt8"),
    "Int16": (np.int16, "Int16"),
    "UInt16": (np.uint16, "UInt16"),
    "Int32": (np.int32, "Int32"),
    "UInt32": (np.uint32, "UInt32"),
    "Int64": (np.int64, "Int64"),
    "UInt64": (np.uint64, "UInt64"),
}
KINDS_3 = {**KINDS, "Boolean": (np.bool_, "Boolean"), "Enumeration": (np.int64, "Int64")}


@dataclass(frozen=True)
class Variable:
    """A numeric variable of an FMU; an array of FMI 3 is one variable with several elements.

    elements: their names, ``name`` or ``name[1]``, ``name[2]`` ..., ``name[1,1]`` ... by rows.
    """

    name: str
    reference: int
    kind: str
    causality: str
    unit: str
    description: str
    elements: tuple[str, ...]

    def first_wrong(self, values: Array) -> int | None:
        """The place of the first of `values` (n,) that its type cannot hold, or None.

        NaN and infinity are left to the FMU if the type has them.
        """
        kind = np.dtype(KINDS_3[self.kind][0])
        if kind.kind == "f":
            return None
        limits: Any = np.iinfo(kind.name) if kind.kind != "b" else None
        low, high = (0, 1) if limits is None else (limits.min, limits.max)
        wrong = ~((values == np.floor(values)) & (values >= low) & (values <= high))
        return int(np.argmax(wrong)) if wrong.any() else None

    @property
    def allowed(self) -> str:
        """What its type can hold, in messages."""
        kind = np.dtype(KINDS_3[self.kind][0])
        if kind.kind == "b":
            return "allowed is 0 or 1 (false, true)"
        return "allowed is a number" if kind.kind == "f" else f"allowed is a whole number ({self.kind})"


def element_names(name: str, shape: Sequence[int]) -> tuple[str, ...]:
    """``name`` for a scalar, else ``name[i]`` or ``name[i,j]``, counted from 1, the last index fastest."""
    places = product(*(range(1, n + 1) for n in shape))
    return tuple(f"{name}[{','.join(map(str, place))}]" for place in places) if len(shape) else (name,)


def read_description(path: Path) -> Any:
    """modelDescription.xml as FMPy reads it.  Raises `InputError`."""
    from fmpy import read_model_description

    if not path.exists():
        raise InputError(f"{path}: no such file")
    try:
        description = read_model_description(str(path), validate=False)
    except Exception as error:  # from zipfile, lxml or FMPy
        raise InputError(f"{path}: not an FMU: {error}") from None
    if description.coSimulation is None or description.fmiVersion[0] not in "23":
        kinds = {"Model Exchange": description.modelExchange, "Scheduled Execution": description.scheduledExecution}
        only = " and ".join(name for name, declared in kinds.items() if declared is not None)
        this = f"FMI {description.fmiVersion}{f' for {only} only' if only else ''}"
        raise InputError(f"{path}: allowed is an FMU for Co-Simulation, FMI 2 or 3 (this is {this})")
    return description


def switched_inputs(path: Path) -> set[str]:
    """The elements of the inputs that a Boolean input switches off (`flag_of`).  Raises `InputError`."""
    inputs = [v for v in map(read_variable, read_description(path).modelVariables) if v is not None and v.causality == "input"]
    flags = {v.name for v in inputs if v.kind == "Boolean"}
    return {name for v in inputs if flag_of(v.name.partition("[")[0], flags) for name in v.elements}


def read_variable(read: Any) -> Variable | None:
    """A variable that FMPy read; None if it is not numeric.

    A dimension that a structural parameter sets has its start value: these parameters keep it.
    """
    if read.type not in KINDS:
        return None
    shape = tuple(int(d.start if d.start is not None else d.variable.start) for d in read.dimensions)
    names = element_names(read.name, shape)
    return Variable(read.name, read.valueReference, read.type, read.causality, unit_of(read), read.description or "", names)


def unit_of(read: Any) -> str:
    """The unit of a variable that FMPy read, or an empty text."""
    declared = read.declaredType
    return read.unit or (declared.unit if declared is not None else None) or ""
