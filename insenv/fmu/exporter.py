"""`export`: an estimator or a plant as an FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

from insenv.errors import InputError
from insenv.files.resources import fmu_folder
from insenv.fmu import description
from insenv.fmu.archive import check_output, write_archive
from insenv.fmu.documentation import page
from insenv.fmu.platforms import FLAGS, build, chosen
from insenv.fmu.reference import EVERY, STEPS, csv, signals
from insenv.fmu.sources import TOKEN, amalgamated, main_source, sources, token
from insenv.fmu.subject import Subject, subject
from insenv.fmu.variables import Kind, Variable, variables

_REFERENCE = "extra/org.fmi-standard.fmi-ls-ref/"


def export(
    model_id_or_scenario: str,
    output: str | Path,
    *,
    fmi: int = 2,
    platforms: Sequence[str] = ("host",),
    settings: Mapping[str, object] | None = None,
) -> Path:
    """Write the FMU of an estimator, by its id, or of a scenario's plant, by its name or the path of its .toml file.

    fmi: 2 (scalars) or 3 (arrays).  platforms: "host" (the C compiler found), "all", or names of
    `insenv.fmu.platforms.PLATFORMS` (ziglang).  settings: start values of parameters by row name, SI, or for an estimator by
    name and data-sheet unit as in a scenario (``arw_deg_sqrt_h``); for an estimator also ``sample_interval``, s.

    Returns the path.  Raises `InputError` for an unknown id, platform or setting, a value that is not allowed or a file that
    cannot be written; `InsenvError` where there is no compiler or it fails.
    """
    output = Path(output)
    if fmi not in (2, 3):
        raise InputError(f"fmi = {fmi!r}: allowed is 2 or 3")
    check_output(output, ".fmu")
    targets = chosen([platforms] if isinstance(platforms, str) else platforms)
    what = subject(model_id_or_scenario, settings or {})
    listed = variables(what)
    xml = description.model_description(what, listed, fmi)
    code = sources(what, listed, fmi)
    guid = token(xml, code, FLAGS)
    code = {name: text.replace(TOKEN, guid) for name, text in code.items()}
    libraries = build(amalgamated(code, main_source(fmi)), what.identifier, targets, fmi)
    files = {
        **_documents(what, listed, fmi, libraries),
        "modelDescription.xml": xml.replace(TOKEN, guid).encode(),
        "sources/buildDescription.xml": description.build_description(what, fmi).encode(),
        **{f"sources/{name}": text.encode() for name, text in code.items()},
        **libraries,
    }
    write_archive(output, files)
    return output


def _documents(subject: Subject, listed: Sequence[Variable], fmi: int, libraries: Mapping[str, bytes]) -> dict[str, bytes]:
    """What stands beside description, sources and libraries: documentation, licences, icon, reference signals."""
    folder, step = fmu_folder(), subject.sample_interval
    icon = (folder / "icons" / f"{subject.kind}.png").read_bytes()
    files = {"documentation/index.html": page(subject, listed, fmi, libraries).encode()}
    for licence in sorted((folder / "licenses").iterdir()):
        files[f"documentation/licenses/{licence.name}"] = licence.read_bytes()
    if fmi == 2:
        files["model.png"] = icon
    else:
        files["terminalsAndIcons/terminalsAndIcons.xml"] = description.terminals(listed).encode()
        files["terminalsAndIcons/icon.png"] = icon

    inputs, outputs = signals(subject)
    roles = {"experiments.xml": "experiment"}
    if subject.model.inputs.size:
        roles["in.csv"] = "testcase"
        files[_REFERENCE + "in.csv"] = csv([k * step for k in range(STEPS)], listed, Kind.INPUT, inputs, fmi).encode()
    roles["ref.csv"] = "result"
    times = [k * step for k in range(0, STEPS + 1, EVERY)]
    files[_REFERENCE + "ref.csv"] = csv(times, listed, Kind.OUTPUT, outputs, fmi).encode()
    text = description.experiments(STEPS * step, step, bool(subject.model.inputs.size))
    files[_REFERENCE + "experiments.xml"] = text.encode()
    files[_REFERENCE + "fmi-ls-manifest.xml"] = description.references(roles).encode()
    return files


def summary(path: str | Path) -> dict[str, Any]:
    """What an FMU written by `export` holds: model, fmi, token, sample_interval_s, variables by causality, binaries, bytes."""
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
