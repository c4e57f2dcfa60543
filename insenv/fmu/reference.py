"""Reference signals inside an FMU: inputs, the outputs of insenv's interpreter for them, and the files that hold both.

The folder is that of the FMI layered standard for reference files (FMI-LS-REF 1.0.0-rc.1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np

from insenv.core.runner import make_runner
from insenv.fmu.description import number, to_text
from insenv.fmu.reading import Array
from insenv.fmu.subject import Subject
from insenv.fmu.variables import SAMPLE_NUMBER, Kind, Variable
from insenv.scenario.chunks import bridge_lost, input_rows

FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"
STEPS = 300  # more than one second in every scenario, so that a fix arrives
EVERY = 10  # samples between two rows of the outputs


def reference_files(subject: Subject, variables: Sequence[Variable], arrays: bool) -> dict[str, str]:
    """The files by their path in the FMU: inputs, outputs, experiments.xml and the manifest."""
    step, has_inputs = subject.sample_interval, bool(subject.model.inputs.size)
    inputs, outputs = signals(subject)
    texts, roles = {}, {"experiments.xml": "experiment"}
    if has_inputs:
        roles["in.csv"] = "testcase"
        texts["in.csv"] = csv([k * step for k in range(STEPS)], variables, Kind.INPUT, inputs, arrays)
    roles["ref.csv"] = "result"
    texts["ref.csv"] = csv([k * step for k in range(0, STEPS + 1, EVERY)], variables, Kind.OUTPUT, outputs, arrays)
    texts["experiments.xml"] = _experiments(STEPS * step, step, has_inputs)
    texts["fmi-ls-manifest.xml"] = _manifest(roles)
    return {FOLDER + name: text for name, text in texts.items()}


def signals(subject: Subject) -> tuple[Array, Array]:
    """Inputs (STEPS, inputs.size), row k held over the k-th sample, and outputs (1 + STEPS / EVERY, outputs.size).

    The first row of the outputs belongs to the start.
    """
    model = subject.model
    if subject.kind != "estimator":
        inputs = np.tile(model.inputs.start_vector(), (STEPS, 1))
    else:
        plant = subject.plant
        outputs = make_runner(plant.model, plant.parameters, backend="interpreter").run(STEPS)
        columns = {name: np.array(column) for name, column in plant.model.outputs.unpack(outputs).items()}
        columns["dt"] = np.full(STEPS, subject.sample_interval)
        bridge_lost(columns)
        inputs = input_rows(model, columns, STEPS)
    runner = make_runner(model, subject.parameters, backend="interpreter")
    begin = runner.output()
    return inputs, np.vstack([begin, runner.run(STEPS, inputs, EVERY)])


def csv(times: Sequence[float], variables: Sequence[Variable], kind: Kind, values: Array, arrays: bool) -> str:
    """A table in the format of FMPy and of the FMI cross-checks.

    One column per element; with `arrays` one column per row, with its elements separated by blanks.  A flag is 0 or 1.
    `SAMPLE_NUMBER`, which is no row of the model, is the number of the row.
    """
    kinds = (kind, Kind.NONE) if kind is Kind.OUTPUT else (kind,)
    is_numbered = kind is Kind.INPUT and any(v.row is SAMPLE_NUMBER for v in variables)
    of_model = [v for v in variables if v.kind in kinds and v.row is not SAMPLE_NUMBER]
    listed = [v for v in of_model if v.kind is kind]
    first = min((v.place for v in of_model), default=0)
    names = [name for v in listed for name in ([v.name] if arrays else v.elements)] + [SAMPLE_NUMBER.name] * is_numbered
    lines = [",".join(f'"{name}"' for name in ["time", *names])]
    for place, (time, row) in enumerate(zip(times, values.tolist(), strict=True)):
        cells = [repr(float(time))]
        for v in listed:
            numbers = [str(int(x) if v.row.flag else x) for x in row[v.place - first : v.place - first + v.row.size]]
            cells += [" ".join(numbers)] if arrays else numbers
        lines.append(",".join(cells + [str(place)] * is_numbered))
    return "\n".join(lines) + "\n"


def _manifest(files: Mapping[str, str]) -> str:
    """fmi-ls-manifest.xml: the files and their roles."""
    space = "http://fmi-standard.org/fmi-ls-manifest"
    ElementTree.register_namespace("fmi-ls", space)
    root = ElementTree.Element(
        "fmiReferences",
        {
            f"{{{space}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{space}}}fmi-ls-version": "1.0.0-rc.1",
            f"{{{space}}}fmi-ls-description": "Layered Standard providing information on related files included in an FMU.",
        },
    )
    for source, role in files.items():
        kind = "text/csv" if source.endswith(".csv") else "text/xml"
        ElementTree.SubElement(root, "Related", type=kind, source=source, role=role)
    return to_text(root)


def _experiments(stop_time: float, step: float, has_inputs: bool) -> str:
    """experiments.xml: the inputs and the outputs that belong to them."""
    root = ElementTree.Element("Experiments")
    name, text = "reference", "Outputs of the model in insenv; the outputs of the FMU are bit-identical"
    times = {"startTime": "0", "stopTime": number(stop_time), "stepSize": number(step)}
    experiment = ElementTree.SubElement(root, "Experiment", {"name": name, "description": text, **times})
    if has_inputs:
        ElementTree.SubElement(experiment, "Stimuli", source="in.csv")
    ElementTree.SubElement(experiment, "References", source="ref.csv")
    return to_text(root)
