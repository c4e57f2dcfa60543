"""Export an estimator or a plant as an FMU: a zip archive with the same bytes for the same content."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from insenv.base.errors import InputError
from insenv.base.output import as_path, atomic, check_output_file
from insenv.base.resources import fmu_folder
from insenv.estimators import Estimator
from insenv.fmu import description
from insenv.fmu.documentation import page
from insenv.fmu.platforms import FLAGS, build, checked_platforms
from insenv.fmu.reference import reference_files
from insenv.fmu.sources import TOKEN, amalgamated, sources, token
from insenv.fmu.subject import Subject, identifier, subject
from insenv.fmu.variables import variables
from insenv.scenario import ScenarioLike

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
