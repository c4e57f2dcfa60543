"""FMUs without Python: a C host, wrong calls under sanitizers, other platforms, exported functions of the binaries."""

import os
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import binaries
import numpy as np
import pytest
from fmu_tools import (
    INTERVAL,
    c_compiler,
    columns_for,
    host_binary,
    in_process,
    plant_outputs,
    scratch,
    thorough,
    unzipped,
)
from places import ROOT

from insenv.estimators import registered
from insenv.files.resources import fmu_folder
from insenv.fmu.series import Series, flattened, read_csv, write_csv
from insenv.scenario import build, load, names

SAMPLES = 4000
LONG = 60_000
MISUSE = Path(__file__).parent / "c" / "misuse.c"
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer"]


def input_csv(columns: dict[str, np.ndarray] | None, count: int, name: str) -> Path:
    """Inputs at times k INTERVAL; only the time if there are none."""
    flat = flattened(columns or {})
    values = np.array(list(flat.values())).T if flat else np.zeros((count, 0))
    write_csv(scratch() / name, Series(INTERVAL * np.arange(count), tuple(flat), values))
    return scratch() / name


def hosted(folder: Path, table: Path, *, runner: tuple[str, ...] = (), host: Path | None = None, runs: int = 1) -> Series:
    """The output of the C host."""
    output = table.with_suffix(f".{folder.name}.out.csv")
    command = [*runner, str(host or host_binary()), str(folder), str(table), repr(INTERVAL), str(output), str(runs)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return read_csv(output)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", ["qakf-improved", "loosely-coupled"])
def test_the_result_of_the_host_is_bit_identical_to_the_model(id, fmi):
    columns = columns_for(id, SAMPLES)
    found = hosted(unzipped(id, fmi), input_csv(columns, SAMPLES, f"{id}.csv"))
    np.testing.assert_array_equal(found.values, in_process(id, columns))


def test_a_plant_in_the_host():
    found = hosted(unzipped("ship-swaying"), input_csv(None, SAMPLES, "ship.csv")).named()
    shown = plant_outputs("ship-swaying", SAMPLES)
    for name in ("delta_angle", "delta_velocity", "q_nb", "gyro_bias_true"):
        np.testing.assert_array_equal(found[name], shown[name])


def test_a_run_after_a_reset_is_the_same():
    columns = columns_for("qakf-improved", 500)
    table = input_csv(columns, 500, "reset.csv")
    np.testing.assert_array_equal(hosted(unzipped("qakf-improved"), table, runs=3).values, in_process("qakf-improved", columns))


@pytest.mark.skipif(sys.platform == "win32", reason="the line is for Linux and macOS")
def test_the_documented_command_compiles_the_host(tmp_path):
    page = ROOT / "docs" / "fmu.md"
    (line,) = [line for line in page.read_text("utf-8").splitlines() if line.startswith("$ cc ")]
    words = shlex.split(line.removeprefix("$ ").replace("fmu/examples/", f"{fmu_folder()}/examples/"))
    subprocess.run([c_compiler(), *words[1:]], cwd=tmp_path, check=True)
    columns = columns_for("qakf-improved", 10)
    found = hosted(unzipped("qakf-improved"), input_csv(columns, 10, "line.csv"), host=tmp_path / "host")
    np.testing.assert_array_equal(found.values, in_process("qakf-improved", columns))


def test_the_host_prints_the_reason_for_a_refused_call():
    columns = columns_for("qakf-improved", 10)
    table = input_csv(columns, 10, "refused.csv")
    command = [str(host_binary()), str(unzipped("qakf-improved")), str(table), "0.0075", str(scratch() / "none.csv")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "allowed is one sample interval, 0.005 s" in done.stderr
    assert not (scratch() / "none.csv").exists()


def sanitized(folder: Path, fmi: int) -> Path:
    """misuse.c and the sources of the FMU, compiled with the sanitizers; skips if there are none."""
    compiler, probe = c_compiler(), scratch() / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    tried = subprocess.run(
        [compiler, *SANITIZERS, str(probe), "-o", str(probe.with_suffix(""))], capture_output=True, text=True
    )
    if tried.returncode or subprocess.run([str(probe.with_suffix(""))], capture_output=True).returncode:
        pytest.skip(f"{compiler} has no AddressSanitizer and UndefinedBehaviorSanitizer here")
    sources = folder / "sources"
    files = [str(path) for path in sorted(sources.glob("*.c"))]
    includes = [f"-I{sources}", f"-I{fmu_folder() / 'headers'}", f"-I{fmu_folder() / 'examples'}"]
    binary = scratch() / f"misuse-{folder.name}"
    command = [
        compiler,
        "-std=gnu99",
        "-O0",
        "-g",
        f"-DFMI={fmi}",
        f"-DFMI{fmi}_OVERRIDE_FUNCTION_PREFIX",
        *SANITIZERS,
        *includes,
        str(MISUSE),
        *files,
    ]
    done = subprocess.run([*command, "-Wno-unused-function", "-o", str(binary), "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return binary


def check_misuse(id: str, fmi: int) -> None:
    """Check that every wrong call is refused with a reason and changes nothing, and that no sanitizer reports an error."""
    folder = unzipped(id, fmi)
    interval = build(load(id)).sample_interval if id in names() else INTERVAL
    command = [str(sanitized(folder, fmi)), str(folder / "modelDescription.xml"), repr(interval)]
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    assert " 0 failed" in done.stdout
    assert "ERROR" not in done.stderr
    assert "runtime error" not in done.stderr


@pytest.mark.parametrize(
    ("id", "fmi"),
    [
        pytest.param("loosely-coupled", 2, marks=pytest.mark.slow),
        ("qakf-improved", 3),
        pytest.param("ship-swaying", 2, marks=pytest.mark.slow),
    ],
)
def test_wrong_calls_are_refused_under_the_sanitizers(id, fmi):
    check_misuse(id, fmi)


@thorough
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", [*(e.id for e in registered().values()), *names()])
def test_wrong_calls_to_every_fmu_are_refused(id, fmi):
    check_misuse(id, fmi)


@thorough
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", [e.id for e in registered().values()])
def test_every_estimator_in_the_host_over_60000_steps(id, fmi):
    columns = columns_for(id, LONG)
    found = hosted(unzipped(id, fmi), input_csv(columns, LONG, f"{id}-long.csv"))
    np.testing.assert_array_equal(found.values, in_process(id, columns))


def zig_host(target: str, name: str, *libraries: str) -> Path:
    """The host for another platform, compiled by zig."""
    if find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed: pip install -e '.[native]'")
    binary = scratch() / name
    source = fmu_folder() / "examples" / "host.c"
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-std=c99", "-O2", str(source), "-o", str(binary)]
    subprocess.run([*command, *libraries], check=True, capture_output=True)
    return binary


@thorough
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", ["qakf-improved", "loosely-coupled"])
def test_aarch64_linux_is_bit_identical(id, fmi):
    qemu, root = shutil.which("qemu-aarch64"), Path("/usr/aarch64-linux-gnu")
    if qemu is None or not (root / "lib" / "ld-linux-aarch64.so.1").exists():
        pytest.skip("qemu-aarch64 and a C library for it are not here (Debian: qemu-user, libc6-arm64-cross)")
    columns, folder = columns_for(id, SAMPLES), unzipped(id, fmi, ("aarch64-linux",))
    host = zig_host("aarch64-linux-gnu.2.17", "host-aarch64", "-ldl", "-lm")
    found = hosted(folder, input_csv(columns, SAMPLES, f"{id}.csv"), runner=(qemu, "-L", str(root)), host=host)
    np.testing.assert_array_equal(found.values, in_process(id, columns))


@thorough
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("id", ["qakf-improved", "loosely-coupled"])
def test_windows_under_wine_is_bit_identical(id, fmi, monkeypatch):
    places = ("wine64", "wine", "/usr/lib/wine/wine64")
    wine = next(filter(None, map(shutil.which, places)), None)
    if wine is None:
        pytest.skip("wine is not here (Debian: wine64)")
    monkeypatch.setenv("WINEPREFIX", str(scratch() / "wine"))
    monkeypatch.setenv("WINEDEBUG", "-all")
    columns, folder = columns_for(id, SAMPLES), unzipped(id, fmi, ("x86_64-windows",))
    host = zig_host("x86_64-windows-gnu", "host.exe")
    found = hosted(folder, input_csv(columns, SAMPLES, f"{id}.csv"), runner=(wine,), host=host)
    np.testing.assert_array_equal(found.values, in_process(id, columns))


def standard_functions(fmi: int) -> set[str]:
    """Names of the functions that the header of the standard declares."""
    header = (fmu_folder() / "headers" / f"fmi{fmi}Functions.h").read_text()
    declared = {line.split()[-1].rstrip(";") for line in header.splitlines() if line.lstrip().startswith(f"FMI{fmi}_Export ")}
    return declared


PLACES = {
    2: {"linux64": "x86_64", "win64": "x86_64", "darwin64": "universal", "aarch64-linux": "arm64", "aarch64-darwin": "arm64"},
    3: {
        "x86_64-linux": "x86_64",
        "x86_64-windows": "x86_64",
        "x86_64-darwin": "x86_64",
        "aarch64-linux": "arm64",
        "aarch64-darwin": "arm64",
    },
}
NEEDED = {  # the libraries that each system contains
    "so": {"libc.so.6", "libm.so.6"},
    "dylib": {"/usr/lib/libSystem.B.dylib"},
    "dll": {"KERNEL32.dll", "msvcrt.dll"},
}


def check_binary(path: Path, processors: set[str], fmi: int) -> None:
    """Check processor, exported symbols (all functions of the standard and nothing else) and required libraries."""
    parts = binaries.read(path)
    assert {part.processor for part in parts} == processors
    for part in parts:
        functions = {name for name in part.exports if not name.startswith("_")}
        assert functions == standard_functions(fmi), path
        needs = {name for name in part.needs if not name.lower().startswith("api-ms-win-crt-")}
        assert needs <= NEEDED[path.suffix[1:]], path
        if path.suffix == ".dylib":
            assert part.name == f"@rpath/{path.name}"


@pytest.mark.skipif(sys.platform != "linux", reason="reads the ELF binary of Linux")
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_binary_here_exports_the_standard_and_nothing_else(fmi):
    (path,) = unzipped("qakf-improved", fmi).glob("binaries/*/*.so")
    check_binary(path, {"x86_64"} if "64-linux" not in path.parent.name or "x86" in path.parent.name else {"arm64"}, fmi)


@thorough
@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed: pip install -e '.[native]'")
@pytest.mark.parametrize("fmi", [2, 3])
def test_binaries_of_all_platforms_are_what_their_folders_say(fmi):
    folder = unzipped("qakf-improved", fmi, ("all",)) / "binaries"
    found = {path.parent.name: path for path in folder.glob("*/*") if path.is_file()}
    assert set(found) >= set(PLACES[fmi])
    for place, path in found.items():
        processor = PLACES[fmi].get(place, "arm64" if "aarch64" in place else "x86_64")
        check_binary(path, {"x86_64", "arm64"} if processor == "universal" else {processor}, fmi)
