"""Commands of a vehicle by time: what was steered in a page, and is run again from the scenario that it gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.model import Model
from insenv.core.tables import Vector

TIME = "at_s"
PREFIX, VALID = "command_", "command_valid"
DRIVEN = "has commands: `insenv run` and `insenv page` follow them, nothing else does"
Commanded = tuple[tuple[int, Vector], ...]
"""Numbers of samples, ascending, and the inputs from the sample after these on."""


def commanded(model: Model, commands: Sequence[Mapping[str, float]], rate_hz: float) -> Commanded:
    """The inputs of a plant that commands are.

    commands: ``{"at_s": time, name: value}`` in SI, by the names of the vehicle's commands, in the order of time.  A command
    that is not named keeps its value; at first it has the start value of its row.

    Raises `InputError` for a vehicle without commands, an unknown name, a value out of bounds, and times that are not in order.
    """
    names = [name.removeprefix(PREFIX) for name in model.inputs.names if name.startswith(PREFIX) and name != VALID]
    if commands and not names:
        raise InputError("commands: the vehicle of this scenario takes no commands")
    inputs: list[tuple[int, Vector]] = []
    now = model.inputs.start_vector()
    for number, entry in enumerate(commands):
        where = f"commands[{number}]"
        if TIME not in entry:
            raise InputError(f"{where}: {TIME} is missing: time of the commands [s]")
        sample = round(entry[TIME] * rate_hz)
        if sample < (inputs[-1][0] if inputs else 0):
            raise InputError(f"{where}.{TIME} = {entry[TIME]:g} s: allowed is 0 or later, and not before the entry above")
        for name in entry:
            if name != TIME and name not in names:
                raise InputError(f"{where}: unknown command {name!r}{nearest(name, names)}")
        values = {PREFIX + name: value for name, value in entry.items() if name != TIME}
        try:
            now = model.inputs.pack({**values, VALID: 1.0}, base=now)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        inputs.append((sample, now))
    return tuple(inputs)


def input_rows(model: Model, steps: Commanded, begin: int, count: int) -> Vector | None:
    """Inputs (count, inputs.size) of the samples `begin` to `begin + count`; None if there are no commands."""
    if not steps:
        return None
    rows = np.tile(model.inputs.start_vector(), (count, 1))
    for sample, values in steps:
        rows[max(sample - begin, 0) :] = values
    return rows
