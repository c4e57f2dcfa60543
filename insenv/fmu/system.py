"""Run the FMUs of an SSP file (System Structure and Parameterization 1.0) in the order of the data.

A master of the usual kind steps all components and then passes the values on, which delays each connection by one step.  Here
each step of a component uses the outputs of those before it, at once (`insenv.fmu.stepping`).
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from insenv.base.errors import InputError
from insenv.core.runner import Progress, check_progress
from insenv.fmu.instance import Instance
from insenv.fmu.running import Outputs, checked_step, recorded, steps_between

_SSP = "http://ssp-standard.org/SSP1/SystemStructure"
_SSD, _SSV = f"{{{_SSP}Description}}", f"{{{_SSP}ParameterValues}}"
_TYPES = {f"{_SSV}{name}" for name in ("Real", "Integer", "Boolean")}
_NUMBERS = {"true": 1.0, "false": 0.0}

Wires = Mapping[tuple[str, str], tuple[str, str]]
"""Source (component, variable) of each connected input (component, variable)."""


@dataclass(frozen=True)
class Setting:
    """Value of a parameter, and its unit or an empty text."""

    value: float
    unit: str


@dataclass(frozen=True)
class System:
    """Components and how they are connected.

    sources: the FMU of each component.  wires: the connections between components.  settings: the values of the parameter
    sets, by component and parameter.  stop_time: s.
    """

    sources: Mapping[str, Path]
    wires: Wires
    settings: Mapping[str, Mapping[str, Setting]]
    stop_time: float | None

    @property
    def order(self) -> list[str]:
        """The components in the order of the data.  Raises `InputError` for a ring."""
        needs: dict[str, set[str]] = {component: set() for component in self.sources}
        for (end, _), (start, _) in self.wires.items():
            needs[end].add(start)
        order: list[str] = []
        while len(order) < len(needs):
            ready = [component for component in needs if component not in order and needs[component] <= set(order)]
            if not ready:
                ring = ", ".join(component for component in needs if component not in order)
                raise InputError(f"the connections of {ring} form a ring: no component of it can be the first")
            order += ready
        return order


def read_system(ssp: Path, folder: Path) -> System:
    """Unpack an SSP file into `folder` and read its system.

    Raises `InputError` for a file that is not one system of FMUs, for a connection with a transformation and for a parameter
    set that cannot be read.
    """
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
    sources: dict[str, Path] = {}
    settings: dict[str, dict[str, Setting]] = {}
    for component in system.iterfind(f"{_SSD}Elements/{_SSD}Component"):
        name, path = component.get("name", ""), folder / component.get("source", "")
        if not path.is_file():
            raise InputError(f"{ssp}: component {name}: no file {component.get('source')!r}")
        sources[name], settings[name] = path, dict(_bound(ssp, component, folder))
    for name, setting in _bound(ssp, system, folder):
        owner, _, parameter = name.partition(".")
        if owner not in sources or not parameter:
            raise InputError(f"{ssp}: parameter {name!r} of the system: allowed is COMPONENT.NAME with {', '.join(sources)}")
        settings[owner][parameter] = setting
    experiment = root.find(f"{_SSD}DefaultExperiment")
    stop = None if experiment is None else experiment.get("stopTime")
    stop_time = None if stop is None else _number(ssp, "stopTime", stop)
    return System(sources, dict(_wires(ssp, system, sources)), settings, stop_time)


def _wires(
    ssp: Path, system: ElementTree.Element, sources: Mapping[str, Path]
) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    for wire in system.iterfind(f"{_SSD}Connections/{_SSD}Connection"):
        start, end = wire.get("startElement"), wire.get("endElement")
        if start and end:  # the others are those of the system's own connectors
            if start not in sources or end not in sources:
                raise InputError(f"{ssp}: a connection from {start} to {end}: the components are {', '.join(sources)}")
            if len(wire):
                raise InputError(f"{ssp}: {start} to {end}: allowed is a connection without transformation")
            yield (end, wire.get("endConnector", "")), (start, wire.get("startConnector", ""))


def _bound(ssp: Path, element: ElementTree.Element, folder: Path) -> Iterator[tuple[str, Setting]]:
    """The parameters of the sets that are bound to a component or the system, in a file or in place."""
    for binding in element.iterfind(f"{_SSD}ParameterBindings/{_SSD}ParameterBinding"):
        source = binding.get("source")
        if binding.find(f"{_SSD}ParameterMapping") is not None:
            raise InputError(f"{ssp}: parameter set {source or 'in place'}: allowed is one without a mapping")
        if source is None:
            sets = binding.findall(f"{_SSD}ParameterValues/{_SSV}ParameterSet")
        else:
            try:
                sets = [ElementTree.fromstring((folder / source).read_bytes())]
            except (OSError, ElementTree.ParseError) as error:
                raise InputError(f"{ssp}: parameter set {source!r} cannot be read: {error}") from None
        for parameter in (p for listed in sets for p in listed.iterfind(f"{_SSV}Parameters/{_SSV}Parameter")):
            name = binding.get("prefix", "") + parameter.get("name", "")
            typed = next((child for child in parameter if child.tag in _TYPES), None)
            if typed is None:
                raise InputError(f"{ssp}: parameter {name!r}: allowed is Real, Integer or Boolean")
            yield name, Setting(_number(ssp, name, typed.get("value", "")), typed.get("unit", ""))


def _number(ssp: Path, name: str, text: str) -> float:
    try:
        return _NUMBERS[text.strip()] if text.strip() in _NUMBERS else float(text)
    except ValueError:
        raise InputError(f"{ssp}: {name} = {text!r}: allowed is a number") from None


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
        parameters_of = _settings(ssp, system, parameters or {})
        parts = {
            c: stack.enter_context(
                Instance(system.sources[c], parameters_of[c], start_time=start_time, name=c, label=f"{ssp}, component {c}")
            )
            for c in order
        }
        _check_units(ssp, system, parts)
        if step is None:
            step = _common_step(ssp, parts.values())
        step = checked_step(ssp, step)
        steps = steps_between(start_time, step, system.stop_time if stop_time is None else stop_time)
        ports = {c: part.ports([target for owner, target in system.wires if owner == c]) for c, part in parts.items()}
        for (owner, target), (source, variable) in system.wires.items():
            ports[owner].connect(target, ports[source], variable)
        units = {f"{c}.{e}": v.unit for c, part in parts.items() for v in part.outputs for e in v.elements}
        instances, tables = list(parts.values()), list(ports.values())
        return recorded(instances, tables, units, start_time, step, steps, every, backend, progress)


def _settings(ssp: str | Path, system: System, parameters: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """The parameters of each component: those of the file, replaced by `parameters`."""
    values = {component: {name: s.value for name, s in settings.items()} for component, settings in system.settings.items()}
    for key, value in parameters.items():
        component, _, rest = key.partition(".")
        if component not in values or not rest:
            raise InputError(f"{ssp}: parameter {key!r}: allowed is COMPONENT.NAME with {', '.join(values)}")
        values[component].pop(f"parameters.{rest}", None)
        values[component][rest] = value
    return values


def _check_units(ssp: str | Path, system: System, parts: Mapping[str, Instance]) -> None:
    for component, settings in system.settings.items():
        for name, setting in settings.items():
            variable = parts[component].variables.get(name)
            if variable is not None and setting.unit not in ("", variable.unit):
                what = f"{ssp}, component {component}: {name} in {setting.unit}"
                raise InputError(f"{what}: allowed is the unit of the FMU, {variable.unit or 'none'}")


def _common_step(ssp: str | Path, parts: Iterable[Instance]) -> float:
    declared = {part.step for part in parts if part.step is not None}
    if len(declared) != 1:
        raise InputError(f"{ssp}: its components declare no common step: give one (step, --step)")
    return declared.pop()
