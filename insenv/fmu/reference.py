"""Reference signals inside an FMU: inputs, and what the model makes of them in insenv (the interpreter, no compiler)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from insenv.core.runner import make_runner
from insenv.fmu.subject import Subject
from insenv.fmu.variables import Kind, Variable
from insenv.plant.feeding import bridge_lost, input_rows

Array = NDArray[np.float64]
STEPS = 300  # more than a second of every scenario, so that a fix comes
EVERY = 10  # samples between two rows of the outputs


def signals(subject: Subject) -> tuple[Array, Array]:
    """Inputs (STEPS, inputs.size), row k held over the k-th sample, and outputs (1 + STEPS / EVERY, outputs.size), from the
    start on.
    """
    model = subject.model
    if subject.kind == "plant":
        inputs = np.tile(model.inputs.start_vector(), (STEPS, 1))
    else:
        plant = subject.plant
        shown = make_runner(plant.model, plant.parameters, backend="interpreter").run(STEPS)
        columns = {name: np.array(column) for name, column in plant.model.outputs.unpack(shown).items()}
        columns["dt"] = np.full(STEPS, subject.sample_interval)
        bridge_lost(columns)
        inputs = input_rows(model, columns, STEPS)
    runner = make_runner(model, subject.parameters, backend="interpreter")
    begin = runner.output()
    return inputs, np.vstack([begin, runner.run(STEPS, inputs, EVERY)])


def csv(times: Sequence[float], variables: Sequence[Variable], kind: Kind, values: Array, fmi: int) -> str:
    """A table as FMPy and the rules of FMI cross-checks have it: a column an element in FMI 2, an array's elements in one
    column, parted by blanks, in FMI 3.
    """
    shown = [v for v in variables if v.kind is kind]
    first = min((v.place for v in variables if v.kind is kind or (kind is Kind.OUTPUT and v.kind is Kind.NONE)), default=0)
    names = [name for v in shown for name in (v.elements if fmi == 2 else [v.name])]
    lines = [",".join(f'"{name}"' for name in ["time", *names])]
    for time, row in zip(times, values, strict=True):
        cells = [repr(float(time))]
        for v in shown:
            numbers = [repr(float(x)) for x in row[v.place - first : v.place - first + v.row.size]]
            cells += numbers if fmi == 2 else [" ".join(numbers)]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"
