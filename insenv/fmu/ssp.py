"""Export a scenario's plant and an estimator, connected, as one SSP file (System Structure and Parameterization 1.0).

The archive holds two FMUs for Co-Simulation, a parameter set (SSV) of each with the start values of its parameters, and
SystemStructure.ssd, which connects each input of the estimator to the plant's output of the same name.  The estimator starts
from the scenario's initial conditions and tuning, as in `insenv.runs.simulated`.

A master steps both components from t to t + h and then passes the plant's outputs on.  Each step of the estimator therefore
uses the samples of the step before: its estimate at t + h is the attitude at t.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from insenv.base.errors import InputError
from insenv.base.output import as_path, check_output_file
from insenv.core.portable import identifier
from insenv.estimators import Estimator, get
from insenv.fmu.description import to_text
from insenv.fmu.exporter import export_fmu, write_archive
from insenv.fmu.reading import unit_of
from insenv.scenario import ScenarioLike, build, load

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
for _prefix, _space in (("ssd", SSD), ("ssc", SSC), ("ssv", SSV), ("oms", OMS), ("osp", OSP)):
    ElementTree.register_namespace(_prefix, _space)
COMPONENTS = "Components.ssd"
"""The same system without connectors of its own: libcosim takes connections between components only."""
PLANT, ESTIMATOR = "plant", "estimator"
_SSD = f"{{{SSD}}}"
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_LIKE = {"Float64": "Real", "Real": "Real", "Integer": "Integer", "Boolean": "Boolean", "Enumeration": "Integer"}


def export_ssp(
    scenario: ScenarioLike,
    estimator: str | Estimator,
    output: str | Path,
    *,
    seed: int | None = None,
    fmi: int = 2,
    platforms: Sequence[str] = ("host",),
) -> dict[str, Any]:
    """Write the SSP file of a scenario's plant and an estimator; return step_s, stop_time_s and the number of connections.

    scenario: a name, a path, a Scenario or its values.  estimator: an id or an Estimator.  seed: replaces the scenario's.
    fmi: version of the two FMUs, 2 or 3; those of FMI 3 have scalars, because SSP 1.0 has no arrays.  platforms: as in
    `insenv.export_fmu`.  Raises `InputError` for an unknown name, for an estimator that the scenario does not suit and for a
    file that cannot be written.
    """
    from fmpy import read_model_description

    output, estimator = as_path("output", output), get(estimator)
    check_output_file(output, ".ssp")
    loaded = load(scenario)
    plant = build(loaded, seed=seed)
    if plant.parameters.get("imu_drop_probability", 0.0) > 0.0:
        raise InputError(f"scenario {loaded.name!r} loses inertial samples: an estimator's FMU has no input for a lost sample")
    estimator = plant.adapted(estimator, offline=False)
    started = plant.parameters_of(estimator, offline=False)
    started["sample_interval"] = plant.sample_interval
    with tempfile.TemporaryDirectory(prefix="insenv-ssp-") as name:
        parts = {PLANT: Path(name) / "plant.fmu", ESTIMATOR: Path(name) / "estimator.fmu"}
        settings: dict[str, Mapping[str, object]] = {PLANT: {"seed": float(plant.seed)}, ESTIMATOR: started}
        for role, subject in ((PLANT, loaded), (ESTIMATOR, estimator)):
            export_fmu(subject, parts[role], fmi=fmi, arrays=False, platforms=platforms, settings=settings[role])
        read = {role: read_model_description(str(part)) for role, part in parts.items()}
        estimates = [v for v in read[ESTIMATOR].modelVariables if v.causality == "output"]
        ssd, inner = (
            structure(loaded.name, read[PLANT], read[ESTIMATOR], plant.duration_s, outputs) for outputs in (estimates, ())
        )
        files = {"SystemStructure.ssd": ssd, COMPONENTS: inner}
        files |= {f"resources/{role}.ssv": parameter_set(role, description) for role, description in read.items()}
        files |= {f"resources/{part.name}": part.read_bytes() for part in parts.values()}
    write_archive(output, files)
    ends = [connection.get("endElement") for connection in ElementTree.fromstring(ssd).iter(f"{{{SSD}}}Connection")]
    return {"step_s": plant.sample_interval, "stop_time_s": plant.duration_s, "connections": ends.count(ESTIMATOR)}


def structure(title: str, plant: Any, estimator: Any, stop_time: float, exported: Sequence[Any]) -> bytes:
    """SystemStructure.ssd of two components; plant, estimator: their model descriptions as FMPy reads them.

    stop_time: s.  exported: the outputs of the estimator that are outputs of the system.  Raises `InputError` if no output of
    the plant has the name of an input of the estimator, or if their units differ.
    """
    outputs = {v.name: v for v in plant.modelVariables if v.causality == "output"}
    joined = [v for v in estimator.modelVariables if v.causality == "input" and v.name in outputs]
    if not joined:
        raise InputError(f"{estimator.modelName}: none of its inputs is an output of {plant.modelName}")
    for variable in joined:
        units = unit_of(outputs[variable.name]), unit_of(variable)
        if len(set(units)) > 1:
            raise InputError(f"{variable.name}: {units[0]} in the plant, {units[1]} in the estimator")

    root = ElementTree.Element(
        _SSD + "SystemStructureDescription", version="1.0", name=identifier(title), generationTool="insenv"
    )
    system = _add(root, "System", name="loop", description=f"{plant.modelName}; {estimator.modelName}")
    estimates = [v for v in estimator.modelVariables if v.causality == "output"]
    defined = _defined(plant, estimator)
    names = {v.name: _system_name(v.name) for v in exported}
    if exported:
        _connectors(system, exported, defined, names)
    elements = _add(system, "Elements")
    # an unconnected input gets no connector, because masters set every input that has one
    _component(elements, PLANT, plant, list(outputs.values()), left=0.0)
    _component(elements, ESTIMATOR, estimator, [*joined, *estimates], left=400.0)
    connections = _add(system, "Connections")
    for variable in joined:
        ends = {"startElement": PLANT, "startConnector": variable.name, "endElement": ESTIMATOR}
        _add(connections, "Connection", **ends, endConnector=variable.name)
    for name, connector in names.items():
        _add(connections, "Connection", startElement=ESTIMATOR, startConnector=name, endConnector=connector)
    step = repr(float(plant.defaultExperiment.stepSize))
    openmodelica = _annotation(system, "org.openmodelica", f"{{{OMS}}}Annotations")
    information = ElementTree.SubElement(openmodelica, f"{{{OMS}}}SimulationInformation")
    tolerances = {"absoluteTolerance": "0.0001", "relativeTolerance": "0.0001"}
    ElementTree.SubElement(information, f"{{{OMS}}}FixedStepMaster", {"description": "oms-ma", "stepSize": step, **tolerances})
    _units(root, SSD, [*outputs.values(), *estimates], defined)
    experiment = _add(root, "DefaultExperiment", startTime="0", stopTime=repr(float(stop_time)))
    algorithm = _annotation(experiment, "com.opensimulationplatform", f"{{{OSP}}}Algorithm")
    ElementTree.SubElement(algorithm, f"{{{OSP}}}FixedStepAlgorithm", baseStepSize=step)
    return to_text(root).encode()


def parameter_set(name: str, description: Any) -> bytes:
    """The SSV file of a component: its parameters with the start values of its FMU, as FMPy reads its description."""
    defined = _defined(description)
    root = ElementTree.Element(f"{{{SSV}}}ParameterSet", version="1.0", name=name, generationTool="insenv")
    listed = ElementTree.SubElement(root, f"{{{SSV}}}Parameters")
    parameters = [v for v in description.modelVariables if v.causality == "parameter"]
    for variable in parameters:
        parameter = ElementTree.SubElement(listed, f"{{{SSV}}}Parameter", name=variable.name)
        _typed(parameter, SSV, variable, defined, value=variable.start)
    _units(root, SSV, parameters, defined)
    return to_text(root).encode()


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    """A new element of a system structure description."""
    return ElementTree.SubElement(parent, _SSD + tag, attributes)


def _component(elements: ElementTree.Element, name: str, description: Any, variables: Sequence[Any], left: float) -> None:
    component = _add(
        elements,
        "Component",
        name=name,
        description=description.description or description.modelName,
        type="application/x-fmu-sharedlibrary",
        source=f"resources/{name}.fmu",
        implementation="CoSimulation",
    )
    _connectors(component, variables, _defined(description))
    _add(component, "ElementGeometry", x1=repr(left), y1="0.0", x2=repr(left + 200.0), y2="200.0")
    bindings = _add(component, "ParameterBindings")
    _add(bindings, "ParameterBinding", type="application/x-ssp-parameter-set", source=f"resources/{name}.ssv")


def _system_name(variable: str) -> str:
    """Name of the system's connector: OMSimulator takes identifiers only, and refuses `q_nb[1]` there."""
    return re.sub(r"\W+", "_", variable).strip("_")


def _connectors(
    element: ElementTree.Element, variables: Sequence[Any], defined: Mapping[str, Any], names: Mapping[str, str] | None = None
) -> None:
    """Connectors of the variables, by their own names or by `names`."""
    connectors = _add(element, "Connectors")
    for variable in variables:
        name = variable.name if names is None else names[variable.name]
        connector = _add(connectors, "Connector", name=name, kind=variable.causality)
        _typed(connector, SSC, variable, defined)


def _annotation(element: ElementTree.Element, kind: str, tag: str) -> ElementTree.Element:
    """A new annotation of another tool (it gives the step of its master), as the last child of `element`."""
    annotation = ElementTree.SubElement(_add(element, "Annotations"), f"{{{SSC}}}Annotation", type=kind)
    return ElementTree.SubElement(annotation, tag)


def _units(root: ElementTree.Element, space: str, variables: Sequence[Any], defined: Mapping[str, Mapping[str, str]]) -> None:
    """The units in use; space: namespace of the list.  defined: see `_defined`."""
    used = [name for name in dict.fromkeys(map(unit_of, variables)) if name in defined]
    if not used:
        return
    units = ElementTree.SubElement(root, f"{{{space}}}Units")
    for name in used:
        unit = ElementTree.SubElement(units, f"{{{SSC}}}Unit", name=name)
        ElementTree.SubElement(unit, f"{{{SSC}}}BaseUnit", dict(defined[name]))


def _defined(*descriptions: Any) -> dict[str, dict[str, str]]:
    """The exponents of the units that SSP can express: whole powers, which leaves out `rad/s^0.5`."""
    definitions = [unit for description in descriptions for unit in description.unitDefinitions if unit.baseUnit is not None]
    return {u.name: {si: str(getattr(u.baseUnit, si)) for si in _BASE if getattr(u.baseUnit, si)} for u in definitions}


def _typed(element: ElementTree.Element, space: str, variable: Any, defined: Mapping[str, Any], **values: str) -> None:
    """The type of a variable, with its unit, as a child of `element`."""
    kind, unit = _LIKE[variable.type], unit_of(variable)
    if kind == "Real" and unit in defined:
        values["unit"] = unit
    ElementTree.SubElement(element, f"{{{space}}}{kind}", values)
