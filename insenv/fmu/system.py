"""The system of an SSP file (System Structure and Parameterization 1.0): its FMUs, connections and parameter sets."""

from __future__ import annotations

import ctypes
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np

from insenv.base.errors import InputError
from insenv.base.resources import fmu_folder
from insenv.core.compile import CompileError, compile_library, find_compiler
from insenv.core.runner import Progress, check_progress, resolve_backend
from insenv.fmu.instance import Group, Instance, Move, Ports, append
from insenv.fmu.reading import Array
from insenv.fmu.running import Outputs, steps_between

# Make the steps of a system of FMUs: natively by fmu/c/master.c, or in Python where there is no C compiler.
#
# Both do what the tables say (`insenv.fmu.instance`), in the same order, and give bit-identical results.

DOING = ("setting the inputs", "the step", "reading the outputs")
STEP = DOING.index("the step")
KINDS = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?")
"""The types of values, in the order of fmu/c/master.c."""
BLOCK_SECONDS = 0.1
"""About the time between two calls of the progress function, for which an interrupt waits."""


@dataclass(frozen=True)
class Stopped:
    """Why a run ended early: the number of the part, what it was doing (place in `DOING`), and the status of the call."""

    part: int
    doing: int
    status: int


@dataclass(frozen=True)
class Plan:
    """What to do.

    parts: in the order of the data.  values: (records, outputs of all parts), filled after every `every` steps.  start: s.
    step: s.
    """

    parts: Sequence[Ports]
    values: Array
    start: float
    step: float
    every: int

    @property
    def records(self) -> list[Move]:
        """The moves from the outputs to a row of `values`."""
        row, moves = np.empty(self.values.shape[1]), list[Move]()
        for place, (given, at) in enumerate(place for part in self.parts for place in part.outputs.values()):
            append(moves, Move(row, place, given, at))
        return moves


Block = Callable[[int, int], "tuple[int, Stopped | None]"]
"""Function that makes steps: from the first one and their number, the number of those that were completed."""


def prepared(plan: Plan, backend: str | None) -> Block:
    """The steps of a plan by a backend: see `insenv.core.runner.resolve_backend`."""
    return interpreted(plan) if resolve_backend(backend) == "interpreter" else native(plan)


def make_steps(block: Block, steps: int, progress: Progress | None) -> tuple[int, Stopped | None]:
    """Make the steps in blocks; the number of those that were completed, and why they ended early."""
    done, size = 0, 1
    while done < steps:
        begin = time.perf_counter()
        made, stopped = block(done, min(size, steps - done))
        done += made
        if stopped is not None:
            return done, stopped
        size = size * 2 if time.perf_counter() - begin < BLOCK_SECONDS / 2 else max(1, size // 2)
        if progress is not None:
            progress(done, steps)
    return done, None


def interpreted(plan: Plan) -> Block:
    """Steps in Python."""
    records = plan.records

    def block(first: int, steps: int) -> tuple[int, Stopped | None]:
        for k in range(first, first + steps):
            for number, part in enumerate(plan.parts):
                stopped = _stepping_step(part, number, plan.start + k * plan.step, plan.step)
                if stopped is not None:
                    return k - first, stopped
            if (k + 1) % plan.every == 0:
                for m in records:
                    plan.values[k // plan.every, m.at : m.at + m.count] = m.source[m.place : m.place + m.count]
        return steps, None

    return block


def _stepping_step(part: Ports, number: int, now: float, step: float) -> Stopped | None:
    for m in part.moves:
        m.to[m.at : m.at + m.count] = m.source[m.place : m.place + m.count]
    for group in part.setters:
        if (status := group.call()) > 1:
            return Stopped(number, 0, status)
    if (status := part.do_step.call(now, step)) > 1 or part.do_step.flags[1].value:
        return Stopped(number, STEP, status)
    for group in part.getters:
        if (status := group.call()) > 1:
            return Stopped(number, 2, status)
    return None


class _Move(ctypes.Structure):
    _fields_ = (
        ("to", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("to_kind", ctypes.c_int32),
        ("source_kind", ctypes.c_int32),
    )


class _Group(ctypes.Structure):
    _fields_ = (
        ("function", ctypes.c_void_p),
        ("references", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("elements", ctypes.c_int64),
    )


class _Part(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("instance", "do_step", "event", "terminate", "early", "last")),
        *((name, ctypes.c_void_p) for name in ("moves", "setters", "getters")),
        *((name, ctypes.c_int64) for name in ("n_move", "n_setter", "n_getter")),
        ("version", ctypes.c_int32),
    )


class _Stop(ctypes.Structure):
    _fields_ = (("part", ctypes.c_int64), ("doing", ctypes.c_int32), ("status", ctypes.c_int32))


def native(plan: Plan) -> Block:
    """Steps in C.  Raises `CompileError` if the compiler fails."""
    function = _library().insenv_master
    parts, kept = (_Part * len(plan.parts))(), []
    for place, part in enumerate(plan.parts):
        moves, setters, getters = _moves(part.moves), _groups(part.setters), _groups(part.getters)
        kept += [moves, setters, getters]
        flags = (ctypes.addressof(flag) for flag in part.do_step.flags)
        tables = (ctypes.addressof(table) for table in (moves, setters, getters))
        counts = (len(moves), len(setters), len(getters))
        parts[place] = _Part(part.instance, part.do_step.function, *flags, *tables, *counts, part.version)
    records = _moves(plan.records, in_row=True)
    rows, size = plan.values.ctypes.data, plan.values.strides[0]

    def block(first: int, steps: int, kept: Any = kept) -> tuple[int, Stopped | None]:
        stop = _Stop(-1, 0, 0)
        tables = (parts, len(parts), records, len(records), rows, size)
        made = function(*tables, first, steps, plan.start, plan.step, plan.every, ctypes.byref(stop))
        return made, None if stop.part < 0 else Stopped(stop.part, stop.doing, stop.status)

    return block


def _moves(moves: Sequence[Move], in_row: bool = False) -> ctypes.Array[_Move]:
    """The moves as C reads them; in_row: their targets are places in a row, not addresses."""
    table = (_Move * len(moves))()
    for place, m in enumerate(moves):
        to = m.at * m.to.itemsize + (0 if in_row else m.to.ctypes.data)
        table[place] = _Move(to, m.source.ctypes.data + m.place * m.source.itemsize, m.count, _kind(m.to), _kind(m.source))
    return table


def _groups(groups: Sequence[Group]) -> ctypes.Array[_Group]:
    table = (_Group * len(groups))()
    for place, g in enumerate(groups):
        references = ctypes.addressof(g.references)
        table[place] = _Group(g.function, references, g.values.ctypes.data, len(g.references), g.values.size)
    return table


def _kind(row: Any) -> int:
    return [np.dtype(kind) for kind in KINDS].index(row.dtype)


@cache
def _library() -> ctypes.CDLL:
    compiler = find_compiler()
    if compiler is None:
        raise CompileError("no C compiler found")
    library = ctypes.CDLL(str(compile_library((fmu_folder() / "c" / "master.c").read_text(encoding="utf-8"), compiler)))
    address, whole, number = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
    tables, run = (address, whole) * 3, (whole, whole, number, number, whole, address)
    library.insenv_master.argtypes = [*tables, *run]
    library.insenv_master.restype = whole
    return library


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


# Run the FMUs of an SSP file in the order of the data: each step of a component uses the outputs of those before it, at once.
#
# A master of the usual kind steps all components and then passes the values on, which delays each connection by one step.  The
# tables of a system (`insenv.fmu.instance`) say what is done in a step, and `insenv.fmu.system` does it.


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
