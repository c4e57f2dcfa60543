"""The binaries of an FMU: for this machine with its C compiler, for the five platforms with the ziglang package."""

from __future__ import annotations

import os
import platform
import struct
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.base.installing import install_extra, need
from insenv.core.cache import cache_folder
from insenv.core.compile import Compiler, compile_library, find_compiler

FLAGS = (
    "-std=gnu99",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-tree-slp-vectorize",
    "-fvisibility=hidden",
    "-g0",
    "-s",
    "-shared",
    "-w",
)
"""No contraction or reordering of floating-point operations: results are bit-identical to those of insenv's runners."""


@dataclass(frozen=True)
class Platform:
    """name: folder in FMI 3.  short: folder in FMI 2.  target: ziglang's name.  ending: suffix of a library's name."""

    name: str
    short: str
    target: str
    ending: str
    further: tuple[str, ...] = ("-fPIC",)


PLATFORMS = {
    p.name: p
    for p in (
        Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
        Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
        Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll", ()),
        Platform("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib"),
        Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ".dylib"),
    )
}
"""The platforms of FMUs, by name."""
_ALIASES = {
    "linux64": ("x86_64-linux",),
    "win64": ("x86_64-windows",),
    "darwin64": ("x86_64-darwin", "aarch64-darwin"),
    "all": tuple(PLATFORMS),
}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}


def host() -> Platform:
    """This machine's platform.  Raises `InsenvError` if FMUs cannot be built for it."""
    machine = platform.machine().lower()
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux" if sys.platform.startswith("linux") else "")
    name = f"{_MACHINES.get(machine, machine)}-{system}"
    if name not in PLATFORMS:
        raise InsenvError(f"FMUs cannot be built for this machine, {name}: name other platforms ({', '.join(PLATFORMS)})")
    return PLATFORMS[name]


def checked_platforms(names: Sequence[str]) -> list[str]:
    """The named platforms without repetition, "host" unresolved.  Raises `InputError` for an unknown name or for none."""
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise InputError(f"platforms = {names!r}: allowed are names of {', '.join(['host', *_ALIASES, *PLATFORMS])}")
    chosen: list[str] = []
    for name in names:
        if name != "host" and name not in PLATFORMS and name not in _ALIASES:
            raise InputError(f"no platform {name!r}{nearest(name, ['host', *_ALIASES, *PLATFORMS])}")
        chosen += _ALIASES.get(name, (name,))
    chosen = list(dict.fromkeys(chosen))
    if not chosen:
        raise InputError(f"no platform named{nearest('host', ['host', *_ALIASES, *PLATFORMS])}")
    if "host" in chosen and any(name in PLATFORMS for name in chosen) and host().name in chosen:
        chosen.remove("host")
    if any(name != "host" for name in chosen):
        _need_zig()
    return chosen


def build(source: str, identifier: str, platforms: Sequence[str], fmi: int) -> dict[str, bytes]:
    """Libraries compiled from one C text, by their path in the FMU.  Raises `InsenvError` if the compiler fails."""
    made: dict[str, bytes] = {}
    for name in platforms:
        where = host() if name == "host" else PLATFORMS[name]
        compiler = _host_compiler(identifier) if name == "host" else _cross_compiler(where, identifier)
        made[where.name] = compile_library(source, compiler).read_bytes()
    return _laid_out(made, identifier, fmi)


def _laid_out(made: dict[str, bytes], identifier: str, fmi: int) -> dict[str, bytes]:
    files = {}
    for name, library in made.items():
        where = PLATFORMS[name]
        files[f"binaries/{where.name if fmi == 3 else where.short}/{identifier}{where.ending}"] = library
    if fmi == 2:
        macs = [made[name] for name in ("x86_64-darwin", "aarch64-darwin") if name in made]
        if macs:  # importers on both kinds of Mac look in darwin64
            files[f"binaries/darwin64/{identifier}.dylib"] = universal(macs) if len(macs) == 2 else macs[0]
        if "aarch64-linux" in made and "x86_64-linux" not in made:
            # FMI 2.0 has no name for this platform: importers look in linux64 (FMPy) or aarch64-linux
            files[f"binaries/linux64/{identifier}.so"] = made["aarch64-linux"]
    return files


def universal(libraries: Sequence[bytes]) -> bytes:
    """One Mach-O file for several architectures: a header (Apple, mach-o/fat.h), then each library on its own page."""
    page = 14  # 2^14 B, the page size of Apple silicon
    header = struct.pack(">II", 0xCAFEBABE, len(libraries))
    body, offset = b"", 1 << page
    for library in libraries:
        magic, cpu, subtype = struct.unpack("<III", library[:12])
        if magic != 0xFEEDFACF:
            raise InsenvError("the library built for macOS is not a 64-bit Mach-O file")
        header += struct.pack(">IIIII", cpu, subtype, offset, len(library), page)
        padded = library + bytes(-len(library) % (1 << page))
        body += padded
        offset += len(padded)
    return header + bytes((1 << page) - len(header)) + body


def _host_compiler(identifier: str) -> Compiler:
    compiler = find_compiler()
    if compiler is None:
        raise InputError(f"no C compiler found: allowed is cc, gcc, clang or ziglang: {install_extra('native')}")
    # without an install name the library would contain the path of its build folder
    install_name = (f"-Wl,-install_name,@rpath/{identifier}.dylib",) if host().ending == ".dylib" else ()
    return Compiler(compiler.command, (*FLAGS, *host().further, *install_name))


def _need_zig() -> None:
    need("building for platforms other than host", "ziglang", extra="native")


def _cross_compiler(where: Platform, identifier: str) -> Compiler:
    _need_zig()
    # zig builds the C runtime of a target once and keeps it in its cache
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(Path(cache_folder()) / "zig"))
    install_name = ("-install_name", f"@rpath/{identifier}.dylib") if where.ending == ".dylib" else ()
    command = (sys.executable, "-m", "ziglang", "cc")
    return Compiler(command, ("-target", where.target, *FLAGS, *where.further, *install_name))
