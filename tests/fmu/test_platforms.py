"""Binaries of FMUs, of other platforms under their emulators."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmu_host import hosted, input_csv, zig_host
from fmu_tools import columns_for, in_process, scratch, unzipped
from peers import lacking, package, program

from insenv.base.errors import InsenvError
from insenv.base.resources import fmu_folder
from insenv.fmu import export_fmu, platforms

ID, SAMPLES = "qakf-improved", 500
PLACES = {
    2: {"linux64": "x86_64", "win64": "x86_64", "darwin64": "universal", "aarch64-linux": "arm64", "aarch64-darwin": "arm64"},
    3: {name: "arm64" if name.startswith("aarch64") else "x86_64" for name in platforms.PLATFORMS},
}


def standard(fmi: int) -> set[str]:
    """The functions that the standard declares: a binary exports these and nothing else."""
    header = (fmu_folder() / "headers" / f"fmi{fmi}Functions.h").read_text()
    return {line.split()[-1].rstrip(";") for line in header.splitlines() if line.lstrip().startswith(f"FMI{fmi}_Export ")}


@pytest.mark.skipif(sys.platform != "linux" or shutil.which("nm") is None, reason="needs nm of Linux")
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_binary_here_exports_the_standard_and_nothing_else(fmi):
    (path,) = unzipped(ID, fmi).glob("binaries/*/*.so")
    shown = subprocess.run(["nm", "-D", "--defined-only", str(path)], capture_output=True, text=True, check=True).stdout
    assert {line.split()[-1] for line in shown.splitlines() if " T " in line} == standard(fmi)
    assert " D " not in shown


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_binaries_of_all_platforms_are_what_their_folders_say(fmi):
    folder = unzipped(ID, fmi, ("all",)) / "binaries"
    found = {path.parent.name: path for path in folder.glob("*/*") if path.is_file()}
    assert set(found) == set(PLACES[fmi])
    for place, path in found.items():
        wanted = {"x86_64", "arm64"} if PLACES[fmi][place] == "universal" else {PLACES[fmi][place]}
        if path.suffix == ".so":
            assert {62: "x86_64", 183: "arm64"}[path.read_bytes()[18]] in wanted
        if path.suffix == ".dylib":
            library = package("macholib.MachO").MachO(str(path))
            processors = package("macholib.mach_o").CPU_TYPE_NAMES
            assert {processors[part.header.cputype].lower() for part in library.headers} == wanted
            for part in library.headers:
                exports = package("macholib.SymbolTable").SymbolTable(library, part).extdefsyms
                names = {name.decode().removeprefix("_") for _, name in exports}
                assert {name for name in names if not name.startswith("_")} == standard(fmi)
                assert {needed for _, _, needed in part.walkRelocatables()} <= {"/usr/lib/libSystem.B.dylib"}
                assert part.commands[part.id_cmd][2].rstrip(b"\0").decode() == f"@rpath/{path.name}"


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("system", ["aarch64-linux", "x86_64-windows"])
@pytest.mark.parametrize("id", [ID, "loosely-coupled"])
def test_other_platforms_are_bit_identical(id, system, fmi, monkeypatch):
    if system == "aarch64-linux":
        root = Path("/usr/aarch64-linux-gnu")
        runner = (program("qemu-aarch64", how="Debian: qemu-user"), "-L", str(root))
        if not (root / "lib" / "ld-linux-aarch64.so.1").exists():
            lacking("a C library for aarch64 is not installed (Debian: libc6-arm64-cross)")
        host = zig_host("aarch64-linux-gnu.2.17", "host-aarch64", "-ldl", "-lm")
    else:
        runner = (program("wine64", "wine", "/usr/lib/wine/wine64", how="Debian: wine64"),)
        monkeypatch.setenv("WINEPREFIX", str(scratch() / "wine"))
        monkeypatch.setenv("WINEDEBUG", "-all")
        host = zig_host("x86_64-windows-gnu", "host.exe")
    columns = columns_for(id, SAMPLES)
    found = hosted(unzipped(id, fmi, (system,)), input_csv(columns, f"{id}.csv"), runner=runner, host=host)
    np.testing.assert_array_equal(found.values, in_process(id, columns))


def test_platforms_that_cannot_be_built_are_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ziglang", None)
    monkeypatch.setattr(platforms, "find_compiler", lambda: None)
    for given, said in (("win64", "needs ziglang"), ("host", "no C compiler found")):
        with pytest.raises(InsenvError, match=said):
            export_fmu("qakf", tmp_path / "x.fmu", platforms=[given])
    assert not list(tmp_path.iterdir())
