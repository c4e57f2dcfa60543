"""An FMU that FMPy loads, stepped over arrays: three calls into its binary per step, and no conversion between them.

FMPy reads the description, unpacks the archive, and creates the instance with its logger.  The loop passes addresses within
preallocated arrays, so that a long sampled input costs little more than the FMU itself.
"""

from __future__ import annotations

import ctypes
import functools
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.core.runner import Progress
from insenv.fmu.reading import KINDS, KINDS_3, Array, Variable, read_description, read_variable

# The connected inputs and all outputs of an instance, as the tables that a master steps through.

Row = NDArray[Any]


@dataclass(frozen=True)
class Group:
    """The variables of an instance that one function sets or gets.

    call: the call, which gives a status.  function: its address.  references: of the variables.  values: (elements,), which the
    call reads or fills.
    """

    call: Callable[[], int]
    function: int
    references: Any
    values: Row


@dataclass(frozen=True)
class Step:
    """The function that advances an instance by a step from a time, and its address; flags: those that FMI 3 returns."""

    call: Callable[[float, float], int]
    function: int
    flags: Sequence[Any]


@dataclass(frozen=True)
class Move:
    """Copy `count` values from a place of one row to a place of another."""

    to: Row
    at: int
    source: Row
    place: int
    count: int = 1


Place = tuple[Row, int]
"""A row of values, and a place in it."""


@dataclass
class Ports:
    """An instance in a system.

    name: of its component.  setters: groups of its connected inputs.  getters: groups of its outputs.  inputs, outputs: the
    `Place` of each element by its name.  moves: those of its connections, made before it steps.
    """

    name: str
    version: int
    instance: int
    setters: Sequence[Group]
    getters: Sequence[Group]
    inputs: Mapping[str, Place]
    outputs: Mapping[str, Place]
    do_step: Step
    moves: list[Move] = field(default_factory=list)

    def connect(self, target: str, source: Ports, variable: str) -> None:
        """Take input `target` from the output `variable` of another instance.

        Raises `InputError` for an unknown name and for types between which values would be lost.
        """
        if target not in self.inputs:
            raise InputError(f"{self.name}: no input {target!r}")
        if variable not in source.outputs:
            raise InputError(f"{source.name}: no output {variable!r}")
        (to, at), (given, place) = self.inputs[target], source.outputs[variable]
        if not np.can_cast(given.dtype, to.dtype, "safe"):
            what = f"{source.name}.{variable} ({given.dtype}) to {self.name}.{target} ({to.dtype})"
            raise InputError(f"a connection from {what} would lose values: allowed are types that hold them all")
        append(self.moves, Move(to, at, given, place))


def append(moves: list[Move], move: Move) -> None:
    """Append a move, as part of the last one if it continues it."""
    last = moves[-1] if moves else None
    if (
        last is not None
        and last.to is move.to
        and last.source is move.source
        and (move.at, move.place) == (last.at + last.count, last.place + last.count)
    ):
        moves[-1] = Move(last.to, last.at, last.source, last.place, last.count + move.count)
    else:
        moves.append(move)


PROGRESS_STEPS = 5_000  # steps between two calls of the progress function
MOST_MESSAGES = 20  # messages of the FMU kept for an error
_INSTANCES: WeakValueDictionary[int, Instance] = WeakValueDictionary()
"""Instances of FMI 2 by their component environment."""
REFUSAL = "allowed is"
"""Part of each message of fmu/c/instance.h about a value or a step that the caller chooses."""
_TERMINATED = 3  # fmi2StatusKind
_LABELS = ("ok", "warning", "discard", "error", "fatal", "pending")


class Instance:
    """An initialized instance of a Co-Simulation FMU (FMI 2 or 3); a context manager that frees it.

    version: 2 or 3.  inputs, outputs: its variables.  messages: its log.
    """

    def __init__(
        self,
        path: str | Path,
        parameters: Mapping[str, float] | None = None,
        *,
        start_time: float = 0.0,
        name: str = "insenv",
        label: str | None = None,
    ) -> None:
        """Unpack, load, set parameters, initialize.

        label: how messages name the FMU; None: by its path.  Raises `InputError` for a file that is not such an FMU and for a
        parameter that is unknown or refused, `InsenvError` if the FMU cannot be loaded on this machine.
        """
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.path = Path(path)
        self.label = label or str(path)
        self.messages: list[str] = []
        self._folder = Path(tempfile.mkdtemp(prefix="insenv-fmu-"))
        self._slave: Any = None
        # FMI 3: event needed, simulation ended, step ended early, and at which time
        self._flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double())
        try:
            self.description = read_description(self.path)
            self.version = int(self.description.fmiVersion[0])
            self.variables = {v.name: v for v in map(read_variable, self.description.modelVariables) if v is not None}
            self.inputs = [v for v in self.variables.values() if v.causality == "input"]
            self.outputs = [v for v in self.variables.values() if v.causality == "output"]
            try:
                fmpy.extract(str(self.path), str(self._folder))
            except Exception as error:  # a damaged member, or a path outside the folder
                kind = InsenvError if isinstance(error, OSError) else InputError
                raise kind(f"{self.label}: cannot be unpacked: {error}") from None
            kind = FMU2Slave if self.version == 2 else FMU3Slave
            try:
                self._slave = kind(
                    guid=self.description.guid,
                    unzipDirectory=str(self._folder.resolve()),
                    modelIdentifier=self.description.coSimulation.modelIdentifier,
                    instanceName=name,
                )
            except Exception as error:  # FMPy raises a bare Exception
                raise InsenvError(f"{self.label}: cannot be loaded on {fmpy.platform_tuple}: {error}") from None
            self._start(parameters or {}, start_time)
        except BaseException:
            self.close()
            raise

    @property
    def step(self) -> float | None:
        """The communication step that the FMU declares, s, or None."""
        fixed = getattr(self.description.coSimulation, "fixedInternalStepSize", None)
        default = self.description.defaultExperiment
        chosen = fixed or (default.stepSize if default is not None else None)
        return None if chosen is None else float(chosen)

    @property
    def stop_time(self) -> float | None:
        """The stop time of the FMU's default experiment, s, or None."""
        default = self.description.defaultExperiment
        return None if default is None or default.stopTime is None else float(default.stopTime)

    def run(
        self, inputs: Mapping[str, Array], steps: int, *, start_time: float, step: float, every: int, progress: Progress | None
    ) -> Array:
        """Make `steps` steps of `step` seconds; return the outputs after every `every` steps, (steps // every, elements).

        inputs: (steps,) by element name, with all elements of an array.  Value k is set before step k, which begins at
        start_time + k step.  Other inputs keep their values.  An FMU that ends the simulation itself gives fewer rows.  Raises
        `InsenvError` with the FMU's messages if a call fails.
        """
        setters = [self._calls("Set", group, _packed(group, inputs, steps)) for group in self._groups(self.inputs, inputs)]
        recorded = steps // every
        groups = self._groups(self.outputs)
        arrays = [np.zeros((recorded, sum(len(v.elements) for v in g)), dtype=self._dtype(g)) for g in groups]
        getters = [self._calls("Get", group, array) for group, array in zip(groups, arrays, strict=True)]
        do_step, ended = self._do_step(), False
        for k in range(steps):
            for call, address, stride, changes in setters:
                if (changes is None or changes[k]) and (status := call(address + k * stride)) > 1:
                    raise self.failure("setting the inputs", k, start_time + k * step, status)
            status = do_step(start_time + k * step, step)
            if self.ends(status):
                ended = True
                if status > 1:  # this step was not made to its end
                    recorded = k // every
                    break
            elif status > 1:
                raise self.failure("the step", k, start_time + k * step, status)
            if (k + 1) % every == 0:
                for call, address, stride, _ in getters:
                    if (status := call(address + k // every * stride)) > 1:
                        raise self.failure("reading the outputs", k, start_time + k * step, status)
            if ended:
                recorded = (k + 1) // every
                break
            if progress is not None and (k + 1) % PROGRESS_STEPS == 0:
                progress(k + 1, steps)
        if progress is not None:
            progress(steps, steps)
        columns = {
            name: array[:recorded, place]
            for group, array in zip(groups, arrays, strict=True)
            for place, name in enumerate(_names(group))
        }
        return np.array([columns[n] for v in self.outputs for n in v.elements], dtype=np.float64).reshape(-1, recorded).T

    def ports(self, name: str, connected: Sequence[str]) -> Ports:
        """The inputs named in `connected` and all outputs, for a master that steps it as the component `name`."""
        wanted = dict.fromkeys(connected, np.zeros(1))
        groups: tuple[list[Group], list[Group]] = ([], [])
        places: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
        listed = (self._groups(self.inputs, wanted), self._groups(self.outputs))
        for verb, kept, found, parts in zip(("Set", "Get"), groups, places, listed, strict=True):
            for part in parts:
                rows = np.zeros((1, len(_names(part))), dtype=self._dtype(part))
                call, address, _, _ = self._calls(verb, part, rows)
                row = rows[0]
                function = self._slave.dll[f"fmi{self.version}{verb}{self._kinds[part[0].kind][1]}"]
                kept.append(Group(functools.partial(call, address), _address(function), self._references(part), row))
                found.update({element: (row, place) for place, element in enumerate(_names(part))})
        order = {name: places[1][name] for variable in self.outputs for name in variable.elements}
        step = Step(self._do_step(), _address(self._slave.dll[f"fmi{self.version}DoStep"]), self._flags)
        return Ports(name, self.version, self._component, *groups, places[0], order, step)

    def close(self) -> None:
        """Free the instance and remove the unpacked files."""
        if self._slave is not None:
            if self._slave.component:
                self._slave.freeInstance()
            else:
                self._slave.freeLibrary()
        self._slave = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _start(self, parameters: Mapping[str, float], start_time: float) -> None:
        slave = self._slave
        try:
            if self.version == 2:
                slave.instantiate(callbacks=self._callbacks(), loggingOn=False)
                slave.setupExperiment(startTime=start_time)
                self._set_parameters(parameters)
                slave.enterInitializationMode()
                slave.exitInitializationMode()
            else:
                slave.instantiate(logMessage=lambda _, status, category, text: self._log(status, category, text))
                self._set_parameters(parameters)
                slave.enterInitializationMode(startTime=start_time)
                slave.exitInitializationMode()
        except InsenvError:
            raise
        except Exception as error:  # the exceptions of FMPy differ between its versions
            raise InputError(f"{self.label}: cannot be initialized: {self._said() or error}") from None

    def _set_parameters(self, parameters: Mapping[str, float]) -> None:
        scalar = {v.name: v for v in self.variables.values() if v.causality == "parameter" and len(v.elements) == 1}
        taken: dict[str, str] = {}
        for name, value in parameters.items():
            variable = scalar.get(name) or scalar.get(f"parameters.{name}")
            if variable is None:
                known = [parameter.removeprefix("parameters.") for parameter in scalar]
                # a plant has hundreds of elements: an array is named once
                allowed = dict.fromkeys(re.sub(r"\[.*", "[...]", parameter) for parameter in known)
                near = nearest(name.removeprefix("parameters."), allowed, "modelDescription.xml in the FMU")
                raise InputError(f"{self.label}: no scalar parameter {name!r}{near}")
            if variable.name in taken:
                raise InputError(
                    f"{self.label}: parameter {variable.name} is set twice: as {taken[variable.name]} and as {name}"
                )
            taken[variable.name] = name
            group = [variable]
            if not isinstance(value, Real) or (isinstance(value, bool) and variable.kind != "Boolean"):
                raise InputError(f"{self.label}: parameter {name} = {value!r}: {variable.allowed}")
            if variable.first_wrong(np.array([value], dtype=np.float64)) is not None:
                raise InputError(f"{self.label}: parameter {name} = {value:.15g}: {variable.allowed}")
            call, address, _, _ = self._calls("Set", group, np.full((1, 1), value).astype(self._dtype(group)))
            if (status := call(address)) > 1:
                raise InputError(f"{self.label}: parameter {name} = {value:.15g} refused: {self._said() or _LABELS[status]}")

    def ends(self, status: int) -> bool:
        """Whether the FMU has ended the simulation in the last step."""
        if self.version == 3:
            return bool(self._flags[1].value)
        if status != _LABELS.index("discard"):
            return False
        ended = ctypes.c_int()
        function = self._slave.dll["fmi2GetBooleanStatus"]
        function.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p]
        return function(ctypes.c_void_p(self._component), _TERMINATED, ctypes.byref(ended)) == 0 and bool(ended.value)

    def _callbacks(self) -> Any:
        """The callbacks of FMI 2, with a logger that keeps the messages."""
        callbacks = _callbacks()
        _INSTANCES[id(self)] = self
        callbacks.componentEnvironment = id(self)
        return callbacks

    def _log(self, status: int, category: bytes | None, text: bytes | None) -> None:
        if status and text and len(self.messages) < MOST_MESSAGES:
            self.messages.append(text.decode("utf-8", "replace"))

    def _said(self) -> str:
        return "; ".join(dict.fromkeys(self.messages))

    def failure(self, doing: str, k: int, time: float, status: int) -> InsenvError:
        """The error of a call that failed: `InputError` if the FMU says what is allowed, so that the caller can mend it."""
        label = _LABELS[status] if 0 <= status < len(_LABELS) else str(status)
        said = self._said()
        kind = InputError if REFUSAL in said else InsenvError
        return kind(f"{self.label}: {doing} failed at step {k}, t = {time:g} s ({label}): {said or 'no reason given'}")

    def _groups(self, variables: Sequence[Variable], given: Mapping[str, Array] | None = None) -> list[list[Variable]]:
        """Variables grouped by the functions that set or get them; with `given` only those that it names."""
        groups: dict[str, list[Variable]] = {}
        for variable in variables:
            if given is None or any(name in given for name in variable.elements):
                groups.setdefault(self._kinds[variable.kind][1], []).append(variable)
        return list(groups.values())

    @property
    def _kinds(self) -> Mapping[str, tuple[Any, str]]:
        return KINDS if self.version == 2 else KINDS_3

    def _dtype(self, group: Sequence[Variable]) -> Any:
        return self._kinds[group[0].kind][0]

    def _calls(self, verb: str, group: Sequence[Variable], values: NDArray[Any]) -> Any:
        """A function of the address of a row of `values`; the address of the first row; bytes per row; rows that change.

        values: (rows, elements of the group).  The function keeps a reference to it.
        """
        values = values.astype(self._dtype(group), copy=False)
        function = self._slave.dll[f"fmi{self.version}{verb}{self._kinds[group[0].kind][1]}"]
        size, pointer = ctypes.c_size_t, ctypes.c_void_p
        function.argtypes = [pointer, pointer, size, pointer] + ([size] if self.version == 3 else [])
        references = self._references(group)
        component = pointer(self._component)
        count, elements = size(len(group)), size(values.shape[1])

        if self.version == 2:

            def call(address: int, kept: Any = (references, values)) -> int:
                return int(function(component, references, count, address))

        else:

            def call(address: int, kept: Any = (references, values)) -> int:
                return int(function(component, references, count, address, elements))

        changes = None
        if verb == "Set" and self._dtype(group) is not np.float64:  # flags change rarely
            changes = [True, *np.any(values[1:] != values[:-1], axis=1).tolist()]
        return call, values.ctypes.data, values.strides[0], changes

    @staticmethod
    def _references(group: Sequence[Variable]) -> Any:
        return (ctypes.c_uint32 * len(group))(*(v.reference for v in group))

    def _do_step(self) -> Callable[[float, float], int]:
        function = self._slave.dll[f"fmi{self.version}DoStep"]
        component = ctypes.c_void_p(self._component)
        if self.version == 2:
            function.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int]
            return lambda time, step: int(function(component, time, step, 1))
        function.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_bool] + [ctypes.c_void_p] * 4
        places = tuple(ctypes.c_void_p(ctypes.addressof(place)) for place in self._flags)

        def do_step(time: float, step: float, kept: Any = self._flags) -> int:
            return int(function(component, time, step, True, *places))

        return do_step

    @property
    def _component(self) -> int:
        component = self._slave.component
        return int(getattr(component, "value", component))


@functools.cache
def _logger() -> Any:
    """The logger of FMI 2 for all instances of the process; prints the messages of FMUs that are not ours, as FMPy does."""
    from fmpy.fmi1 import printLogMessage
    from fmpy.fmi2 import fmi2CallbackLoggerTYPE

    def log(environment: int | None, name: bytes, status: int, category: bytes | None, text: bytes) -> None:
        instance = _INSTANCES.get(environment or 0)
        if instance is None:
            printLogMessage(environment, name, status, category, text)
        else:
            instance._log(status, category, text)

    return fmi2CallbackLoggerTYPE(log)


def _callbacks() -> Any:
    """The callbacks of FMI 2 for one instance; messages are formatted if FMPy has its helper for this.

    The helper keeps the address of the last logger that it was given, for all FMUs of the process.  After a simulation by FMPy
    that may be one that has been freed, so it is given ours again for each instance.
    """
    from fmpy import fmi2

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _logger()
    callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
    try:
        from fmpy.logging import addLoggerProxy
    except OSError:  # FMPy has no such helper for this platform
        return callbacks
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def _names(group: Sequence[Variable]) -> list[str]:
    return [name for variable in group for name in variable.elements]


def _packed(group: Sequence[Variable], inputs: Mapping[str, Array], steps: int) -> Array:
    """The columns of a group as one array, (steps, elements)."""
    return np.ascontiguousarray(np.array([np.broadcast_to(inputs[name], (steps,)) for name in _names(group)]).T)
