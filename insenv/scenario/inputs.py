"""The inputs of a model, sample by sample: of an estimator from columns, in chunks, and of a vehicle that is steered.

Commands by time are what was steered in a page, and are run again from the scenario that it gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.model import Model
from insenv.core.tables import Array, Vector

CHUNK = 20_000
"""Samples that are simulated before the estimators take them: about 10 MB."""
SAMPLES, EVERY = 300, 10
"""Samples that lie beside an exported filter, and those from one of their expected outputs to the next: more than one second in
every scenario, so that a fix arrives."""
RECORDS = 3_000
"""Approximate upper bound of the number of recorded times of a run."""


def recording_interval(samples: int, records: int = RECORDS) -> int:
    """Samples from one record to the next: about `records` records, and one at the last sample if possible."""
    least = max(1, -(-samples // records))
    return next((every for every in range(least, 4 * least) if samples % every == 0), least)


def chunks(total: int, every: int, chunk: int = CHUNK) -> Iterator[tuple[int, int]]:
    """First sample and length of each chunk of `total` samples; all lengths are multiples of `every`, as `total` is."""
    chunk = max(every, chunk // every * every)
    for begin in range(0, total, chunk):
        yield begin, min(chunk, total - begin)


def input_rows(model: Model, columns: Mapping[str, Array], *shape: int) -> Array:
    """Inputs (*shape, inputs.size) of a model: each row is the column of its name, or else its start value.

    columns: arrays (*shape, ...) by name; those that the model does not take are ignored.
    """
    rows = np.tile(model.inputs.start_vector(), (*shape, 1))
    for name in model.inputs.names:
        if name in columns:
            rows[..., model.inputs.slice(name)] = columns[name].reshape(*shape, -1)
    return rows


def sample_columns(plant: Model, outputs: Array, interval: float) -> tuple[dict[str, Array], int]:
    """Columns by name of the outputs (n, outputs.size) of a plant, with `dt` (s), and how many lost samples were bridged."""
    columns = {name: np.array(column) for name, column in plant.outputs.unpack(outputs).items()}
    columns["dt"] = np.full(len(outputs), interval)
    return columns, bridge_lost(columns)


def bridge_lost(columns: dict[str, Array]) -> int:
    """Replace lost samples (`imu_valid` 0) by interpolation between their neighbours, in place; return their number.

    This is how the airborne-navigation paper treats gaps in its data.  At the ends of the columns the nearest
    sample is held.
    """
    valid = columns["imu_valid"] != 0
    lost = int(np.count_nonzero(~valid))
    if lost and valid.any():
        place = np.arange(len(valid))
        for name in ("delta_angle", "delta_velocity"):
            column = columns[name]
            for axis in range(column.shape[1]):
                column[~valid, axis] = np.interp(place[~valid], place[valid], column[valid, axis])
    return lost


# Commands of a vehicle by time.

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


def commanded_rows(model: Model, steps: Commanded, begin: int, count: int) -> Vector | None:
    """Inputs (count, inputs.size) of the samples `begin` to `begin + count`; None if there are no commands."""
    if not steps:
        return None
    rows = np.tile(model.inputs.start_vector(), (count, 1))
    for sample, values in steps:
        rows[max(sample - begin, 0) :] = values
    return rows
