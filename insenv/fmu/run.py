"""Run an FMU (FMI 2 or 3, Co-Simulation) over long sampled inputs, fast.

    python -m insenv.fmu.run X.fmu --input log.csv --output out.csv

Row k of the inputs is set at its time t and holds over [t, t + step]; the outputs that this step gives are recorded at
t + step: an inertial sample stands in the row of the time at which it begins.  Without inputs (a plant) the FMU is stepped up
to its stop time.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insenv.errors import InputError, InsenvError
from insenv.files.output import check_output_file
from insenv.fmu.instance import Array, Instance, Progress
from insenv.fmu.series import Series, chosen, flattened, read_csv, uniform, write_csv

MOST_STEPS = 10**9


@dataclass(frozen=True)
class Outputs(Series):
    """What an FMU gave.

    units: by element name.  step: s.  steps: made.  seconds: that the steps took.  passed_over: columns that are no input.
    held: inputs that no column set.
    """

    units: Mapping[str, str]
    step: float
    steps: int
    seconds: float
    passed_over: tuple[str, ...]
    held: tuple[str, ...]


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
    """Run `fmu` (a file) over `inputs` and give its outputs after each `every` steps.

    inputs: a `Series`, or arrays by name, time along the first axis; SI.  With a `Series` its times count: the first is the
    start, and they must stand `step` apart.  Columns that the FMU has not are passed over, but one must be an input.
    parameters: values by name, set before the initialization.  step: s, the FMU's own if None.  stop_time: s; with inputs the
    run ends with them at the latest.  Raises `InputError` for what does not fit, `InsenvError` if the FMU fails.
    """
    if isinstance(inputs, Series) and len(inputs.time):
        start_time = float(inputs.time[0])
    given = inputs.columns() if isinstance(inputs, Series) else flattened(inputs or {})
    with Instance(fmu, parameters, start_time=start_time) as instance:
        step = instance.step if step is None else step
        if step is None or not (math.isfinite(step) and step > 0.0):
            raise InputError(f"{fmu}: step = {step}: allowed is a number of seconds above 0")
        names = [name for variable in instance.inputs for name in variable.elements]
        used, passed_over, held = chosen(names, given)
        if given and not used:
            raise InputError(f"no column is an input of {fmu} (columns: {_some(list(given))}; inputs: {_some(names)})")
        if isinstance(inputs, Series):
            uniform(inputs.time, step, "inputs")
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
        units = {name: variable.unit for variable in instance.outputs for name in variable.elements}
    times = start_time + step * np.arange(every, steps + 1, every, dtype=np.float64)
    return Outputs(times, tuple(units), values, units, step, steps, seconds, tuple(passed_over), tuple(held))


def _steps(used: Mapping[str, Array], start_time: float, step: float, stop_time: float | None) -> int:
    lengths = {len(column) for column in used.values()}
    if len(lengths) > 1:
        raise InputError(f"inputs of different lengths: {sorted(lengths)}")
    if stop_time is None and not lengths:
        raise InputError("neither inputs nor a stop time: nothing to run")
    wanted = math.inf if stop_time is None else (stop_time - start_time) / step
    steps = min(wanted, lengths.pop() if lengths else math.inf)
    if not 0.5 < steps <= MOST_STEPS:
        raise InputError(
            f"stop time {stop_time} s: allowed is one step, {step:g} s, to {MOST_STEPS:.0e} of them after {start_time:g} s"
        )
    return round(steps)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "") or "none"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; gives its exit status: 0 done, 1 the work failed, 2 the call was wrong."""
    parser = argparse.ArgumentParser(prog="python -m insenv.fmu.run", description="Run an FMU over long sampled inputs, fast.")
    parser.add_argument("fmu", type=Path, metavar="X.fmu")
    parser.add_argument("--input", type=Path, metavar="CSV", help="a column time and one for each element of an input")
    parser.add_argument("--output", type=Path, metavar="CSV", help="write the outputs there")
    parser.add_argument("--step", type=float, metavar="S", help="communication step; the FMU's own if left out")
    parser.add_argument("--stop", type=float, metavar="S", help="stop time; without --input the FMU's own if left out")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="record after each N steps")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter; may be repeated")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout and nothing else")
    chosen_arguments = parser.parse_args(arguments)
    try:
        _work(chosen_arguments)
        sys.stdout.flush()
    except InsenvError as error:
        print(f"insenv: {error}", file=sys.stderr)
        if chosen_arguments.json:
            kind = "InputError" if isinstance(error, InputError) else "InsenvError"
            print(json.dumps({"error": {"type": kind, "message": str(error)}}))
        return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        print("insenv: interrupted, nothing written", file=sys.stderr)
        return 130
    except MemoryError:
        print("insenv: out of memory", file=sys.stderr)
        return 1
    except BrokenPipeError:  # whoever read our output, as `head` does, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter would complain at its exit
        return 141
    return 0


def _work(arguments: argparse.Namespace) -> None:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    if arguments.output is not None:
        check_output_file(arguments.output)
    inputs = None if arguments.input is None else read_csv(arguments.input)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(arguments.fmu.name, total=None)
        found = run(
            arguments.fmu,
            inputs,
            parameters=_parameters(arguments.set),
            step=arguments.step,
            stop_time=arguments.stop,
            every=arguments.every,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    if arguments.output is not None:
        write_csv(arguments.output, found)
    if arguments.json:
        print(json.dumps(_document(arguments, found)))
        return
    for label, names in (("columns that are no input", found.passed_over), ("inputs that no column sets", found.held)):
        if names:
            print(f"insenv: {label}: {_some(names)}", file=sys.stderr)
    print(f"{found.steps} steps of {found.step:g} s, {found.seconds / found.steps * 1e6:.2f} us a step")
    if arguments.output is not None:
        print(f"written: {arguments.output}, {len(found.time)} rows of {len(found.names)} outputs")
    else:
        width = max(len(name) for name in found.names)
        print(f"outputs at {found.time[-1]:g} s (--output CSV writes all):")
        for name, value in zip(found.names, found.values[-1].tolist(), strict=True):
            print(f"  {name:<{width}}  {value:.9g} {'' if found.units[name] == '1' else found.units[name]}".rstrip())


def _parameters(settings: Sequence[str]) -> dict[str, float]:
    values = {}
    for setting in settings:
        name, sign, text = setting.partition("=")
        try:
            values[name] = float(text)
        except ValueError:
            sign = ""
        if not sign or not math.isfinite(values[name]):
            raise InputError(f"--set {setting}: allowed is NAME=VALUE with a finite number")
    return values


def _document(arguments: argparse.Namespace, found: Outputs) -> dict[str, Any]:
    return {
        "fmu": str(arguments.fmu),
        "steps": found.steps,
        "step_s": found.step,
        "us_per_step": found.seconds / found.steps * 1e6,
        "passed_over": list(found.passed_over),
        "held": list(found.held),
        "time_s": float(found.time[-1]),
        "outputs": {n: v if math.isfinite(v) else None for n, v in zip(found.names, found.values[-1].tolist(), strict=True)},
        "written": None if arguments.output is None else str(arguments.output),
    }


if __name__ == "__main__":
    sys.exit(main())
