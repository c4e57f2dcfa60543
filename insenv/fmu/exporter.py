"""Export an estimator or a plant as an FMU: a zip archive with the same bytes for the same content."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, check_output_file
from insenv.base.resources import fmu_folder
from insenv.base.version import __version__
from insenv.core.runner import make_runner
from insenv.estimators import Estimator
from insenv.fmu import description
from insenv.fmu.description import number, to_text
from insenv.fmu.platforms import FLAGS, build, chosen
from insenv.fmu.sources import TOKEN, amalgamated, sources, token
from insenv.fmu.subject import Subject, identifier, subject
from insenv.fmu.variables import Kind, Variable, quantity, variables
from insenv.fmu.variables import parts as units_parts
from insenv.scenario import ScenarioLike
from insenv.scenario.chunks import bridge_lost, input_rows

# documentation/index.html of an FMU: title, rules of stepping, and every variable.

_HEADINGS = {
    Kind.PARAMETER: "Parameters",
    Kind.INPUT: "Inputs",
    Kind.OUTPUT: "Outputs",
    Kind.CONSTANT: "Constants",
}
_LENGTH = {
    "estimator": "A communication step is one sample.",
    "plant": "A communication step is a whole number of samples.",
    "loop": "A communication step is a whole number of samples.",
}
_COMMANDS = (
    "<p>The vehicle follows the scenario's script until <code>command_valid</code> is true; from then on it follows the inputs "
    "<code>command_...</code>. While <code>command_valid</code> is false they are not used.</p>"
)
_STYLE = """
body { font: 15px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; width: 100%; font-size: 13px; }
th, td { text-align: left; vertical-align: top; padding: .2em .6em .2em 0; border-bottom: 1px solid #ddd; }
code { font-size: 95%; }
"""


def page(subject: Subject, variables: Sequence[Variable], fmi: int, libraries: Mapping[str, bytes]) -> str:
    """The page as one self-contained HTML document."""
    parts = [
        f"<h1>{escape(subject.id)}</h1>",
        f"<p>{escape(subject.title[:1].upper() + subject.title[1:])}.</p>",
        f"<p>FMI {fmi}.0 for Co-Simulation, exported by insenv {__version__}. The equations are C code generated from "
        "the same model that insenv runs; the results are bit-identical. The C library is the only requirement.</p>",
        "<h2>Steps</h2>",
        f"<p>The sample interval is {subject.sample_interval!r} s, fixed at export. {_LENGTH[subject.kind]} Any other step is "
        "refused with a message and the state does not change; a step shorter than a millionth of a sample counts as done. "
        "Inputs are held over a step.</p>",
        *_further(subject, variables),
        "<p>A value that is not finite and a parameter outside its bounds are refused when they are set. An input outside its "
        "bounds is refused by the step. An input that a flag switches off (<code>gnss_...</code> while <code>gnss_valid</code> "
        "is false) may have any value, NaN too. The whole state can be saved, restored and serialized: a run that is continued "
        "from a saved state is bit-identical to an uninterrupted run.</p>",
        f"<p>{escape(subject.values_from)}</p>",
        "<p>Frames: n is north, east, down at the vehicle; b is forward, right, down, the axes of the inertial unit; e is "
        "Earth-fixed (WGS-84); w is wander azimuth. Quaternions are Hamilton quaternions, scalar first: <code>q_nb</code> "
        "transforms components in b to components in n.</p>",
    ]
    for kind, heading in _HEADINGS.items():
        rows = [v for v in variables if v.kind is kind]
        if rows:
            parts += [f"<h2>{heading}</h2>", _table(rows)]
    names = ", ".join(f"<code>{escape(name)}</code>" for name in sorted(libraries))
    parts += [
        "<h2>Files</h2>",
        f"<p>Binaries: {names}. The sources are in <code>sources/</code>, C99 without dependencies; <code>fmpy compile</code> "
        "builds them for the machine that it runs on. Reference inputs and outputs are in "
        "<code>extra/org.fmi-standard.fmi-ls-ref/</code>. Licences are in <code>documentation/licenses/</code>.</p>",
    ]
    body = "\n".join(parts)
    head = f'<meta charset="utf-8">\n<title>{escape(subject.id)}</title>\n<style>{_STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def _further(subject: Subject, variables: Sequence[Variable]) -> list[str]:
    """Paragraphs that hold for a plant, or for an estimator with these inputs."""
    if subject.kind != "estimator":
        commands = [v for v in variables if v.kind is Kind.INPUT]
        return [
            *([_COMMANDS] if commands else []),
            "<p>Each sample moves the vehicle; its outputs are the measurements of the inertial unit over the sample, the GNSS "
            "fix at its end, if any, and the truth at its end. After a step of several samples the outputs are those of the "
            "last. Every random number is a function of <code>parameters.seed</code> and the number of the sample, and the "
            "same on every machine.</p>",
        ]
    return [
        "<p><code>delta_angle</code> and <code>delta_velocity</code> are the increments over the sample that begins at the "
        "communication point: row k of a log is set at the time at which its sample begins. <code>dt</code> is the measured "
        "length of the sample, half to twice the step; its start value is the sample interval.</p>",
        "<p>With <code>parameters.step_is_one_increment</code> a step of any length is one sample: the inputs are the "
        "increments over the whole step, and <code>dt</code> becomes its length.</p>",
    ]


def _table(rows: Sequence[Variable]) -> str:
    lines = ["<table>", "<tr><th>Name</th><th>Unit</th><th>Shown in</th><th>Start</th><th>Bounds</th><th>Meaning</th></tr>"]
    for v in rows:
        shape = f"[{' x '.join(map(str, v.row.shape))}]" if v.row.shape else ""
        kinds = ", ".join(units_parts(v.row))
        bounds = f"{v.row.lower:g} to {v.row.upper:g}" if np.isfinite([v.row.lower, v.row.upper]).all() else ""
        kinds = "Boolean" if v.row.flag else kinds
        shown = ", ".join(dict.fromkeys(filter(None, (quantity(v.row, unit).display for unit in units_parts(v.row)))))
        cells = [
            f"<code>{escape(v.name)}</code>{shape}",
            escape(kinds),
            escape(shown),
            _start(v),
            bounds,
            escape(v.description),
        ]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "\n".join([*lines, "</table>"])


def _start(variable: Variable) -> str:
    if variable.start is None:
        return ""
    values = variable.start
    if values.size > 1 and (values == values[0]).all():
        values = values[:1]
    return " ".join(f"{value:.6g}" for value in values[:8]) + (" ..." if values.size > 8 else "")


# Reference signals inside an FMU: inputs, the outputs of insenv's interpreter for them, and the files that hold both.
#
# The folder is that of the FMI layered standard for reference files (FMI-LS-REF 1.0.0-rc.1).

Array = NDArray[np.float64]
FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"
STEPS = 300  # more than one second in every scenario, so that a fix arrives
EVERY = 10  # samples between two rows of the outputs


def reference_files(subject: Subject, variables: Sequence[Variable], arrays: bool) -> dict[str, bytes]:
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
    return {FOLDER + name: text.encode() for name, text in texts.items()}


def signals(subject: Subject) -> tuple[Array, Array]:
    """Inputs (STEPS, inputs.size), row k held over the k-th sample, and outputs (1 + STEPS / EVERY, outputs.size).

    The first row of the outputs belongs to the start.
    """
    model = subject.model
    if subject.kind != "estimator":
        inputs = np.tile(model.inputs.start_vector(), (STEPS, 1))
    else:
        plant = subject.plant
        shown = make_runner(plant.model, plant.parameters, backend="interpreter").run(STEPS)
        columns = {name: np.array(column) for name, column in plant.model.outputs.unpack(shown).items()}
        columns["dt"] = np.full(STEPS, subject.sample_interval)
        bridge_lost(columns)
        inputs = input_rows(model, columns, STEPS)
    runner = make_runner(model, subject.parameters, backend="interpreter")
    begin = runner.output()
    return inputs, np.vstack([begin, runner.run(STEPS, inputs, EVERY)])


def csv(times: Sequence[float], variables: Sequence[Variable], kind: Kind, values: Array, arrays: bool) -> str:
    """A table in the format of FMPy and of the FMI cross-checks.

    One column per element; with `arrays` one column per row, with its elements separated by blanks.  A flag is 0 or 1.
    """
    shown = [v for v in variables if v.kind is kind]
    first = min((v.place for v in variables if v.kind is kind or (kind is Kind.OUTPUT and v.kind is Kind.NONE)), default=0)
    names = [name for v in shown for name in ([v.name] if arrays else v.elements)]
    lines = [",".join(f'"{name}"' for name in ["time", *names])]
    for time, row in zip(times, values, strict=True):
        cells = [repr(float(time))]
        for v in shown:
            numbers = [
                str(int(x)) if v.row.flag else repr(float(x)) for x in row[v.place - first : v.place - first + v.row.size]
            ]
            cells += [" ".join(numbers)] if arrays else numbers
        lines.append(",".join(cells))
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
    targets = chosen([platforms] if isinstance(platforms, str) else platforms)
    exported = subject(what, settings or {}, estimator)
    listed = variables(exported)
    xml = description.model_description(exported, listed, fmi, arrays)
    code = sources(exported, listed, fmi, arrays)
    guid = token(xml, code, FLAGS)
    code = {name: text.replace(TOKEN, guid) for name, text in code.items()}
    libraries = build(amalgamated(code, fmi), exported.identifier, targets, fmi)
    files = {
        **_documents(exported, listed, fmi, arrays, libraries),
        "modelDescription.xml": xml.replace(TOKEN, guid).encode(),
        "sources/buildDescription.xml": description.build_description(exported, fmi).encode(),
        **{f"sources/{name}": text.encode() for name, text in code.items()},
        **libraries,
    }
    write_archive(output, files)
    return output


def _documents(
    subject: Subject, listed: Sequence[Variable], fmi: int, arrays: bool, libraries: Mapping[str, bytes]
) -> dict[str, bytes]:
    """The files beside description, sources and libraries: documentation, licences, icon, reference signals."""
    folder = fmu_folder()
    icon = _icon(subject)
    files = {"documentation/index.html": page(subject, listed, fmi, libraries).encode()}
    for licence in sorted((folder / "licenses").iterdir()):
        files[f"documentation/licenses/{licence.name}"] = licence.read_bytes()
    if fmi == 2:
        files["model.png"] = icon
    files["terminalsAndIcons/terminalsAndIcons.xml"] = description.terminals(listed, arrays).encode()
    files["terminalsAndIcons/icon.png"] = icon
    return files | reference_files(subject, listed, arrays)


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
