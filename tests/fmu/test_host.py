"""FMUs without Python: the C host of fmu/examples, and every wrong call under the sanitizers."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmu_host import hosted, input_csv, started
from fmu_tools import INTERVAL, c_compiler, columns_for, in_process, scratch, unzipped
from peers import ran
from places import ROOT

from insenv.base.resources import fmu_folder
from insenv.estimators import registered
from insenv.scenario import build, load, names

ID = "qakf-improved"
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]


@pytest.mark.skipif(sys.platform == "win32", reason="the line is for Linux and macOS")
def test_the_documented_command_compiles_the_host_which_prints_the_reason_for_a_refused_call(tmp_path):
    page = (ROOT / "docs" / "fmu.md").read_text("utf-8")
    (line,) = [line for line in page.splitlines() if line.startswith("$ cc ")]
    words = shlex.split(line.removeprefix("$ ").replace("fmu/examples/", f"{fmu_folder()}/examples/"))
    subprocess.run([c_compiler(), *words[1:]], cwd=tmp_path, check=True)
    columns = columns_for(ID, 300)
    table = input_csv(columns, "line.csv")
    done, output = started(unzipped(ID), table, step=0.0075, host=tmp_path / "host")
    assert done.returncode == 1 and "allowed is one sample interval, 0.005 s" in done.stderr and not output.exists()
    found = hosted(unzipped(ID), table, host=tmp_path / "host", runs=3)  # two resets
    np.testing.assert_array_equal(found.values, in_process(ID, columns))


def sanitized(folder: Path, fmi: int) -> Path:
    """c/misuse.c and the sources of the FMU, compiled with the sanitizers; skips if there are none."""
    compiler, probe = c_compiler(), scratch() / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    tried = [compiler, *SANITIZERS, str(probe), "-o", str(probe.with_suffix(""))]
    if subprocess.run(tried, capture_output=True).returncode or subprocess.run([tried[-1]], capture_output=True).returncode:
        pytest.skip(f"{compiler} has no AddressSanitizer and UndefinedBehaviorSanitizer here")
    sources, binary = folder / "sources", scratch() / f"misuse-{folder.name}"
    files = [str(path) for path in (Path(__file__).parent / "c" / "misuse.c", *sorted(sources.glob("*.c")))]
    includes = [f"-I{place}" for place in (sources, fmu_folder() / "headers", fmu_folder() / "examples")]
    options = ["-std=gnu99", "-O0", "-g", f"-DFMI={fmi}", f"-DFMI{fmi}_OVERRIDE_FUNCTION_PREFIX", "-Wno-unused-function"]
    command = [compiler, *options, *SANITIZERS, *includes, *files, "-o", str(binary), "-lm"]
    ran(*command)
    return binary


EVERY = [(id, 3) for id in (*registered(), *names())] + [(id, 2) for id in (ID, "fusion-smoother", "car-city-drive")]
"""The equations of a model are the same C in both versions of FMI; what surrounds them is the same C for all models."""


@pytest.mark.slow
@pytest.mark.parametrize(("id", "fmi"), EVERY)
def test_wrong_calls_are_refused_under_the_sanitizers(id, fmi):
    """Every wrong call is refused with a reason and changes nothing, and no sanitizer reports an error."""
    folder = unzipped(id, fmi)
    interval = build(load(id)).sample_interval if id in names() else INTERVAL
    command = [str(sanitized(folder, fmi)), str(folder / "modelDescription.xml"), repr(interval)]
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    assert " 0 failed" in done.stdout
    assert "ERROR" not in done.stderr and "runtime error" not in done.stderr
