"""modelDescription.xml, buildDescription.xml and terminalsAndIcons.xml of an FMU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from insenv.base.shipped import SENSORS, __version__
from insenv.core.model import Model
from insenv.core.tables import Row, Vector
from insenv.fmu.sources import OVERRIDE, TOKEN, main_source
from insenv.fmu.subject import Subject
from insenv.fmu.variables import UNITS, Kind, Quantity, Variable, parts, unit_of
from insenv.fmu.variables import quantity as units_quantity

_CAUSALITY = {  # of numbers; Booleans cannot be continuous
    Kind.TIME: ("independent", "continuous", None),
    Kind.CONSTANT: ("local", "constant", "exact"),
    Kind.PARAMETER: ("parameter", "fixed", "exact"),
    Kind.INPUT: ("input", "continuous", None),
    Kind.OUTPUT: ("output", "discrete", "calculated"),
}
"""Causality, variability and initial.  Inputs are sampled too, but importers are slow with inputs declared discrete."""

TERMINALS = {
    "imu": ("delta_angle", "delta_velocity", "dt", "sample_number", "imu_valid", "imu_temperature"),
    **{id: (f"{id}_",) for id in SENSORS},
    "command": ("command_",),
    "truth": ("true_", "gyro_bias_true", "accel_bias_true"),
    "navigation": ("q_nb", "velocity_n", "latitude", "longitude", "height"),
    "estimator": ("estimator_",),
}
"""Terminals: prefixes of the names of their variables.  A variable belongs to the first that matches."""


_INTERFACE = {
    "needsExecutionTool": "false",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    # the importer must not shorten steps at its events and at the stop time
    "canHandleVariableCommunicationStepSize": "false",
}
_INTERFACES = {
    2: {
        "canInterpolateInputs": "false",
        "maxOutputDerivativeOrder": "0",
        "canRunAsynchronuously": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "false",
    },
    3: {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "false",
        "providesAdjointDerivatives": "false",
        "providesPerElementDependencies": "false",
        "maxOutputDerivativeOrder": "0",
        "providesIntermediateUpdate": "false",
        "canReturnEarlyAfterIntermediateUpdate": "false",
    },
}
"""What the FMU can do, by version of FMI, beside `_INTERFACE`."""
_LOG_CATEGORIES = {
    "logStatusError": "Reasons for which calls were refused; always logged",
    "logStatusWarning": "What the results may suffer from; always logged",
    "logEvents": "Changes of state: instantiated, initialization mode, step mode, terminated, reset",
}


@dataclass(frozen=True)
class Item:
    """An entry of the model description: a row, or, without arrays, an element of a row."""

    variable: Variable
    name: str
    reference: int
    description: str
    quantity: Quantity | None
    start: Vector | None
    places: range  # of its elements within the row

    @property
    def has_type(self) -> bool:
        """Whether it has a declared type: a number with one unit."""
        return self.quantity is not None and not self.variable.row.flag


def items(variables: Sequence[Variable], arrays: bool) -> list[Item]:
    """The entries, in order; arrays: rows, not elements."""
    entries = []
    for v in variables:
        if v.kind is Kind.NONE:
            continue
        units = parts(v.row)
        if arrays:
            quantity = units_quantity(v.row, units[0]) if len(units) == 1 else None
            text = v.description + (f" [{v.row.unit}]" if len(units) > 1 else "")
            entries.append(Item(v, v.name, v.number, text, quantity, v.start, range(v.row.size)))
            continue
        for e, name in enumerate(v.elements):
            quantity = units_quantity(v.row, units[e * len(units) // v.row.size]) if units else None
            start = None if v.start is None else v.start[e : e + 1]
            entries.append(Item(v, name, v.place + e, v.element_description(e), quantity, start, range(e, e + 1)))
    return entries


def model_description(subject: Subject, variables: Sequence[Variable], fmi: int, arrays: bool) -> str:
    """modelDescription.xml, with the placeholder `TOKEN` for the token."""
    entries = items(variables, arrays)
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": subject.id,
            "guid" if fmi == 2 else "instantiationToken": TOKEN,
            "description": subject.title,
            "author": "The insenv authors",
            "version": __version__,
            "copyright": "The insenv authors; FMI headers: Modelica Association",
            "license": "Apache-2.0; FMI headers: BSD-2-Clause",
            "generationTool": f"insenv {__version__}",
            "variableNamingConvention": "structured",
        },
    )
    step = number(subject.sample_interval)
    further = {} if fmi == 2 else {"fixedInternalStepSize": step, "hasEventMode": "false"}
    interface = {"modelIdentifier": subject.identifier, **_INTERFACE, **_INTERFACES[fmi], **further}
    simulation = ET.SubElement(root, "CoSimulation", interface)
    if fmi == 2:
        ET.SubElement(ET.SubElement(simulation, "SourceFiles"), "File", name=main_source(fmi))
    _units(root, entries)
    _types(root, entries, fmi)
    categories = ET.SubElement(root, "LogCategories")
    for name, description in {**_LOG_CATEGORIES, **({"logAll": "All messages"} if fmi == 2 else {})}.items():
        ET.SubElement(categories, "Category", name=name, description=description)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=number(subject.stop_time), stepSize=step)
    listed = ET.SubElement(root, "ModelVariables")
    for entry in entries:
        _variable(listed, entry, fmi, arrays)
    _structure(root, subject.model, entries, fmi)
    return to_text(root)


def to_text(root: ET.Element) -> str:
    """The document as indented XML text."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _units(root: ET.Element, entries: Sequence[Item]) -> None:
    used = {entry.quantity.unit for entry in entries if entry.quantity and entry.has_type}
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in map(unit_of, [*(name for name in UNITS if name in used), *sorted(used - set(UNITS))]):
        element = ET.SubElement(definitions, "Unit", name=unit.name)
        if unit.exponents is not None:
            ET.SubElement(element, "BaseUnit", {base: str(power) for base, power in unit.exponents.items()})
        for display in unit.displays:
            offset = {"offset": number(display.offset)} if display.offset else {}
            ET.SubElement(element, "DisplayUnit", {"name": display.name, "factor": number(display.factor), **offset})


def _types(root: ET.Element, entries: Sequence[Item], fmi: int) -> None:
    """A declared type for each quantity, whose bounds contain those of all its variables."""
    rows: dict[Quantity, list[Row]] = {}
    for entry in entries:
        if entry.quantity and entry.has_type:
            rows.setdefault(entry.quantity, []).append(entry.variable.row)
    definitions = ET.SubElement(root, "TypeDefinitions")
    for quantity in sorted(rows, key=lambda q: q.name):
        values = {
            "quantity": quantity.quantity,
            "unit": quantity.unit,
            "displayUnit": quantity.display,
            **_bounds(min(row.lower for row in rows[quantity]), max(row.upper for row in rows[quantity])),
            "nominal": number(quantity.nominal),
        }
        values = {name: value for name, value in values.items() if value}
        _typed(definitions, fmi, "SimpleType", "Float64Type", {"name": quantity.name}, values)


def _typed(parent: ET.Element, fmi: int, outer: str, kind: str, names: dict[str, str], values: dict[str, str]) -> ET.Element:
    """An element of the kind with names and values; in FMI 2 the values stand in it, the names in an element `outer` around."""
    if fmi == 3:
        return ET.SubElement(parent, kind, {**names, **values})
    return ET.SubElement(ET.SubElement(parent, outer, names), "Real" if kind.startswith("Float64") else kind, values)


def _variable(listed: ET.Element, entry: Item, fmi: int, arrays: bool) -> None:
    row = entry.variable.row
    causality, variability, initial = _CAUSALITY[entry.variable.kind]
    if entry.variable.tunable:
        variability = "tunable"
    if row.flag and variability == "continuous":
        variability = "discrete"
    names = {"name": entry.name, "valueReference": str(entry.reference), "description": entry.description,
             "causality": causality, "variability": variability}  # fmt: skip
    if initial:
        names["initial"] = initial
    if row.flag:
        values = {} if entry.start is None else {"start": "true" if entry.start.any() else "false"}
        _typed(listed, fmi, "ScalarVariable", "Boolean", names, values)
        return
    values = {} if entry.quantity is None else {"declaredType": entry.quantity.name}
    values |= _bounds(row.lower, row.upper)
    if entry.start is not None:
        values["start"] = " ".join(number(value) for value in entry.start)
    element = _typed(listed, fmi, "ScalarVariable", "Float64", names, values)
    for length in row.shape if arrays else ():
        ET.SubElement(element, "Dimension", start=str(length))


def _structure(root: ET.Element, model: Model, entries: Sequence[Item], fmi: int) -> None:
    """The model structure.

    Outputs do not depend on inputs at the same communication point, because an input acts in the step that follows.  Initial
    outputs depend on the parameters that occur in their equations.
    """
    structure = ET.SubElement(root, "ModelStructure")
    needs = start_dependencies(model)
    # an entry is named by its number, from 1, in FMI 2, and by its value reference in FMI 3
    names = {entry.name: position if fmi == 2 else entry.reference for position, entry in enumerate(entries, 1)}
    of_parameter: dict[int, int] = {}  # name of the entry by place of the parameter's element
    for entry in entries:
        if entry.variable.kind is Kind.PARAMETER and entry.variable.row.name in model.parameters:
            first = model.parameters.slice(entry.variable.row.name).start
            of_parameter |= dict.fromkeys((first + e for e in entry.places), names[entry.name])
    outputs = [entry for entry in entries if entry.variable.kind is Kind.OUTPUT]
    for what in ("Output", "InitialUnknown"):
        parent = ET.SubElement(structure, f"{what}s") if fmi == 2 else structure
        for entry in outputs:
            depends: set[int] = set()
            if what == "InitialUnknown":
                first = model.outputs.slice(entry.variable.row.name).start
                places = np.flatnonzero(needs[[first + e for e in entry.places]].any(axis=0)).tolist()
                depends = {of_parameter[place] for place in places if place in of_parameter}
            tag, name = ("Unknown", "index") if fmi == 2 else (what, "valueReference")
            dependencies = " ".join(map(str, sorted(depends)))
            ET.SubElement(parent, tag, {name: str(names[entry.name]), "dependencies": dependencies})


def start_dependencies(model: Model) -> NDArray[np.bool_]:
    """(outputs.size, parameters.size): whether an output of the start state depends on a parameter.

    Taken from the sparsity of the equations.  An output that depends on random numbers depends on the seed.
    """
    import casadi as ca

    p = ca.SX.sym("p", model.parameters.size)
    r = ca.SX.sym("r", model.start_uniforms)
    y = model.kernels["output"].function(p, model.kernels["start"].function(p, r))
    depends = np.zeros((model.outputs.size, model.parameters.size), dtype=bool)
    if depends.size:
        rows, columns = ca.jacobian_sparsity(y, p).get_triplet()
        depends[rows, columns] = True
    if model.start_uniforms:
        rows, _ = ca.jacobian_sparsity(y, r).get_triplet()
        depends[rows, model.parameters.slice("seed").start] = True
    return depends


def build_description(subject: Subject, fmi: int) -> str:
    """sources/buildDescription.xml: how the sources are compiled, in the format of FMI 3, which FMI 2 importers read too."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=subject.identifier, description="C99 and libm")
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=main_source(fmi))
    meaning = (
        "In a shared library the functions have their plain names; leave it undefined to link several FMUs into one program"
    )
    ET.SubElement(files, "PreprocessorDefinition", name=OVERRIDE.format(fmi), optional="true", description=meaning)
    ET.SubElement(configuration, "Library", name="m", external="true", description="Mathematics of the C library")
    return to_text(root)


def terminals(variables: Sequence[Variable], arrays: bool) -> str:
    """terminalsAndIcons.xml: the variables of each sensor, bus or solution, and the place of the icon.

    For FMI 3; its format would be the same in FMI 2.0.4.
    """
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = ET.SubElement(root, "GraphicalRepresentation")
    corners = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ET.SubElement(graphics, "CoordinateSystem", {**corners, "suggestedScalingFactorTo_mm": "0.1"})
    ET.SubElement(graphics, "Icon", corners)
    groups: dict[tuple[str, Kind], list[Variable]] = {}
    for v in variables:
        if v.kind in (Kind.INPUT, Kind.OUTPUT):
            name = next((n for n, begins in TERMINALS.items() if v.row.name.startswith(begins)), None)
            if name:
                groups.setdefault((name, v.kind), []).append(v)
    listed = ET.SubElement(root, "Terminals") if groups else root
    for (name, kind), members in groups.items():
        causality = _CAUSALITY[kind][0]
        terminal = ET.SubElement(listed, "Terminal", name=name, matchingRule="bus", description=f"{name}, {causality}s")
        for member in (name for v in members for name in ([v.name] if arrays else v.elements)):
            ET.SubElement(terminal, "TerminalMemberVariable", variableName=member, memberName=member, variableKind="signal")
    return to_text(root)


def number(value: float) -> str:
    """The shortest decimal that reads back to the same double."""
    return repr(float(value))


def _bounds(lower: float, upper: float) -> dict[str, str]:
    return {name: number(value) for name, value in (("min", lower), ("max", upper)) if math.isfinite(value)}
