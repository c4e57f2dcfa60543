"""Our FMUs and SSP files in other importers, and the models of Reference-FMUs in ours: `python -m pytest tools/importers`.

A person runs it who has built them, as docs/fmu.md tells: an environment variable names each, and without it they are skipped.
"""

from __future__ import annotations

import csv
import functools
import os
import subprocess
import zipfile
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmu_tools import (  # type: ignore[import-not-found]  # tests/helpers
    INTERVAL,
    c_compiler,
    columns_for,
    in_process,
    plant_outputs,
    scratch,
)
from scipy.io import loadmat

from insenv.fmu import export_fmu, export_ssp, run, run_ssp
from insenv.fmu.reading import read_description, read_variable
from insenv.fmu.running import Series, flattened

Options = dict[str, Any]
Columns = dict[str, np.ndarray]
ARRAYS: Options = {"fmi": 3}
SCALARS: Options = {"fmi": 3, "arrays": False}
LOOP: Options = {"fmi": 2, "estimator": "qakf-improved"}


def named(variable: str) -> Path:
    """The folder or program that an environment variable names."""
    if not os.environ.get(variable):
        pytest.skip(f"{variable} is not set: build what it names as docs/fmu.md tells")
    return Path(os.environ[variable]).resolve()


RUN = {  # by version: model, stop time, and whether it ends the simulation itself
    2: {"BouncingBall": (3.0, False), "Dahlquist": (10.0, False), "Stair": (10.0, True), "VanDerPol": (20.0, False)},
    3: {"BouncingBall": (3.0, False), "Dahlquist": (10.0, False), "Feedthrough": (2.0, False), "Resource": (1.0, False),
        "Roberts": (1.0, False), "Stair": (10.0, True), "StateSpace": (10.0, False), "VanDerPol": (20.0, False)},
}  # fmt: skip


@pytest.mark.parametrize(("fmi", "model"), [(fmi, model) for fmi in (2, 3) for model in RUN[fmi]])
def test_a_model_of_reference_fmus_runs(fmi: int, model: str) -> None:
    stop, ends = RUN[fmi][model]
    found = run(named("INSENV_REFERENCE_FMUS") / f"fmi{fmi}" / f"{model}.fmu", stop_time=stop)
    assert found.ended == ends and len(found.time) > 0


@pytest.mark.parametrize(
    ("what", "options"),
    [("loosely-coupled", {"fmi": 2}), ("loosely-coupled", ARRAYS), ("loosely-coupled", SCALARS), ("ship-swaying", LOOP)],
)
def test_fmusim_gives_the_reference_signals_at_its_default_step(tmp_path: Path, what: str, options: Options) -> None:
    fmusim, path = str(named("INSENV_FMUSIM")), export_fmu(what, tmp_path / "x.fmu", **options)
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.endswith(".csv"):
                (tmp_path / Path(name).name).write_bytes(archive.read(name))
    given = ["--input-file", str(tmp_path / "in.csv")] if (tmp_path / "in.csv").exists() else []
    command = [fmusim, *given, "--stop-time", "1.5", "--output-file", str(tmp_path / "out.csv"), str(path)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    found, wanted = (list(csv.DictReader((tmp_path / name).read_text().splitlines())) for name in ("out.csv", "ref.csv"))
    assert len(found) == 301
    for row, reference in zip(found[::10], wanted, strict=True):
        for name in set(reference) - {"time"}:  # fmusim writes 16 digits
            for a, b in zip(row[name].split(), reference[name].split(), strict=True):
                assert float(a) == pytest.approx(float(b), rel=1e-15, abs=0)


SAMPLES = 2000
LIBRARIES = {"fmil": ("INSENV_FMIL", "fmilib_shared"), "fmi4c": ("INSENV_FMI4C", "fmi4c")}
"""The variable that names the folder of the installed library, and the library, by the name of its source here."""
SUBJECTS = (
    ("q-method", None), ("loosely-coupled", None), ("ship-swaying", None), ("ship-swaying", "qakf-improved"),
    ("car-city-drive", "loosely-coupled"),
)  # fmt: skip


@functools.cache
def program(library: str) -> Path:
    """The test program of a library, compiled."""
    variable, name = LIBRARIES[library]
    root, binary, source = named(variable), scratch() / f"importer-{library}", Path(__file__).with_name(f"{library}.c")
    command = [c_compiler(), "-std=c99", "-O2", "-I", str(root / "include"), str(source), "-o", str(binary)]
    link = [f"-L{root / 'lib'}", f"-l{name}", f"-Wl,-rpath,{root / 'lib'}", "-lm", "-ldl"]
    subprocess.run([*command, *link], check=True)
    return binary


@functools.cache
def own(what: str, estimator: str | None, fmi: int, arrays: bool | None) -> tuple[Path, Columns, Series]:
    """The FMU; its inputs; its outputs from `insenv.fmu.run`."""
    path = scratch() / f"importers-{what}-{estimator}-{fmi}-{arrays}.fmu"
    export_fmu(what, path, estimator=estimator, fmi=fmi, arrays=arrays)
    columns = columns_for(what, SAMPLES) if what in ("q-method", "loosely-coupled") else {}
    return path, columns, run(path, columns, stop_time=SAMPLES * INTERVAL)


def plan(path: Path, columns: Columns) -> str:
    """The text that importer.h reads."""
    variables = [v for v in map(read_variable, read_description(path).modelVariables) if v is not None]
    flat = flattened(columns)
    inputs = [v for v in variables if v.causality == "input" and v.elements[0] in flat]
    outputs = [v for v in variables if v.causality == "output"]
    table = np.array([flat[name] for v in inputs for name in v.elements]).reshape(-1, SAMPLES).T
    rows = [" ".join(map(repr, row)) for row in table.tolist()]
    ports = [f"{v.name} {len(v.elements)}" for v in (*inputs, *outputs)]
    return "\n".join([f"{SAMPLES} {INTERVAL!r} {len(inputs)} {len(outputs)}", *ports, *rows])


@pytest.mark.parametrize("options", ({"fmi": 2}, ARRAYS, SCALARS))
@pytest.mark.parametrize(("what", "estimator"), SUBJECTS)
@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_gives_our_outputs_to_the_bit(
    library: str, what: str, estimator: str | None, options: Options, tmp_path: Path
) -> None:
    binary = program(library)
    path, columns, wanted = own(what, estimator, options["fmi"], options.get("arrays"))
    (tmp_path / "plan").write_text(plan(path, columns))
    (tmp_path / "unpacked").mkdir()
    command = [binary, path, tmp_path / "unpacked", tmp_path / "plan", tmp_path / "out"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(np.fromfile(tmp_path / "out").reshape(SAMPLES, -1), wanted.values)


def simulated(path: Path, stop: float, folder: Path) -> Columns:
    """(rows, n) of OMSimulator's record by variable name, without the model's; the first row is the start."""
    result = folder / "result.mat"
    options = ["--emitEvents=false", f"--stopTime={stop}", f"--resultFile={result}", f"--tempDir={folder}"]
    command = [str(named("INSENV_OMSIMULATOR")), *options, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    file = loadmat(result, chars_as_strings=True)
    names = ["".join(letters).rstrip(" \0") for letters in zip_longest(*file["name"], fillvalue=" ")]
    tables, columns = {1: file["data_1"], 2: file["data_2"]}, {}
    rows = len(file["data_2"][0])
    for name, (table, row) in zip(names, file["dataInfo"][:2].T.tolist(), strict=True):
        values = tables[table or 2][abs(row) - 1] * np.sign(row)
        columns[name] = np.broadcast_to(values if len(values) == rows else values[:1], rows)
    return columns


@pytest.mark.parametrize("stop", [1, 2])  # at 2 s it adds a step of 2e-14 s
@pytest.mark.parametrize("options", ({"fmi": 2}, SCALARS))
@pytest.mark.parametrize(("what", "estimator"), [("q-method", None), ("ship-swaying", None), ("ship-swaying", "qakf-improved")])
def test_omsimulator_gives_our_outputs_to_the_bit_at_its_default_step(
    what: str, estimator: str | None, options: Options, stop: int, tmp_path: Path
) -> None:
    path = export_fmu(what, tmp_path / "x.fmu", estimator=estimator, **options)
    found = simulated(path, stop, tmp_path)
    wanted = run(path, stop_time=float(stop)).columns()
    assert len(wanted) >= 7
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[name][1 : len(values) + 1], values, err_msg=name)


@pytest.mark.parametrize("fmi", [2, 3])
def test_omsimulator_runs_an_ssp_one_step_late_at_the_step_of_its_annotation(fmi: int, tmp_path: Path) -> None:
    path, samples, prefix = tmp_path / "loop.ssp", 400, "ship_swaying.loop."
    export_ssp("ship-swaying", "qakf-improved", path, fmi=fmi)
    found = simulated(path, samples * INTERVAL, tmp_path)
    plant = run_ssp(path, stop_time=samples * INTERVAL).columns()
    for name in ("q_nb[1]", "delta_angle[3]", "delta_velocity[2]"):
        np.testing.assert_array_equal(found[f"{prefix}plant.{name}"][1 : samples + 1], plant[f"plant.{name}"])
    shown = plant_outputs("ship-swaying", samples)
    # in the first step the estimator waits for a sample
    q_nb = in_process("qakf-improved", {name: shown[name][:-1] for name in ("delta_angle", "delta_velocity")})[:, :4]
    for k in range(4):
        np.testing.assert_array_equal(found[f"{prefix}estimator.q_nb[{k + 1}]"][2 : samples + 1], q_nb[:, k])
        # OMSimulator records the outputs of the system before it renews them
        np.testing.assert_array_equal(found[f"{prefix}q_nb_{k + 1}"][3 : samples + 1], q_nb[:-1, k])
