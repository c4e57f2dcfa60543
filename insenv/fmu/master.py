"""Run the FMUs of an SSP file in the order of the data: each step of a component uses the outputs of those before it, at once.

A master of the usual kind steps all components and then passes the values on, which delays each connection by one step.
"""

from __future__ import annotations

import tempfile
import time
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from insenv.core.progress import Progress, check_progress
from insenv.errors import InputError
from insenv.fmu.instance import PROGRESS_STEPS, Instance
from insenv.fmu.running import Outputs, steps_between

_SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
Wires = dict[tuple[str, str], tuple[str, str]]
"""Source (component, variable) of each connected input (component, variable)."""


def run_ssp(
    ssp: str | Path,
    *,
    parameters: Mapping[str, float] | None = None,
    start_time: float = 0.0,
    step: float | None = None,
    stop_time: float | None = None,
    every: int = 1,
    progress: Progress | None = None,
) -> Outputs:
    """Run the system of an SSP file (SSP 1.0, one level, FMUs for Co-Simulation) and return the outputs of all components.

    parameters: values by ``component.name``, set before initialization.  step: s; that of the components if None.  stop_time:
    s; that of the file if None.  every: record after every N steps.  Output names are ``component.variable``.  Raises
    `InputError` for a file that is not such a system, for one whose connections form a ring, and for wrong settings;
    `InsenvError` if an FMU fails.
    """
    check_progress(progress)
    with tempfile.TemporaryDirectory(prefix="insenv-ssp-") as name, ExitStack() as stack:
        sources, wires, declared = _structure(Path(ssp), Path(name))
        own: dict[str, dict[str, float]] = {component: {} for component in sources}
        for key, value in (parameters or {}).items():
            component, _, rest = key.partition(".")
            if component not in own or not rest:
                raise InputError(f"{ssp}: parameter {key!r}: allowed is COMPONENT.NAME with {', '.join(own)}")
            own[component][rest] = value
        parts = {
            c: stack.enter_context(Instance(sources[c], own[c], start_time=start_time, name=c))
            for c in _order(ssp, sources, wires)
        }
        if step is None:
            steps_declared = {part.step for part in parts.values()} - {None}
            if len(steps_declared) != 1:
                raise InputError(f"{ssp}: its components declare no common step: give one (step, --step)")
            step = steps_declared.pop()
        if step is None or not (np.isfinite(step) and step > 0.0):
            raise InputError(f"{ssp}: step = {step}: allowed is a number of seconds above 0")
        steps = steps_between(start_time, step, declared if stop_time is None else stop_time)
        if not 1 <= every <= steps:
            raise InputError(f"every = {every}: allowed is 1 to {steps}, the steps of this run")
        ports = {c: part.ports([target for owner, target in wires if owner == c]) for c, part in parts.items()}
        for (owner, target), (source, variable) in wires.items():
            ports[owner].connect(target, ports[source], variable)
        names = tuple(f"{c}.{element}" for c, part in parts.items() for v in part.outputs for element in v.elements)
        units = {f"{c}.{e}": v.unit for c, part in parts.items() for v in part.outputs for e in v.elements}
        values = np.empty((steps // every, len(names)))
        begin = time.perf_counter()
        for k in range(steps):
            for port in ports.values():
                port.step(k, start_time + k * step, step)
            if (k + 1) % every == 0:
                values[k // every] = np.concatenate([port.values() for port in ports.values()])
            if progress is not None and (k + 1) % PROGRESS_STEPS == 0:
                progress(k + 1, steps)
        seconds = time.perf_counter() - begin
        if progress is not None:
            progress(steps, steps)
    times = start_time + step * np.arange(every, steps + 1, every, dtype=np.float64)
    return Outputs(times, names, values, units, step, steps, seconds, (), ())


def _structure(ssp: Path, folder: Path) -> tuple[dict[str, Path], Wires, float | None]:
    """The FMU of each component, unpacked into `folder`; the connections between components; the stop time, s."""
    if not ssp.exists():
        raise InputError(f"{ssp}: no such file")
    try:
        with zipfile.ZipFile(ssp) as archive:
            root = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
            archive.extractall(folder)
    except (zipfile.BadZipFile, KeyError, ElementTree.ParseError, OSError) as error:
        raise InputError(f"{ssp}: not an SSP file: {error}") from None
    system = root.find(f"{_SSD}System")
    if system is None or system.find(f"{_SSD}Elements/{_SSD}System") is not None:
        raise InputError(f"{ssp}: allowed is one system without systems inside")
    sources = {}
    for component in system.iterfind(f"{_SSD}Elements/{_SSD}Component"):
        path = folder / component.get("source", "")
        if not path.is_file():
            raise InputError(f"{ssp}: component {component.get('name')}: no file {component.get('source')!r}")
        sources[component.get("name", "")] = path
    wires: Wires = {}
    for wire in system.iterfind(f"{_SSD}Connections/{_SSD}Connection"):
        start, end = wire.get("startElement"), wire.get("endElement")
        if start and end:  # the others are those of the system's own connectors
            if start not in sources or end not in sources:
                raise InputError(f"{ssp}: a connection from {start} to {end}: the components are {', '.join(sources)}")
            if len(wire):
                raise InputError(f"{ssp}: {start} to {end}: allowed is a connection without transformation")
            wires[end, wire.get("endConnector", "")] = (start, wire.get("startConnector", ""))
    experiment = root.find(f"{_SSD}DefaultExperiment")
    stop = None if experiment is None else experiment.get("stopTime")
    return sources, wires, None if stop is None else float(stop)


def _order(ssp: str | Path, sources: Mapping[str, Any], wires: Wires) -> Sequence[str]:
    """The components in the order of the data.  Raises `InputError` for a ring."""
    needs = {component: {start for (end, _), (start, _) in wires.items() if end == component} for component in sources}
    order: list[str] = []
    while len(order) < len(needs):
        ready = [component for component in needs if component not in order and needs[component] <= set(order)]
        if not ready:
            ring = ", ".join(component for component in needs if component not in order)
            raise InputError(f"{ssp}: the connections of {ring} form a ring: no component of it can be the first")
        order += ready
    return order
