"""Run the FMUs of an SSP file in the order of the data: each step of a component uses the outputs of those before it, at once.

A master of the usual kind steps all components and then passes the values on, which delays each connection by one step.  The
tables of a system (`insenv.fmu.instance`) say what is done in a step, and `insenv.fmu.stepping` does it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from insenv.base.errors import InputError
from insenv.core.runner import Progress, check_progress
from insenv.fmu.instance import Instance
from insenv.fmu.running import Outputs, steps_between
from insenv.fmu.stepping import DOING, STEP, Plan, make_steps, prepared
from insenv.fmu.system import System, read_system


def run_ssp(
    ssp: str | Path,
    *,
    parameters: Mapping[str, float] | None = None,
    start_time: float = 0.0,
    step: float | None = None,
    stop_time: float | None = None,
    every: int = 1,
    backend: str | None = None,
    progress: Progress | None = None,
) -> Outputs:
    """Run the system of an SSP file (SSP 1.0, one level, FMUs for Co-Simulation) and return the outputs of all components.

    The parameter sets (SSV) of the file are applied.  parameters: further values by ``component.name``, set before
    initialization.  step: s; that of the components if None.  stop_time: s; that of the file if None.  every: record after
    every N steps.  backend: "native" (compiled C), "interpreter" (Python), or None: as in `insenv.core.runner.make_runner`.
    Output names are ``component.variable``.  Raises `InputError` for a file that is not such a system, for one whose
    connections form a ring, and for wrong settings; `InsenvError` if an FMU fails.
    """
    check_progress(progress)
    with TemporaryDirectory(prefix="insenv-ssp-") as name, ExitStack() as stack:
        system = read_system(Path(ssp), Path(name))
        try:
            order = system.order
        except InputError as error:
            raise InputError(f"{ssp}: {error}") from None
        own = _settings(ssp, system, parameters or {})
        parts = {
            c: stack.enter_context(
                Instance(system.sources[c], own[c], start_time=start_time, name=c, label=f"{ssp}, component {c}")
            )
            for c in order
        }
        _check_units(ssp, system, parts)
        step = _step(ssp, parts.values()) if step is None else step
        if not (np.isfinite(step) and step > 0.0):
            raise InputError(f"{ssp}: step = {step}: allowed is a number of seconds above 0")
        steps = steps_between(start_time, step, system.stop_time if stop_time is None else stop_time)
        if not 1 <= every <= steps:
            raise InputError(f"every = {every}: allowed is 1 to {steps}, the steps of this run")
        ports = {c: part.ports(c, [target for owner, target in system.wires if owner == c]) for c, part in parts.items()}
        for (owner, target), (source, variable) in system.wires.items():
            ports[owner].connect(target, ports[source], variable)
        units = {f"{c}.{e}": v.unit for c, part in parts.items() for v in part.outputs for e in v.elements}
        values = np.empty((steps // every, len(units)))
        block = prepared(Plan(list(ports.values()), values, start_time, step, every), backend)
        begin = time.perf_counter()
        done, stopped = make_steps(block, steps, progress)
        seconds = time.perf_counter() - begin
        if stopped is not None:
            instance = parts[order[stopped.part]]
            if stopped.doing != STEP or not instance.ends(stopped.status):
                raise instance.failure(DOING[stopped.doing], done, start_time + done * step, stopped.status)
            values, steps = values[: done // every], done // every * every
    times = start_time + step * np.arange(every, every * len(values) + 1, every, dtype=np.float64)
    return Outputs(times, tuple(units), values, units, step, steps, seconds, (), (), stopped is not None)


def _settings(ssp: str | Path, system: System, parameters: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """The parameters of each component: those of the file, replaced by the given ones."""
    own = {component: {name: s.value for name, s in settings.items()} for component, settings in system.settings.items()}
    for key, value in parameters.items():
        component, _, rest = key.partition(".")
        if component not in own or not rest:
            raise InputError(f"{ssp}: parameter {key!r}: allowed is COMPONENT.NAME with {', '.join(own)}")
        own[component].pop(f"parameters.{rest}", None)
        own[component][rest] = value
    return own


def _check_units(ssp: str | Path, system: System, parts: Mapping[str, Instance]) -> None:
    for component, settings in system.settings.items():
        for name, setting in settings.items():
            variable = parts[component].variables.get(name)
            if variable is not None and setting.unit not in ("", variable.unit):
                what = f"{ssp}, component {component}: {name} in {setting.unit}"
                raise InputError(f"{what}: allowed is the unit of the FMU, {variable.unit or 'none'}")


def _step(ssp: str | Path, parts: Iterable[Instance]) -> float:
    declared = {part.step for part in parts if part.step is not None}
    if len(declared) != 1:
        raise InputError(f"{ssp}: its components declare no common step: give one (step, --step)")
    return declared.pop()
