"""modelDescription.xml, buildDescription.xml and terminalsAndIcons.xml of an FMU."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from insenv.base.shipped import SENSORS
from insenv.base.version import __version__
from insenv.core.model import Model
from insenv.core.tables import Vector
from insenv.fmu.sources import OVERRIDE, TOKEN, main_source
from insenv.fmu.subject import Subject
from insenv.fmu.variables import UNITS, Kind, Quantity, Unit, Variable, parts
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
    "imu": ("delta_angle", "delta_velocity", "dt", "imu_valid", "imu_temperature"),
    "gnss": ("gnss_",),
    **{id: (f"{id}_",) for id in SENSORS if id != "gnss"},
    "command": ("command_",),
    "truth": ("true_", "gyro_bias_true", "accel_bias_true"),
    "navigation": ("q_nb", "velocity_n", "latitude", "longitude", "height"),
    "estimator": ("estimator_",),
}
"""Terminals: prefixes of the names of their variables.  A variable belongs to the first that matches."""


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


def items(variables: Sequence[Variable], arrays: bool) -> list[Item]:
    """The entries, in order; arrays: rows, not elements."""
    found = []
    for v in variables:
        if v.kind is Kind.NONE:
            continue
        kinds = parts(v.row)
        if arrays:
            quantity = units_quantity(v.row, kinds[0]) if len(kinds) == 1 else None
            text = v.description + (f" [{v.row.unit}]" if len(kinds) > 1 else "")
            found.append(Item(v, v.name, v.number, text, quantity, v.start, range(v.row.size)))
            continue
        for e, name in enumerate(v.elements):
            quantity = units_quantity(v.row, kinds[e * len(kinds) // v.row.size]) if kinds else None
            start = None if v.start is None else v.start[e : e + 1]
            found.append(Item(v, name, v.place + e, v.element_description(e), quantity, start, range(e, e + 1)))
    return found


def model_description(subject: Subject, variables: Sequence[Variable], fmi: int, arrays: bool) -> str:
    """modelDescription.xml, with the placeholder `TOKEN` for the token."""
    entries = items(variables, arrays)
    root = ET.Element("fmiModelDescription", _head(subject, fmi))
    _interface(root, subject, fmi)
    _units(root, entries)
    _types(root, entries, fmi)
    _log_categories(root, fmi)
    step = number(subject.sample_interval)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=number(subject.stop_time), stepSize=step)
    listed = ET.SubElement(root, "ModelVariables")
    for entry in entries:
        _variable(listed, entry, fmi, arrays)
    _structure(root, subject, variables, entries, fmi)
    return to_text(root)


def to_text(root: ET.Element) -> str:
    """The document as indented XML text."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _head(subject: Subject, fmi: int) -> dict[str, str]:
    return {
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
    }


def _interface(root: ET.Element, subject: Subject, fmi: int) -> None:
    # the importer must not shorten steps at its events and at the stop time
    same = {
        "modelIdentifier": subject.identifier,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canHandleVariableCommunicationStepSize": "false",
    }
    if fmi == 2:
        own = {
            "canInterpolateInputs": "false",
            "maxOutputDerivativeOrder": "0",
            "canRunAsynchronuously": "false",
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "providesDirectionalDerivative": "false",
        }
        files = ET.SubElement(ET.SubElement(root, "CoSimulation", {**same, **own}), "SourceFiles")
        ET.SubElement(files, "File", name=main_source(fmi))
        return
    own = {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "false",
        "providesAdjointDerivatives": "false",
        "providesPerElementDependencies": "false",
        "maxOutputDerivativeOrder": "0",
        "providesIntermediateUpdate": "false",
        "canReturnEarlyAfterIntermediateUpdate": "false",
        "fixedInternalStepSize": number(subject.sample_interval),
        "hasEventMode": "false",
    }
    ET.SubElement(root, "CoSimulation", {**same, **own})


def _units(root: ET.Element, entries: Sequence[Item]) -> None:
    used = {entry.quantity.unit for entry in entries if entry.quantity and not entry.variable.row.flag}
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in [*(n for n in UNITS if n in used), *sorted(used - set(UNITS))]:
        unit = UNITS.get(name, Unit(name, None))
        element = ET.SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            ET.SubElement(element, "BaseUnit", {base: str(power) for base, power in unit.exponents.items()})
        for shown in unit.displays:
            offset = {"offset": number(shown.offset)} if shown.offset else {}
            ET.SubElement(element, "DisplayUnit", {"name": shown.name, "factor": number(shown.factor), **offset})


def _types(root: ET.Element, entries: Sequence[Item], fmi: int) -> None:
    """A declared type for each quantity, whose bounds contain those of all its variables."""
    bounds: dict[Quantity, list[tuple[float, float]]] = {}
    for entry in entries:
        if entry.quantity and not entry.variable.row.flag:
            bounds.setdefault(entry.quantity, []).append((entry.variable.row.lower, entry.variable.row.upper))
    definitions = ET.SubElement(root, "TypeDefinitions")
    for quantity in sorted(bounds, key=lambda q: q.name):
        values = {
            "quantity": quantity.quantity,
            "unit": quantity.unit,
            "displayUnit": quantity.display,
            "min": _bound(min(lower for lower, _ in bounds[quantity])),
            "max": _bound(max(upper for _, upper in bounds[quantity])),
            "nominal": number(quantity.nominal),
        }
        values = {name: value for name, value in values.items() if value}
        if fmi == 2:
            ET.SubElement(ET.SubElement(definitions, "SimpleType", name=quantity.name), "Real", values)
        else:
            ET.SubElement(definitions, "Float64Type", {"name": quantity.name, **values})


def _log_categories(root: ET.Element, fmi: int) -> None:
    listed = ET.SubElement(root, "LogCategories")
    categories = {
        "logStatusError": "Reasons for which calls were refused; always logged",
        "logEvents": "Changes of state: instantiated, initialization mode, step mode, terminated, reset",
    }
    if fmi == 2:
        categories["logAll"] = "All messages"
    for name, description in categories.items():
        ET.SubElement(listed, "Category", name=name, description=description)


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
        if fmi == 2:
            ET.SubElement(ET.SubElement(listed, "ScalarVariable", names), "Boolean", values)
        else:
            ET.SubElement(listed, "Boolean", {**names, **values})
        return
    values = {} if entry.quantity is None else {"declaredType": entry.quantity.name}
    values |= {name: bound for name, bound in (("min", _bound(row.lower)), ("max", _bound(row.upper))) if bound}
    if entry.start is not None:
        values["start"] = " ".join(number(value) for value in entry.start)
    if fmi == 2:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", names), "Real", values)
        return
    element = ET.SubElement(listed, "Float64", {**names, **values})
    for length in row.shape if arrays else ():
        ET.SubElement(element, "Dimension", start=str(length))


def _structure(root: ET.Element, subject: Subject, variables: Sequence[Variable], entries: Sequence[Item], fmi: int) -> None:
    """The model structure.

    Outputs do not depend on inputs at the same communication point, because an input acts in the step that follows.  Initial
    outputs depend on the parameters that occur in their equations.
    """
    structure = ET.SubElement(root, "ModelStructure")
    needs = start_dependencies(subject.model)
    # a dependency is the number of the entry, from 1, in FMI 2, and the value reference in FMI 3
    known: dict[tuple[str, int], int] = {}
    for position, entry in enumerate(entries, 1):
        if entry.variable.kind is Kind.PARAMETER:
            for element in entry.places:
                known[entry.variable.row.name, element] = position if fmi == 2 else entry.reference
    table = subject.model.parameters
    of_place = [(row.name, element) for row in table for element in range(row.size)]
    lists: dict[str, ET.Element] = {}
    if fmi == 2:
        lists = {name: ET.SubElement(structure, name) for name in ("Outputs", "InitialUnknowns")}
    for what in ("Output", "InitialUnknown"):
        for position, entry in enumerate(entries, 1):
            if entry.variable.kind is not Kind.OUTPUT:
                continue
            depends: list[int] = []
            if what == "InitialUnknown":
                first = subject.model.outputs.slice(entry.variable.row.name).start
                columns = np.flatnonzero(needs[[first + e for e in entry.places]].any(axis=0))
                depends = sorted({known[of_place[c]] for c in columns if of_place[c] in known})
            text = " ".join(map(str, depends))
            if fmi == 2:
                ET.SubElement(lists[f"{what}s"], "Unknown", index=str(position), dependencies=text)
            else:
                ET.SubElement(structure, what, valueReference=str(entry.reference), dependencies=text)


def start_dependencies(model: Model) -> NDArray[np.bool_]:
    """(outputs.size, parameters.size): whether an output of the start state depends on a parameter.

    Taken from the sparsity of the equations.  An output that depends on random numbers depends on the seed.
    """
    import casadi as ca

    p = ca.SX.sym("p", model.parameters.size)
    r = ca.SX.sym("r", model.start_uniforms)
    y = model.kernels["output"].function(p, model.kernels["start"].function(p, r))
    found = np.zeros((model.outputs.size, model.parameters.size), dtype=bool)
    if found.size:
        rows, columns = ca.jacobian_sparsity(y, p).get_triplet()
        found[rows, columns] = True
    if model.start_uniforms:
        rows, _ = ca.jacobian_sparsity(y, r).get_triplet()
        found[rows, model.parameters.slice("seed").start] = True
    return found


def build_description(subject: Subject, fmi: int) -> str:
    """sources/buildDescription.xml: how the sources are compiled, in the format of FMI 3, which FMI 2 importers read too."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=subject.identifier, description="C99 and libm")
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=main_source(fmi))
    told = "In a shared library the functions have their plain names; leave it undefined to link several FMUs into one program"
    ET.SubElement(files, "PreprocessorDefinition", name=OVERRIDE.format(fmi), optional="true", description=told)
    ET.SubElement(configuration, "Library", name="m", external="true", description="Mathematics of the C library")
    return to_text(root)


def terminals(variables: Sequence[Variable], arrays: bool) -> str:
    """terminalsAndIcons.xml: the variables of each sensor, bus or solution, and the place of the icon.

    Its format is that of FMI 3, which FMI 2.0.4 takes too.
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
    if groups:
        listed = ET.SubElement(root, "Terminals")
    for (name, kind), members in groups.items():
        causality = _CAUSALITY[kind][0]
        terminal = ET.SubElement(listed, "Terminal", name=name, matchingRule="bus", description=f"{name}, {causality}s")
        for v in members:
            for name in [v.name] if arrays else v.elements:
                kinds = {"variableName": name, "memberName": name, "variableKind": "signal"}
                ET.SubElement(terminal, "TerminalMemberVariable", kinds)
    return to_text(root)


def number(value: float) -> str:
    """The shortest decimal that reads back to the same double."""
    return repr(float(value))


def _bound(value: float) -> str:
    return number(value) if math.isfinite(value) else ""
