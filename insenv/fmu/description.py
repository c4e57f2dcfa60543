"""modelDescription.xml, buildDescription.xml and terminalsAndIcons.xml of an FMU, from its variables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np

import insenv
from insenv.core.tables import Vector
from insenv.fmu import units
from insenv.fmu.dependencies import start_dependencies
from insenv.fmu.sources import TOKEN, main_source
from insenv.fmu.subject import Subject
from insenv.fmu.units import Quantity
from insenv.fmu.variables import Kind, Variable

_CAUSALITY = {
    Kind.TIME: ("independent", "continuous", None),
    Kind.CONSTANT: ("local", "constant", "exact"),
    Kind.PARAMETER: ("parameter", "fixed", "exact"),
    Kind.INPUT: ("input", "continuous", None),
    Kind.OUTPUT: ("output", "discrete", "calculated"),
}
"""Causality, variability and initial.  Inputs are sampled too, but importers are slow on inputs that say so."""

TERMINALS = {
    "imu": ("delta_angle", "delta_velocity", "dt", "imu_valid"),
    "gnss": ("gnss_",),
    "command": ("command_",),
    "truth": ("true_", "gyro_bias_true", "accel_bias_true"),
    "navigation": ("q_nb", "velocity_n", "latitude", "longitude", "height"),
}
"""Variables that belong together, by the beginnings of their names; the first that fits."""


@dataclass(frozen=True)
class Item:
    """An entry of the model description: a whole row in FMI 3, an element of one in FMI 2."""

    variable: Variable
    name: str
    reference: int
    description: str
    quantity: Quantity | None
    start: Vector | None
    places: range  # of its elements, in the row


def items(variables: Sequence[Variable], fmi: int) -> list[Item]:
    """The entries, in order."""
    found = []
    for v in variables:
        if v.kind is Kind.NONE:
            continue
        kinds = units.parts(v.row)
        if fmi == 3:
            quantity = units.quantity(v.row, kinds[0]) if len(kinds) == 1 else None
            text = v.description + (f" [{v.row.unit}]" if len(kinds) > 1 else "")
            found.append(Item(v, v.name, v.number, text, quantity, v.start, range(v.row.size)))
            continue
        for e, name in enumerate(v.elements):
            quantity = units.quantity(v.row, kinds[e * len(kinds) // v.row.size]) if kinds else None
            start = None if v.start is None else v.start[e : e + 1]
            found.append(Item(v, name, v.place + e, v.element_description(e), quantity, start, range(e, e + 1)))
    return found


def model_description(subject: Subject, variables: Sequence[Variable], fmi: int) -> str:
    """modelDescription.xml, with `TOKEN` where the token goes."""
    entries = items(variables, fmi)
    root = ET.Element("fmiModelDescription", _head(subject, fmi))
    _interface(root, subject, fmi)
    _units(root, entries)
    _types(root, entries, fmi)
    _log_categories(root, fmi)
    step = _number(subject.sample_interval)
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=_number(subject.stop_time), stepSize=step)
    listed = ET.SubElement(root, "ModelVariables")
    for entry in entries:
        _variable(listed, entry, fmi)
    _structure(root, subject, variables, entries, fmi)
    return to_text(root)


def to_text(root: ET.Element) -> str:
    """The document, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _head(subject: Subject, fmi: int) -> dict[str, str]:
    return {
        "fmiVersion": f"{fmi}.0",
        "modelName": subject.id,
        "guid" if fmi == 2 else "instantiationToken": TOKEN,
        "description": subject.title,
        "author": "The insenv authors",
        "version": insenv.__version__,
        "copyright": "The insenv authors; FMI headers: Modelica Association",
        "license": "Apache-2.0; FMI headers: BSD-2-Clause",
        "generationTool": f"insenv {insenv.__version__}",
        "variableNamingConvention": "structured",
    }


def _interface(root: ET.Element, subject: Subject, fmi: int) -> None:
    # a step may be any whole number of samples, but not any length
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
        "fixedInternalStepSize": _number(subject.sample_interval),
        "hasEventMode": "false",
    }
    ET.SubElement(root, "CoSimulation", {**same, **own})


def _units(root: ET.Element, entries: Sequence[Item]) -> None:
    used = {entry.quantity.unit for entry in entries if entry.quantity}
    definitions = ET.SubElement(root, "UnitDefinitions")
    for name in [*(n for n in units.UNITS if n in used), *sorted(used - set(units.UNITS))]:
        unit = units.UNITS.get(name, units.Unit(name, None))
        element = ET.SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            ET.SubElement(element, "BaseUnit", {base: str(power) for base, power in unit.exponents.items()})
        for shown in unit.displays:
            offset = {"offset": _number(shown.offset)} if shown.offset else {}
            ET.SubElement(element, "DisplayUnit", {"name": shown.name, "factor": _number(shown.factor), **offset})


def _types(root: ET.Element, entries: Sequence[Item], fmi: int) -> None:
    """A declared type for each quantity, with the widest bounds of its variables."""
    bounds: dict[Quantity, list[tuple[float, float]]] = {}
    for entry in entries:
        if entry.quantity:
            bounds.setdefault(entry.quantity, []).append((entry.variable.row.lower, entry.variable.row.upper))
    definitions = ET.SubElement(root, "TypeDefinitions")
    for quantity in sorted(bounds, key=lambda q: q.name):
        values = {
            "quantity": quantity.quantity,
            "unit": quantity.unit,
            "displayUnit": quantity.display,
            "min": _bound(min(lower for lower, _ in bounds[quantity])),
            "max": _bound(max(upper for _, upper in bounds[quantity])),
            "nominal": _number(quantity.nominal),
        }
        values = {name: value for name, value in values.items() if value}
        if fmi == 2:
            ET.SubElement(ET.SubElement(definitions, "SimpleType", name=quantity.name), "Real", values)
        else:
            ET.SubElement(definitions, "Float64Type", {"name": quantity.name, **values})


def _log_categories(root: ET.Element, fmi: int) -> None:
    listed = ET.SubElement(root, "LogCategories")
    categories = {
        "logStatusError": "Why a call was refused; always logged",
        "logEvents": "Changes of state: instantiated, initialization mode, step mode, terminated, reset",
    }
    if fmi == 2:
        categories["logAll"] = "All messages"
    for name, description in categories.items():
        ET.SubElement(listed, "Category", name=name, description=description)


def _variable(listed: ET.Element, entry: Item, fmi: int) -> None:
    row = entry.variable.row
    causality, variability, initial = _CAUSALITY[entry.variable.kind]
    names = {"name": entry.name, "valueReference": str(entry.reference), "description": entry.description,
             "causality": causality, "variability": variability}  # fmt: skip
    if initial:
        names["initial"] = initial
    values = {} if entry.quantity is None else {"declaredType": entry.quantity.name}
    values |= {name: bound for name, bound in (("min", _bound(row.lower)), ("max", _bound(row.upper))) if bound}
    if entry.start is not None:
        values["start"] = " ".join(_number(value) for value in entry.start)
    if fmi == 2:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", names), "Real", values)
        return
    element = ET.SubElement(listed, "Float64", {**names, **values})
    for length in row.shape:
        ET.SubElement(element, "Dimension", start=str(length))


def _structure(root: ET.Element, subject: Subject, variables: Sequence[Variable], entries: Sequence[Item], fmi: int) -> None:
    """Outputs depend on no input at the same communication point: what is set acts in the step that follows.  At the start
    they depend on parameters, exactly as the equations say.
    """
    structure = ET.SubElement(root, "ModelStructure")
    needs = start_dependencies(subject.model)
    # what a dependency is called: the number of the entry, from 1, in FMI 2; the value reference in FMI 3
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


def build_description(subject: Subject, fmi: int) -> str:
    """sources/buildDescription.xml: how the sources are compiled (its format is FMI 3's, which FMI 2 importers read too)."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(
        root, "BuildConfiguration", modelIdentifier=subject.identifier, description="C99 and libm, nothing else"
    )
    files = ET.SubElement(configuration, "SourceFileSet", language="C99")
    ET.SubElement(files, "SourceFile", name=main_source(fmi))
    ET.SubElement(configuration, "Library", name="m", external="true", description="The C library's mathematics")
    return to_text(root)


def terminals(variables: Sequence[Variable]) -> str:
    """terminalsAndIcons.xml of FMI 3: the variables that one sensor, bus or solution makes up; the icon's place."""
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
            kinds = {"variableName": v.name, "memberName": v.name, "variableKind": "signal"}
            ET.SubElement(terminal, "TerminalMemberVariable", kinds)
    return to_text(root)


def references(files: Mapping[str, str]) -> str:
    """fmi-ls-manifest.xml of the layered standard for reference signals: the files and their roles."""
    space = "http://fmi-standard.org/fmi-ls-manifest"
    ET.register_namespace("fmi-ls", space)
    root = ET.Element(
        "fmiReferences",
        {
            f"{{{space}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{space}}}fmi-ls-version": "1.0.0-rc.1",
            f"{{{space}}}fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
        },
    )
    for source, role in files.items():
        kind = "text/csv" if source.endswith(".csv") else "text/xml"
        ET.SubElement(root, "Related", type=kind, source=source, role=role)
    return to_text(root)


def experiments(stop_time: float, step: float, has_inputs: bool) -> str:
    """experiments.xml beside it: the inputs and what comes of them."""
    root = ET.Element("Experiments")
    name, text = "reference", "Outputs of the model in insenv; those of the FMU are the same to the bit"
    times = {"startTime": "0", "stopTime": _number(stop_time), "stepSize": _number(step)}
    experiment = ET.SubElement(root, "Experiment", {"name": name, "description": text, **times})
    if has_inputs:
        ET.SubElement(experiment, "Stimuli", source="in.csv")
    ET.SubElement(experiment, "References", source="ref.csv")
    return to_text(root)


def _number(value: float) -> str:
    return repr(float(value))


def _bound(value: float) -> str:
    return _number(value) if math.isfinite(value) else ""
