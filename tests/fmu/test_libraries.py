"""Our FMUs in the importers' libraries FMI Library and fmi4c, to the bit; docs/fmu.md builds both."""

import functools
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmu_tools import INTERVAL, c_compiler, columns_for, scratch

from insenv.fmu import export_fmu, run
from insenv.fmu.reading import read_description, read_variable
from insenv.fmu.series import flattened

SAMPLES = 2000
LIBRARIES = {"fmil": ("INSENV_FMIL", "fmilib_shared"), "fmi4c": ("INSENV_FMI4C", "fmi4c")}
"""The variable that names the folder of the installed library, and the library, by the name of its source in tests/fmu/c."""

KINDS = ({"fmi": 2}, {"fmi": 3}, {"fmi": 3, "arrays": False})
CASES = [
    (what, estimator, options)
    for what, estimator in (
        ("q-method", None),
        ("loosely-coupled", None),  # with flags
        ("ship-swaying", None),
        ("ship-swaying", "qakf-improved"),
        ("car-city-drive", "loosely-coupled"),
    )
    for options in KINDS
]


@functools.cache
def program(library: str) -> Path:
    """The test program of a library, compiled; skips where the library is not."""
    variable, name = LIBRARIES[library]
    if not os.environ.get(variable):
        pytest.skip(f"{variable} names no folder: build the library as docs/fmu.md tells")
    root, binary = Path(os.environ[variable]).resolve(), scratch() / f"importer-{library}"
    source = Path(__file__).parent / "c" / f"{library}.c"
    folder = root / "lib"
    command = [c_compiler(), "-std=c99", "-O2", "-I", str(root / "include"), str(source), "-o", str(binary)]
    subprocess.run([*command, f"-L{folder}", f"-l{name}", f"-Wl,-rpath,{folder}", "-lm", "-ldl"], check=True)
    return binary


@functools.cache
def own(what, estimator, fmi, arrays):
    """The FMU; its inputs; its outputs from `insenv.fmu.run`."""
    path = scratch() / f"importers-{what}-{estimator}-{fmi}-{arrays}.fmu"
    export_fmu(what, path, estimator=estimator, fmi=fmi, arrays=arrays)
    columns = columns_for(what, SAMPLES) if what in ("q-method", "loosely-coupled") else {}
    return path, columns, run(path, columns, stop_time=SAMPLES * INTERVAL)


def plan(path, columns):
    """The text that tests/fmu/c/importer.h reads."""
    variables = [v for v in map(read_variable, read_description(path).modelVariables) if v is not None]
    flat = flattened(columns)
    inputs = [v for v in variables if v.causality == "input" and v.elements[0] in flat]
    outputs = [v for v in variables if v.causality == "output"]
    table = np.array([flat[name] for v in inputs for name in v.elements]).reshape(-1, SAMPLES).T
    rows = [" ".join(map(repr, row)) for row in table.tolist()]
    ports = [f"{v.name} {len(v.elements)}" for v in (*inputs, *outputs)]
    return "\n".join([f"{SAMPLES} {INTERVAL!r} {len(inputs)} {len(outputs)}", *ports, *rows])


@pytest.mark.parametrize(("what", "estimator", "options"), CASES)
@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_gives_our_outputs_to_the_bit(library, what, estimator, options, tmp_path):
    binary = program(library)
    path, columns, wanted = own(what, estimator, options["fmi"], options.get("arrays"))
    (tmp_path / "plan").write_text(plan(path, columns))
    (tmp_path / "unpacked").mkdir()
    command = [binary, path, tmp_path / "unpacked", tmp_path / "plan", tmp_path / "out"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = np.fromfile(tmp_path / "out").reshape(SAMPLES, -1)
    np.testing.assert_array_equal(found, wanted.values)


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_shows_the_reason_for_a_refused_step(library, tmp_path):
    binary = program(library)
    path, columns, _ = own("q-method", None, 2, None)
    (tmp_path / "plan").write_text(plan(path, columns).replace(repr(INTERVAL), "0.1", 1))
    (tmp_path / "unpacked").mkdir()
    command = [binary, path, tmp_path / "unpacked", tmp_path / "plan", tmp_path / "out"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "communication step is 0.1 s: allowed is one sample interval, 0.005 s" in done.stdout + done.stderr
