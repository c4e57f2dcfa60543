"""Export an estimator or a plant as an FMU: a zip archive with the same bytes for the same content.

Beside description, sources and binaries it holds reference signals and documentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from xml.etree import ElementTree
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, check_output_file
from insenv.base.resources import fmu_folder
from insenv.base.shipped import __version__
from insenv.core.portable import identifier
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.estimators import Estimator
from insenv.fmu import description
from insenv.fmu.description import number, to_text
from insenv.fmu.platforms import FLAGS, build, checked_platforms
from insenv.fmu.sources import TOKEN, amalgamated, sources, token
from insenv.fmu.subject import Subject, subject
from insenv.fmu.variables import SAMPLE_NUMBER, Kind, Variable, parts, quantity, variables
from insenv.scenario import ScenarioLike
from insenv.scenario.inputs import EVERY, SAMPLES, input_rows, sample_columns

_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest date that a zip can hold


def export_fmu(
    what: Estimator | ScenarioLike,
    output: str | Path,
    *,
    estimator: Estimator | str | None = None,
    fmi: int = 2,
    arrays: bool | None = None,
    platforms: Sequence[str] = ("host",),
    settings: Mapping[str, object] | None = None,
) -> Path:
    """Write the FMU of an estimator, of a scenario's plant, or of a plant with an estimator behind it.

    what: the id of an estimator or an `Estimator`; or a scenario: its name, the path of its .toml file, a `Scenario` or its
    values.  estimator: with a scenario, the estimator (or its id) of the plant's measurements; both are then one FMU, without
    delay between them.  fmi: 2 (scalars) or 3.  arrays: whether a vector is one variable, for FMI 3 alone; None: in FMI 3 yes.
    platforms: "host" (this machine's C compiler), "all", or names of
    `insenv.fmu.platforms.PLATFORMS` (built with ziglang).  settings: start values of parameters by row name, in SI units, or,
    for an estimator, by name and data-sheet unit as in a scenario (``arw_deg_sqrt_h``); for an estimator also
    ``sample_interval``, s, and ``step_is_one_increment``, 0 or 1.  Those of the estimator of a scenario begin with
    ``estimator.``.

    Returns the path.  Raises `InputError` for an unknown id, platform or setting, for a value that is not allowed and for a
    file that cannot be written; `InsenvError` if there is no compiler or it fails.
    """
    output = as_path("output", output)
    if fmi not in (2, 3) or not isinstance(fmi, int):
        raise InputError(f"fmi = {fmi!r}: allowed is 2 or 3")
    if settings is not None and not (isinstance(settings, Mapping) and all(isinstance(name, str) for name in settings)):
        raise InputError(f"settings = {settings!r}: allowed is a dict of values by name")
    if arrays and fmi == 2:
        raise InputError("arrays with FMI 2: allowed is FMI 3")
    arrays = fmi == 3 if arrays is None else arrays
    check_output_file(output, ".fmu")
    targets = checked_platforms([platforms] if isinstance(platforms, str) else platforms)
    exported = subject(what, settings or {}, estimator)
    listed = variables(exported)
    xml = description.model_description(exported, listed, fmi, arrays)
    code = sources(exported, listed, fmi, arrays)
    guid = token(xml, code, FLAGS)
    code = {name: text.replace(TOKEN, guid) for name, text in code.items()}
    libraries = build(amalgamated(code, fmi), exported.identifier, targets, fmi)
    licences, icon = sorted((fmu_folder() / "licenses").iterdir()), _icon(exported)
    texts = {
        "modelDescription.xml": xml.replace(TOKEN, guid),
        "documentation/index.html": page(exported, listed, fmi, libraries),
        "sources/buildDescription.xml": description.build_description(exported, fmi),
        # importers of FMI 2 read no terminals, and FMI Library logs those of the standard's own schema as errors
        **({"terminalsAndIcons/terminalsAndIcons.xml": description.terminals(listed, arrays)} if fmi == 3 else {}),
        **{f"sources/{name}": text for name, text in code.items()},
        **reference_files(exported, listed, arrays),
    }
    files = {
        **{name: text.encode() for name, text in texts.items()},
        **{f"documentation/licenses/{path.name}": path.read_bytes() for path in licences},
        "model.png" if fmi == 2 else "terminalsAndIcons/icon.png": icon,
        **libraries,
    }
    write_archive(output, files)
    return output


def _icon(subject: Subject) -> bytes:
    """The icon of an estimator, or of a plant's vehicle: by the first word of the scenario (`turntable`), else by its kind."""
    scenario = subject.plant.scenario
    names = (identifier(scenario.name).partition("_")[0], scenario.vehicle.kind, "plant")
    listed = (fmu_folder() / "icons" / f"{name}.png" for name in (["estimator"] if subject.kind == "estimator" else names))
    return next(path for path in listed if path.is_file()).read_bytes()


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write the zip of `files` by name, sorted, with a fixed date; it is renamed to `path` when complete."""
    with atomic(path) as stream, ZipFile(stream, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files, key=lambda n: (n != "modelDescription.xml", n)):
            entry = ZipInfo(name, _DATE)
            entry.compress_type = ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, files[name])


def summary(path: str | Path) -> dict[str, Any]:
    """Contents of an FMU written by `export`: model, fmi, token, sample_interval_s, variables by causality, binaries, bytes."""
    path = Path(path)
    with ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        binaries = sorted(name for name in archive.namelist() if name.startswith("binaries/"))
    listed = root.findall("ModelVariables/*")
    experiment = root.find("DefaultExperiment")
    return {
        "path": str(path),
        "model": root.get("modelName"),
        "fmi": root.get("fmiVersion"),
        "token": root.get("guid") or root.get("instantiationToken"),
        "sample_interval_s": float("nan" if experiment is None else experiment.get("stepSize", "nan")),
        "variables": {
            f"{causality}s": sum(v.get("causality") == causality for v in listed)
            for causality in ("parameter", "input", "output")
        },
        "binaries": binaries,
        "bytes": path.stat().st_size,
    }


# Reference signals inside an FMU: inputs, the outputs of insenv's interpreter for them, and the files that hold both.
#
# The folder is that of the FMI layered standard for reference files (FMI-LS-REF 1.0.0-rc.1).


FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"


def reference_files(subject: Subject, variables: Sequence[Variable], arrays: bool) -> dict[str, str]:
    """The files by their path in the FMU: inputs, outputs, experiments.xml and the manifest."""
    step, has_inputs = subject.sample_interval, bool(subject.model.inputs.size)
    inputs, outputs = signals(subject)
    texts, roles = {}, {"experiments.xml": "experiment"}
    if has_inputs:
        roles["in.csv"] = "testcase"
        texts["in.csv"] = csv([k * step for k in range(SAMPLES)], variables, Kind.INPUT, inputs, arrays)
    roles["ref.csv"] = "result"
    texts["ref.csv"] = csv([k * step for k in range(0, SAMPLES + 1, EVERY)], variables, Kind.OUTPUT, outputs, arrays)
    texts["experiments.xml"] = _experiments(SAMPLES * step, step, has_inputs)
    texts["fmi-ls-manifest.xml"] = _manifest(roles)
    return {FOLDER + name: text for name, text in texts.items()}


def signals(subject: Subject) -> tuple[Array, Array]:
    """Inputs (SAMPLES, inputs.size), row k held over the k-th sample, and outputs (1 + SAMPLES / EVERY, outputs.size).

    The first row of the outputs belongs to the start.
    """
    model = subject.model
    if subject.kind != "estimator":
        inputs = np.tile(model.inputs.start_vector(), (SAMPLES, 1))
    else:
        plant = subject.plant
        outputs = make_runner(plant.model, plant.parameters, backend="interpreter").run(SAMPLES)
        inputs = input_rows(model, sample_columns(plant.model, outputs, subject.sample_interval)[0], SAMPLES)
    runner = make_runner(model, subject.parameters, backend="interpreter")
    begin = runner.output()
    return inputs, np.vstack([begin, runner.run(SAMPLES, inputs, EVERY)])


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


# documentation/index.html of an FMU: title, rules of stepping, and every variable; the template is fmu/index.html.


_HEADINGS = {
    Kind.PARAMETER: "Parameters",
    Kind.INPUT: "Inputs",
    Kind.OUTPUT: "Outputs",
    Kind.CONSTANT: "Constants",
}
_COLUMNS = ("Name", "Unit", "Shown in", "Start", "Bounds", "Meaning")
_ONE_SAMPLE, _SAMPLES = "A communication step is one sample.", "A communication step is a whole number of samples."
_COMMANDS = (
    "<p>The vehicle follows the scenario's script until <code>command_valid</code> is true; from then on it follows the inputs "
    "<code>command_...</code>. While <code>command_valid</code> is false they are not used.</p>\n"
)
_PLANT = (
    "<p>Each sample moves the vehicle; its outputs are the measurements of the inertial unit over the sample, the GNSS "
    "fix at its end, if any, and the truth at its end. After a step of several samples the outputs are those of the "
    "last. Every random number is a function of <code>parameters.seed</code> and the number of the sample, and the "
    "same on every machine.</p>"
)
_ESTIMATOR = (
    "<p><code>delta_angle</code> and <code>delta_velocity</code> are the increments over the sample that begins at the "
    "communication point: row k of a log is set at the time at which its sample begins. <code>dt</code> is the measured "
    "length of the sample, half to twice the step and on average the step within a tenth; its start value is the sample "
    "interval. <code>sample_number</code>, 0, 1, 2, ... by row of the log, lets each step check that the importer neither "
    "repeats, omits nor interpolates samples: connect it whenever the rows of a file are the inputs.</p>\n"
    "<p>With <code>parameters.step_is_one_increment</code> a step of any length is one sample: the inputs are the "
    "increments over the whole step, and <code>dt</code> becomes its length.</p>"
)


def page(subject: Subject, variables: Sequence[Variable], fmi: int, libraries: Iterable[str]) -> str:
    """The page as one self-contained HTML document; libraries: paths in the FMU."""
    by_kind = {kind: [v for v in variables if v.kind is kind] for kind in _HEADINGS}
    estimates, commands = subject.kind == "estimator", _COMMANDS if by_kind[Kind.INPUT] else ""
    tables = [f"<h2>{heading}</h2>\n{_table(by_kind[kind])}" for kind, heading in _HEADINGS.items() if by_kind[kind]]
    return Template((fmu_folder() / "index.html").read_text(encoding="utf-8")).substitute(
        id=escape(subject.id),
        title=escape(subject.title[:1].upper() + subject.title[1:]),
        fmi=fmi,
        version=__version__,
        sample_interval=repr(subject.sample_interval),
        length=_ONE_SAMPLE if estimates else _SAMPLES,
        further=_ESTIMATOR if estimates else commands + _PLANT,
        values_from=escape(subject.values_from),
        tables="\n".join(tables),
        binaries=", ".join(f"<code>{escape(name)}</code>" for name in sorted(libraries)),
    )


def _table(variables: Sequence[Variable]) -> str:
    lines = ["<table>", f"<tr>{''.join(f'<th>{name}</th>' for name in _COLUMNS)}</tr>"]
    for v in variables:
        units, shape = parts(v.row), " x ".join(map(str, v.row.shape))
        cells = (
            f"<code>{escape(v.name)}</code>{f'[{shape}]' if shape else ''}",
            "Boolean" if v.row.flag else escape(", ".join(units)),
            escape(", ".join(dict.fromkeys(filter(None, (quantity(v.row, unit).display for unit in units))))),
            _start(v),
            f"{v.row.lower:g} to {v.row.upper:g}" if np.isfinite([v.row.lower, v.row.upper]).all() else "",
            escape(v.description),
        )
        lines.append(f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    return "\n".join([*lines, "</table>"])


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    values = variable.start
    if values.size > 1 and (values == values[0]).all():
        values = values[:1]
    return " ".join(f"{value:.6g}" for value in values[:8]) + (" ..." if values.size > 8 else "")
