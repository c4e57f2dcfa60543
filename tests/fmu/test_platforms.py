"""Binaries of FMUs: what they export and need, the folders of the platforms, other platforms under their emulators."""

import struct
import sys
from pathlib import Path

import binaries
import numpy as np
import pytest
from fmu_host import hosted, input_csv, zig_host
from fmu_tools import columns_for, in_process, scratch, unzipped
from peers import lacking, program

from insenv.errors import InputError, InsenvError
from insenv.files.resources import fmu_folder
from insenv.fmu import export_fmu, platforms

ID, SAMPLES = "qakf-improved", 500
PLACES = {
    2: {"linux64": "x86_64", "win64": "x86_64", "darwin64": "universal", "aarch64-linux": "arm64", "aarch64-darwin": "arm64"},
    3: {name: "arm64" if name.startswith("aarch64") else "x86_64" for name in platforms.PLATFORMS},
}
NEEDED = {  # the libraries that each system contains
    "so": {"libc.so.6", "libm.so.6"},
    "dylib": {"/usr/lib/libSystem.B.dylib"},
    "dll": {"KERNEL32.dll", "msvcrt.dll"},
}


def check_binary(path: Path, processors: set[str], fmi: int) -> None:
    """Check processor, exported symbols (all functions of the standard and nothing else) and required libraries."""
    header = (fmu_folder() / "headers" / f"fmi{fmi}Functions.h").read_text()
    standard = {line.split()[-1].rstrip(";") for line in header.splitlines() if line.lstrip().startswith(f"FMI{fmi}_Export ")}
    parts = binaries.read(path)
    assert {part.processor for part in parts} == processors
    for part in parts:
        assert {name for name in part.exports if not name.startswith("_")} == standard, path
        assert {name for name in part.needs if not name.lower().startswith("api-ms-win-crt-")} <= NEEDED[path.suffix[1:]], path
        if path.suffix == ".dylib":
            assert part.name == f"@rpath/{path.name}"


@pytest.mark.skipif(sys.platform != "linux", reason="reads the ELF binary of Linux")
@pytest.mark.parametrize("fmi", [2, 3])
def test_the_binary_here_exports_the_standard_and_nothing_else(fmi):
    (path,) = unzipped(ID, fmi).glob("binaries/*/*.so")
    check_binary(path, {PLACES[fmi][path.parent.name]}, fmi)


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_binaries_of_all_platforms_are_what_their_folders_say(fmi):
    folder = unzipped(ID, fmi, ("all",)) / "binaries"
    found = {path.parent.name: path for path in folder.glob("*/*") if path.is_file()}
    assert set(found) == set(PLACES[fmi])
    for place, path in found.items():
        processor = PLACES[fmi][place]
        check_binary(path, {"x86_64", "arm64"} if processor == "universal" else {processor}, fmi)


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
    found = hosted(unzipped(id, fmi, (system,)), input_csv(columns, SAMPLES, f"{id}.csv"), runner=runner, host=host)
    np.testing.assert_array_equal(found.values, in_process(id, columns))


def test_a_universal_library_holds_both():
    thin = [struct.pack("<III", 0xFEEDFACF, cpu, 3) + bytes([cpu & 255]) * 20_000 for cpu in (0x01000007, 0x0100000C)]
    fat = platforms.universal(thin)
    magic, count = struct.unpack(">II", fat[:8])
    assert (magic, count) == (0xCAFEBABE, 2)
    for k, library in enumerate(thin):
        cpu, subtype, offset, size, align = struct.unpack(">IIIII", fat[8 + 20 * k : 28 + 20 * k])
        assert (cpu, subtype, size) == (*struct.unpack("<II", library[4:12]), len(library))
        assert offset % (1 << align) == 0 and fat[offset : offset + size] == library


def test_folders_of_the_platforms():
    macho = {name: struct.pack("<III", 0xFEEDFACF, cpu, 0) for name, cpu in (("x86_64", 0x01000007), ("aarch64", 0x0100000C))}
    made = {name: macho.get(name.split("-")[0], b"") if "darwin" in name else b"" for name in platforms.PLATFORMS}
    for fmi, places in PLACES.items():
        assert {path.split("/")[1] for path in platforms._laid_out(made, "m", fmi)} == set(places)
    assert platforms._laid_out(made, "m", 2)["binaries/darwin64/m.dylib"][:4] == bytes.fromhex("cafebabe")
    assert set(platforms._laid_out({"aarch64-linux": b""}, "m", 2)) == {"binaries/aarch64-linux/m.so", "binaries/linux64/m.so"}


@pytest.mark.parametrize(
    ("given", "missing", "kind", "said"),
    [
        ((), "", InputError, "no platform named"),
        (("win64",), "ziglang", InsenvError, "needs ziglang"),
        (("host",), "compiler", InsenvError, "no C compiler found"),
    ],
)
def test_platforms_that_cannot_be_built_are_named(tmp_path, monkeypatch, given, missing, kind, said):
    if missing == "ziglang":
        monkeypatch.setitem(sys.modules, "ziglang", None)
    if missing == "compiler":
        monkeypatch.setattr(platforms, "find_compiler", lambda: None)
    with pytest.raises(kind, match=said):
        export_fmu("qakf", tmp_path / "x.fmu", platforms=given)
    assert not list(tmp_path.iterdir())
