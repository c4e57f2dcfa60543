"""The system of an SSP file (System Structure and Parameterization 1.0): its FMUs, connections and parameter sets."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from insenv.base.errors import InputError

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
