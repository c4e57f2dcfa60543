"""What insenv promises of every model: its tables, its inputs, its state, the same bits on every backend."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from insenv.base.errors import InputError
from insenv.core.batch import make_batch
from insenv.core.compile import find_compiler
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.core.tables import Table, Vector

UNITS = ("m", "s", "rad", "Hz", "K", "Pa", "T", "SI", "sqrt")
"""What units are made of; "SI" stands where a matrix mixes them, and a list such as "m, m/s" names those of the elements."""
FRAMED = re.compile(r"_(n|b|e|i|w)$")
"""A row whose name ends so is a vector or a matrix in that frame."""


@contextmanager
def promised(this: str) -> Iterator[None]:
    """What insenv refuses in the block is a promise that `this` breaks: an `InputError` becomes an `AssertionError`."""
    try:
        yield
    except InputError as error:
        raise AssertionError(f"{this}: {error}") from error


def check_tables(model: Model) -> None:
    """Check that every row has a meaning, a unit, and a frame that its name agrees with."""
    for name in ("parameters", "state", "inputs", "outputs"):
        table: Table = getattr(model, name)
        for row in table:
            where = f"model {model.id!r}, {name}, row {row.name!r}"
            assert row.meaning.strip() and not row.meaning.endswith("."), (
                f"{where}: meaning = {row.meaning!r}: allowed is a sentence without its full stop"
            )
            assert row.unit.strip() and set(re.findall("[a-zA-Z]+", row.unit)) <= set(UNITS), (
                f"{where}: unit = {row.unit!r}: allowed is '1', or what is made of {', '.join(UNITS)}"
            )
            framed = FRAMED.search(row.name)
            assert not (framed and row.frame and row.shape) or row.frame == framed[1], (
                f"{where}: frame = {row.frame!r}: allowed is {framed and framed[1]!r}, as its name ends"
            )


def check_inputs(model: Model, parameters: Vector) -> None:
    """Check that a parameter, an input and a step that do not exist, and values that are not finite, are refused by name."""
    runner = make_runner(model, parameters, "interpreter")
    wrong: list[tuple[str, Callable[[], object]]] = [
        ("no_such_row", lambda: make_runner(model, {"no_such_row": 1.0}, "interpreter")),
        ("no_such_step", lambda: runner.step("no_such_step")),
    ]
    if model.inputs.size:
        name = model.inputs.names[0]
        wrong.append(("no_such_input", lambda: runner.advance({"no_such_input": 1.0})))
        wrong.append((name, lambda: runner.advance({name: np.full(model.inputs[name].shape, np.nan)})))
    for row in model.parameters:
        if np.isfinite(row.lower) and not row.shape:
            wrong.append((row.name, partial(model.parameters.pack, {row.name: row.lower - 1.0 - abs(row.lower)})))
            break
    for name, call in wrong:
        try:
            call()
        except InputError as error:
            assert name in str(error), f"model {model.id!r}: the message does not name {name!r}: {error}"
        else:
            raise AssertionError(f"model {model.id!r}: {name!r} is not refused")


def check_snapshots(model: Model, parameters: Vector, inputs: Vector, backend: str = "interpreter") -> None:
    """Check that a copy of the state is complete: restored here or in another runner, it continues to the bit."""
    half = len(inputs) // 2
    runner, other = (make_runner(model, parameters, backend) for _ in range(2))
    runner.run(half, inputs[:half])
    snapshot = runner.x.copy()
    expected = runner.run(len(inputs) - half, inputs[half:])
    for restored in (runner, other):
        restored.x[:] = snapshot
        same = np.array_equal(restored.run(len(inputs) - half, inputs[half:]), expected, equal_nan=True)
        assert same, f"model {model.id!r}: a restored state continues differently"
    other.start()
    again = make_runner(model, parameters, backend)
    assert np.array_equal(other.x, again.x), f"model {model.id!r}: start() does not return to the start"


def check_backends(model: Model, parameters: Vector, inputs: Vector) -> None:
    """Check that interpreter, native code and a batch give the same bits; without a C compiler there is nothing to compare."""
    runner = make_runner(model, parameters, "interpreter")
    rows = runner.run(len(inputs), inputs)
    if find_compiler() is None:
        return
    native = make_runner(model, parameters, "native")
    assert native.run(len(inputs), inputs).tobytes() == rows.tobytes(), f"model {model.id!r}: native code gives other outputs"
    assert native.x.tobytes() == runner.x.tobytes(), f"model {model.id!r}: native code ends in another state"
    batch = make_batch(model, 3, np.tile(parameters, (3, 1)), backend="native")
    many = batch.run(len(inputs), np.tile(inputs, (3, 1, 1)), every=1)
    assert many[1].tobytes() == rows.tobytes(), f"model {model.id!r}: a row of a batch gives other outputs"
