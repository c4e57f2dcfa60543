"""An FMU that FMPy loads: its parameters set, initialized, its variables as the tables that a master steps through.

FMPy reads the description, unpacks the archive, and creates the instance with its logger.  The functions of the binary are
called with addresses in preallocated arrays, so that a long run costs little more than the FMU itself.
"""

from __future__ import annotations

import ctypes
import functools
import re
import shutil
import tempfile
from collections.abc import Container, Mapping, Sequence
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.fmu.reading import KINDS, KINDS_3, Variable, read_description, read_variable
from insenv.fmu.stepping import Group, Ports, Row

MAX_MESSAGES = 20
"""Largest number of messages of the FMU in an error."""
REFUSAL = "allowed is"
"""Part of each message of fmu/c/instance.h about a value or a step that the caller chooses."""
_INSTANCES: WeakValueDictionary[int, Instance] = WeakValueDictionary()
"""Instances of FMI 2 by their component environment."""
_TERMINATED = 3  # fmi2StatusKind
_LABELS = ("ok", "warning", "discard", "error", "fatal", "pending")


class Instance:
    """An initialized instance of a Co-Simulation FMU (FMI 2 or 3); a context manager that frees it.

    version: 2 or 3.  inputs, outputs: its variables.  messages: its log.  warnings: those of them that are no reasons of a
    failure.
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

        self.path, self.name = Path(path), name
        self.label = label or str(path)
        self.messages: list[str] = []
        self.warnings: list[str] = []
        self._folder = Path(tempfile.mkdtemp(prefix="insenv-fmu-"))
        self._slave: Any = None
        # FMI 3: event needed, simulation ended, step ended early, and at which time
        self._flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool(), ctypes.c_double())
        try:
            self.description = read_description(self.path)
            self.version = int(self.description.fmiVersion[0])
            self._kinds = KINDS if self.version == 2 else KINDS_3
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
        step = fixed or (default.stepSize if default is not None else None)
        return None if step is None else float(step)

    @property
    def stop_time(self) -> float | None:
        """The stop time of the FMU's default experiment, s, or None."""
        default = self.description.defaultExperiment
        return None if default is None or default.stopTime is None else float(default.stopTime)

    def ports(self, connected: Container[str]) -> Ports:
        """The inputs named in `connected` and all outputs, for a master."""
        setters, inputs = self._groups("Set", [v for v in self.inputs if any(name in connected for name in v.elements)])
        getters, outputs = self._groups("Get", self.outputs)
        outputs = {name: outputs[name] for variable in self.outputs for name in variable.elements}
        address, number = ctypes.c_void_p, ctypes.c_double
        do_step = self._slave.dll[f"fmi{self.version}DoStep"]
        do_step.argtypes = [
            address,
            number,
            number,
            *([ctypes.c_int] if self.version == 2 else [ctypes.c_bool] + [address] * 4),
        ]
        return Ports(self.name, self.version, self._component, setters, getters, inputs, outputs, do_step, self._flags)

    def ends(self, status: int) -> bool:
        """Whether the FMU has ended the simulation in the last step."""
        if self.version == 3:
            return bool(self._flags[1].value)
        if status != _LABELS.index("discard"):
            return False
        ended = ctypes.c_int()
        function = self._slave.dll["fmi2GetBooleanStatus"]
        function.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p]
        return function(self._component, _TERMINATED, ctypes.byref(ended)) == 0 and bool(ended.value)

    def failure(self, doing: str, k: int, time: float, status: int) -> InsenvError:
        """The error of a call that failed: `InputError` if the FMU says what is allowed, so that the caller can correct it."""
        label = _LABELS[status] if 0 <= status < len(_LABELS) else str(status)
        reason = self._reason()
        kind = InputError if REFUSAL in reason else InsenvError
        return kind(f"{self.label}: {doing} failed at step {k}, t = {time:g} s ({label}): {reason or 'no reason given'}")

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
            else:
                slave.instantiate(logMessage=lambda _, status, category, text: self._log(status, text))
                self._set_parameters(parameters)
                slave.enterInitializationMode(startTime=start_time)
            slave.exitInitializationMode()
        except InsenvError:
            raise
        except Exception as error:  # the exceptions of FMPy differ between its versions
            raise InputError(f"{self.label}: cannot be initialized: {self._reason() or error}") from None

    def _set_parameters(self, parameters: Mapping[str, float]) -> None:
        scalar = {v.name: v for v in self.variables.values() if v.causality == "parameter" and len(v.elements) == 1}
        names: dict[str, str] = {}  # by which each was set
        for name, value in parameters.items():
            variable = scalar.get(name) or scalar.get(f"parameters.{name}")
            if variable is None:
                known = [parameter.removeprefix("parameters.") for parameter in scalar]
                # a plant has hundreds of elements: an array is named once
                allowed = dict.fromkeys(re.sub(r"\[.*", "[...]", parameter) for parameter in known)
                near = nearest(name.removeprefix("parameters."), allowed, "modelDescription.xml in the FMU")
                raise InputError(f"{self.label}: no scalar parameter {name!r}{near}")
            if variable.name in names:
                raise InputError(
                    f"{self.label}: parameter {variable.name} is set twice: as {names[variable.name]} and as {name}"
                )
            names[variable.name] = name
            if not isinstance(value, Real) or (isinstance(value, bool) and variable.kind != "Boolean"):
                raise InputError(f"{self.label}: parameter {name} = {value!r}: {variable.allowed}")
            if variable.first_wrong(np.array([value], dtype=np.float64)) is not None:
                raise InputError(f"{self.label}: parameter {name} = {value:.15g}: {variable.allowed}")
            group = self._group("Set", [variable])
            group.values[:] = value
            if (status := group.call(self.version, self._component)()) > 1:
                reason = self._reason() or _LABELS[status]
                raise InputError(f"{self.label}: parameter {name} = {value:.15g} refused: {reason}")

    def _groups(self, verb: str, variables: Sequence[Variable]) -> tuple[list[Group], dict[str, tuple[Row, int]]]:
        """Groups of variables, by the functions that set or get them; and the place of each element by its name."""
        by_function: dict[str, list[Variable]] = {}
        for variable in variables:
            by_function.setdefault(self._kinds[variable.kind][1], []).append(variable)
        groups: list[Group] = []
        places: dict[str, tuple[Row, int]] = {}
        for members in by_function.values():
            groups.append(self._group(verb, members))
            names = (name for variable in members for name in variable.elements)
            places |= {name: (groups[-1].values, place) for place, name in enumerate(names)}
        return groups, places

    def _group(self, verb: str, variables: Sequence[Variable]) -> Group:
        """The group of variables of one kind; verb: "Set" or "Get"."""
        kind, suffix = self._kinds[variables[0].kind]
        function = self._slave.dll[f"fmi{self.version}{verb}{suffix}"]
        size, address = ctypes.c_size_t, ctypes.c_void_p
        function.argtypes = [address, address, size, address] + ([size] if self.version == 3 else [])
        references = (ctypes.c_uint32 * len(variables))(*(v.reference for v in variables))
        return Group(function, references, np.zeros(sum(len(v.elements) for v in variables), dtype=kind))

    @property
    def _component(self) -> int:
        component = self._slave.component
        return int(getattr(component, "value", component))

    def _log(self, status: int, text: bytes | None) -> None:
        log = self.warnings if status == _LABELS.index("warning") else self.messages
        if status and text and len(log) < MAX_MESSAGES:
            log.append(text.decode("utf-8", "replace"))

    def _reason(self) -> str:
        """What the FMU has logged, in one line."""
        return "; ".join(dict.fromkeys(self.messages or self.warnings))

    def _callbacks(self) -> Any:
        """The callbacks of FMI 2, whose logger keeps the messages, formatted if FMPy has its helper for this.

        The helper keeps the address of the last logger that it was given, for all FMUs of the process.  After a simulation by
        FMPy that may be one that has been freed, so it is given ours again for each instance.
        """
        from fmpy import fmi2

        _INSTANCES[id(self)] = self
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.componentEnvironment = id(self)
        callbacks.logger = _logger()
        callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
        callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
        try:
            from fmpy.logging import addLoggerProxy
        except OSError:  # FMPy has no such helper for this platform
            return callbacks
        addLoggerProxy(ctypes.byref(callbacks))
        return callbacks


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
            instance._log(status, text)

    return fmi2CallbackLoggerTYPE(log)
