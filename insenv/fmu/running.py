"""Run an FMU (FMI 2 or 3, Co-Simulation) over long sampled inputs, fast.

Row k of the inputs is set at its time t and holds over [t, t + step]; the outputs of this step are recorded at t + step.
An inertial sample therefore stands in the row of the time at which it begins.  Without inputs (a plant) the FMU is stepped
up to its stop time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError
from insenv.core.runner import Progress, check_progress
from insenv.fmu.instance import Instance
from insenv.fmu.reading import Array, Variable
from insenv.fmu.series import Series, chosen, flattened, uniform

MOST_STEPS = 10**9


@dataclass(frozen=True)
class Outputs(Series):
    """Outputs of a run of an FMU.

    units: by element name.  step: s.  steps: number of steps recorded; fewer than asked for if the FMU ended the simulation
    itself (`ended`).  seconds: wall-clock time of the steps.
    passed_over: given columns that are not inputs of the FMU.  held: inputs without a column, which keep their start values.
    """

    units: Mapping[str, str]
    step: float
    steps: int
    seconds: float
    passed_over: tuple[str, ...]
    held: tuple[str, ...]
    ended: bool = False


def run(
    fmu: str | Path,
    inputs: Series | Mapping[str, Array] | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
    start_time: float = 0.0,
    step: float | None = None,
    stop_time: float | None = None,
    every: int = 1,
    progress: Progress | None = None,
) -> Outputs:
    """Run `fmu` (a file) over `inputs` and return its outputs after every `every` steps.

    inputs: a `Series`, or arrays by name with time along the first axis; SI.  The times of a `Series` are used: the first is
    the start time, and they must be `step` apart.  Columns that are not inputs of the FMU are ignored, but at least one must
    be an input.  parameters: values by name, set before initialization.  step: s; the FMU's own if None.  stop_time: s; with
    inputs None is one step after the last of them, and a later time is refused.  Raises `InputError` for inputs or settings
    that do not fit, `InsenvError` if the FMU fails.
    """
    check_progress(progress)
    if isinstance(inputs, Series) and len(inputs.time):
        start_time = float(inputs.time[0])
    given = inputs.columns() if isinstance(inputs, Series) else flattened(inputs or {})
    with Instance(fmu, parameters, start_time=start_time) as instance:
        step = instance.step if step is None else step
        if step is None:
            raise InputError(f"{fmu} declares no step: give one (step, --step)")
        if not (math.isfinite(step) and step > 0.0):
            raise InputError(f"{fmu}: step = {step}: allowed is a number of seconds above 0")
        names = [name for variable in instance.inputs for name in variable.elements]
        used, passed_over, held = chosen(names, given)
        if given and not used:
            raise InputError(f"no column is an input of {fmu} (columns: {some(list(given))}; inputs: {some(names)})")
        if isinstance(inputs, Series):
            uniform(inputs.time, step, "inputs")
        _check_types(fmu, instance.inputs, used)
        stop_time = instance.stop_time if stop_time is None and not used else stop_time
        steps = _steps(used, start_time, step, stop_time)
        if not 1 <= every <= steps:
            raise InputError(f"every = {every}: allowed is 1 to {steps}, the steps of this run")
        begin = time.perf_counter()
        values = instance.run(
            {name: column[:steps] for name, column in used.items()},
            steps,
            start_time=start_time,
            step=step,
            every=every,
            progress=progress,
        )
        seconds = time.perf_counter() - begin
        ended = len(values) < steps // every
        steps = len(values) * every if ended else steps
        units = {name: variable.unit for variable in instance.outputs for name in variable.elements}
    times = start_time + step * np.arange(every, every * len(values) + 1, every, dtype=np.float64)
    return Outputs(times, tuple(units), values, units, step, steps, seconds, tuple(passed_over), tuple(held), ended)


def _steps(used: Mapping[str, Array], start_time: float, step: float, stop_time: float | None) -> int:
    lengths = {len(column) for column in used.values()}
    if len(lengths) > 1:
        raise InputError(f"inputs of different lengths: {sorted(lengths)}")
    if not lengths:
        if stop_time is None:
            raise InputError("neither inputs nor a stop time: nothing to run")
        return steps_between(start_time, step, stop_time)
    most = lengths.pop()
    steps = steps_between(start_time, step, start_time + most * step if stop_time is None else stop_time)
    if steps > most:
        raise InputError(
            f"stop time {stop_time} s: the inputs end at {start_time + most * step:.9g} s, one step of {step:g} s after their "
            "last row; allowed is a time up to that (stop_time, --stop)"
        )
    return steps


def _check_types(fmu: str | Path, variables: Sequence[Variable], used: Mapping[str, Array]) -> None:
    """Raise `InputError` for a value that the type of its input cannot hold, such as 0.5 for a Boolean."""
    for variable in variables:
        for name in variable.elements:
            row = variable.first_wrong(used[name]) if name in used else None
            if row is not None:
                raise InputError(f"{fmu}: input {name} = {used[name][row]:g} in row {row + 1}: {variable.allowed}")


def steps_between(start_time: float, step: float, stop_time: float | None) -> int:
    """The number of steps to the stop time.  Raises `InputError` unless it is 1 to `MOST_STEPS`."""
    steps = math.inf if stop_time is None else (stop_time - start_time) / step
    if not 0.5 < steps <= MOST_STEPS:
        raise InputError(
            f"stop time {stop_time} s: allowed is one step, {step:g} s, to {MOST_STEPS:.0e} of them after {start_time:g} s "
            "(stop_time, --stop; step, --step)"
        )
    return round(steps)


def some(names: Sequence[str]) -> str:
    """The first eight names, and how many more there are."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") or "none"
