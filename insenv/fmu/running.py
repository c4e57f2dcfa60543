"""Run an FMU (FMI 2 or 3, Co-Simulation) over long sampled inputs, fast.

Row k of the inputs is set at its time t and holds over [t, t + step]; the outputs of this step are recorded at t + step.
An inertial sample therefore stands in the row of the time at which it begins.  Without inputs (a plant) the FMU is stepped
up to its stop time.
"""

from __future__ import annotations

import csv
import math
import re
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import atomic
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Array
from insenv.fmu.instance import Instance
from insenv.fmu.reading import Variable, element_names
from insenv.fmu.stepping import DOING, STEPPING, Plan, Ports, make_steps, prepared
from insenv.logs.formats.csv_table import check_finite, read_table

# Sampled inputs and outputs of an FMU as CSV: a column ``time``, s, and one for each element of each variable.
#
# The elements of an array have the columns ``name[1]``, ``name[2]``, ... (of a matrix ``"name[1,1]"``, ...), the same for FMI 2
# and 3.  One column of the array's name with blanks between the elements, as FMPy writes them for FMI 3, can be read too.

_ELEMENT = re.compile(r"(.*)\[(\d+(?:,\d+)*)\]")


@dataclass(frozen=True)
class Series:
    """Values at times.

    time: (rows,) s.  names: of the elements.  values: (rows, elements).
    """

    time: Array
    names: tuple[str, ...]
    values: Array

    def columns(self) -> dict[str, Array]:
        """(rows,) by element name."""
        return dict(zip(self.names, self.values.T, strict=True))

    def named(self) -> dict[str, Array]:
        """Arrays by variable name: (rows,), (rows, n) or (rows, r, c)."""
        elements: dict[str, list[Array]] = {}
        shapes: dict[str, tuple[int, ...]] = {}  # the place of the last element
        for name, column in self.columns().items():
            match = _ELEMENT.fullmatch(name)
            variable = match[1] if match else name
            elements.setdefault(variable, []).append(column)
            shapes[variable] = tuple(map(int, match[2].split(","))) if match else ()
        return {name: np.stack(columns, axis=1).reshape(-1, *shapes[name]) for name, columns in elements.items()}


def flattened(inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Columns (rows,) by element name, from arrays by variable or element name: (rows,), (rows, n) or (rows, r, c)."""
    flat: dict[str, Array] = {}
    for name, value in inputs.items():
        array = np.asarray(value, dtype=np.float64)
        array = array.reshape(1) if array.ndim == 0 else array
        names = element_names(name, array.shape[1:])
        flat |= zip(names, array.reshape(len(array), -1).T, strict=True)
    return flat


def read_csv(path: str | Path, switched: Collection[str] = ()) -> Series:
    """Read a CSV file.

    switched: columns that may hold NaN: inputs that a flag switches off (`insenv.fmu.reading.switched_inputs`).
    Raises `InputError`, with file, line and column, if it cannot be read, if ``time`` is missing, or if a value is missing,
    not a number or not finite.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    heading, _, body = raw.removeprefix(b"\xef\xbb\xbf").partition(b"\n")
    names = [name.strip() for name in next(csv.reader([heading.decode("utf-8", "replace").strip()]), [])]
    if "time" not in names:
        raise InputError(f"{path}: no column 'time' in its first line: {', '.join(names)[:200] or 'empty'}")
    first = body.partition(b"\n")[0].decode("utf-8", "replace").split(",")
    widths = [len(cell.split()) for cell in first] + [1] * (len(names) - len(first))
    if max(widths) > 1:  # arrays with blanks between the elements
        names = [e for name, n in zip(names, widths, strict=False) for e in element_names(name, (n,) if n > 1 else ())]
        body = re.sub(rb"[ \t]*,[ \t]*", b",", body).replace(b" ", b",")
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise InputError(f"{path}: repeated columns: {', '.join(sorted(repeated))}")
    # the table reader does not accept the commas of quoted names: it gets placeholders
    plain = [f"column{place + 1}" for place in range(len(names))]
    try:
        table = read_table(str(path), ",".join(plain).encode() + b"\n" + body, plain, delimiter=",", header_rows=1)
        check_finite(table, [plain[names.index(name)] for name in switched if name in names])
    except InputError as error:
        message = re.sub(r"'column(\d+)'", lambda match: repr(names[int(match[1]) - 1]), str(error))
        raise InputError(message.partition("; skip_empty")[0]) from None  # a key of the description of a log
    place = names.index("time")
    rest = [i for i in range(len(names)) if i != place]
    return Series(table.values[:, place], tuple(names[i] for i in rest), table.values[:, rest])


def write_csv(path: str | Path, series: Series) -> None:
    """Write a CSV file under a temporary name, then rename it; every number reads back to the same double.

    Raises `InsenvError` if it cannot be written.
    """
    path = Path(path)
    quoted = [f'"{name}"' if "," in name else name for name in series.names]
    try:
        with atomic(path) as stream:
            stream.write(f"{','.join(['time', *quoted])}\n".encode("ascii"))
            for time, row in zip(series.time.tolist(), series.values.tolist(), strict=True):
                stream.write(f"{','.join(map(repr, [time, *row]))}\n".encode("ascii"))
    except OSError as error:
        raise InsenvError(f"cannot write {path}: {error.strerror or error}") from None


MAX_STEPS = 10**9


@dataclass(frozen=True)
class Outputs(Series):
    """Outputs of a run of an FMU, or of the FMUs of a system.

    units: by element name.  step: s.  steps: number of steps recorded; fewer than requested if an FMU ended the simulation
    itself (`ended`).  seconds: wall-clock time of the steps.
    passed_over: columns that are not inputs of the FMU.  held: inputs without a column, which keep their start values.
    """

    units: Mapping[str, str]
    step: float
    steps: int
    seconds: float
    ended: bool = False
    passed_over: tuple[str, ...] = ()
    held: tuple[str, ...] = ()


def run(
    fmu: str | Path,
    inputs: Series | Mapping[str, Array] | None = None,
    *,
    parameters: Mapping[str, float] | None = None,
    start_time: float = 0.0,
    step: float | None = None,
    stop_time: float | None = None,
    every: int = 1,
    backend: str | None = None,
    progress: Progress | None = None,
) -> Outputs:
    """Run `fmu` (a file) over `inputs` and return its outputs after every `every` steps.

    inputs: a `Series`, or arrays by name with time along the first axis; SI.  The times of a `Series` are used: the first is
    the start time, and they must be `step` apart.  Columns that are not inputs of the FMU are ignored, but at least one must
    be an input.  parameters: values by name, set before initialization.  step: s; the FMU's own if None.  stop_time: s; with
    inputs None is one step after the last of them, and a later time is refused.  backend: "native" (steps in compiled C),
    "interpreter" (in Python), or None: as in `insenv.core.runner.make_runner`.  Raises `InputError` for inputs or settings that
    do not fit, `InsenvError` if the FMU fails.
    """
    check_progress(progress)
    if isinstance(inputs, Series) and len(inputs.time):
        start_time = float(inputs.time[0])
    columns = inputs.columns() if isinstance(inputs, Series) else flattened(inputs or {})
    with Instance(fmu, parameters, start_time=start_time) as instance:
        step = checked_step(fmu, instance.step if step is None else step)
        names = [name for variable in instance.inputs for name in variable.elements]
        used, passed_over, held = _chosen(names, columns)
        if columns and not used:
            raise InputError(f"no column is an input of {fmu} (columns: {some(list(columns))}; inputs: {some(names)})")
        if isinstance(inputs, Series):
            _check_times(inputs.time, step)
        _check_types(fmu, instance.inputs, used)
        stop_time = instance.stop_time if stop_time is None and not used else stop_time
        steps = _steps(used, start_time, step, stop_time)
        ports = instance.ports(used)
        ports.follow({name: column[:steps] for name, column in used.items()})
        units = {name: variable.unit for variable in instance.outputs for name in variable.elements}
        outputs = recorded([instance], [ports], units, start_time, step, steps, every, backend, progress)
    return replace(outputs, passed_over=tuple(passed_over), held=tuple(held))


def recorded(
    instances: Sequence[Instance],
    ports: Sequence[Ports],
    units: Mapping[str, str],
    start_time: float,
    step: float,
    steps: int,
    every: int,
    backend: str | None,
    progress: Progress | None,
) -> Outputs:
    """Make `steps` steps of the instances in the order of the data; record all outputs, whose units are `units` by name.

    Raises `InputError` for an `every` that is not 1 to `steps`, `InsenvError` with the messages of the FMU if a call fails.
    """
    if not 1 <= every <= steps:
        raise InputError(f"every = {every}: allowed is 1 to {steps}, the steps of this run")
    values = np.empty((steps // every, len(units)))
    block = prepared(Plan(ports, values, start_time, step, every), backend)
    begin = time.perf_counter()
    done, stopped = make_steps(block, steps, progress)
    seconds = time.perf_counter() - begin
    if stopped is not None:
        instance = instances[stopped.part]
        if stopped.doing != STEPPING or not instance.ends(stopped.status):
            raise instance.failure(DOING[stopped.doing], done, start_time + done * step, stopped.status)
        values = values[: done // every]
    ended = done < steps
    times = start_time + step * np.arange(every, every * len(values) + 1, every, dtype=np.float64)
    steps = len(values) * every if ended else steps
    return Outputs(times, tuple(units), values, units, step, steps, seconds, ended)


def checked_step(label: str | Path, step: float | None) -> float:
    """The communication step, s.  Raises `InputError` for none, and for one that is not above 0."""
    if step is None:
        raise InputError(f"{label} declares no step: give one (step, --step)")
    if not (math.isfinite(step) and step > 0.0):
        raise InputError(f"{label}: step = {step}: allowed is a number of seconds above 0")
    return step


def steps_between(start_time: float, step: float, stop_time: float | None) -> int:
    """The number of steps to the stop time.  Raises `InputError` unless it is 1 to `MAX_STEPS`."""
    steps = math.inf if stop_time is None else (stop_time - start_time) / step
    if not 0.5 < steps <= MAX_STEPS:
        raise InputError(
            f"stop time {stop_time} s: allowed is one step, {step:g} s, to {MAX_STEPS:.0e} of them after {start_time:g} s "
            "(stop_time, --stop; step, --step)"
        )
    return round(steps)


def some(names: Sequence[str]) -> str:
    """The first eight names, and how many more there are."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") or "none"


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


def _check_times(time: Array, step: float) -> None:
    """Raise `InputError` unless the times are `step` apart: each within a tenth, and on average within a thousandth."""
    gaps = np.diff(time)
    if not len(gaps):
        return
    wrong = np.flatnonzero(np.abs(gaps - step) > 0.1 * step)
    if min(abs(gap - step) for gap in (float(gaps.mean()), float(np.median(gaps)))) > 1e-3 * step:
        raise InputError(f"inputs: rows are {np.median(gaps):.6g} s apart, steps are {step:g} s: set the step with --step")
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"inputs: time = {time[k + 1]:.9g} s in row {k + 2} follows {time[k]:.9g} s: allowed is a step of {step:g} s "
            f"within a tenth; fill gaps first ({wrong.size} such row{'s' if wrong.size > 1 else ''})"
        )


def _chosen(names: Sequence[str], columns: Mapping[str, Array]) -> tuple[dict[str, Array], list[str], list[str]]:
    """Columns that are inputs, names of the other columns, and inputs without a column.

    Raises `InputError` for an array of which only some elements have columns.
    """
    used = {name: columns[name] for name in names if name in columns}
    held = [name for name in names if name not in used]
    partial = {name.rpartition("[")[0] for name in used} - {""}
    for name in held:
        if name.rpartition("[")[0] in partial:
            raise InputError(f"input {name} has no column, but other elements of this array have one: give all or none")
    return used, [name for name in columns if name not in used], held


def _check_types(fmu: str | Path, variables: Sequence[Variable], used: Mapping[str, Array]) -> None:
    """Raise `InputError` for a value that the type of its input cannot hold, such as 0.5 for a Boolean."""
    for variable in variables:
        for name in variable.elements:
            row = variable.first_wrong(used[name]) if name in used else None
            if row is not None:
                raise InputError(f"{fmu}: input {name} = {used[name][row]:g} in row {row + 1}: {variable.allowed}")
