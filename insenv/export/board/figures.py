"""What a filter takes on a Cortex-M7: flash, RAM and stack from the compiler, instructions from qemu."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from insenv.base.errors import InsenvError

COMPILER, SIZE, QEMU = "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm"
LIBRARY = "rdimon.specs"
"""A file of the C library, newlib, without which the compiler finds no <math.h>."""
WHOLE = "a whole sample"
INSTALL = "Debian: apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
"""How the programs are installed."""
FLAGS = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-std=c99", "-O2")
_COUNTED = re.compile(r"^(.+): (\d+) calls, mean (\d+), most (\d+) instructions$", re.MULTILINE)
_NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "([^"]*)"', re.MULTILINE)
_FRAME = re.compile(r"\\n(\d+) bytes")
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', re.MULTILINE)


@dataclass(frozen=True)
class Counted:
    """Instructions of a step of the filter, or of a whole sample: calls, mean and largest number."""

    calls: int
    mean: int
    most: int


@dataclass(frozen=True)
class Figures:
    """flash, ram, stack: bytes; ram is the struct, stack the deepest path from one of the functions of the interface.

    instructions: by name of a step, and of `WHOLE`; empty where qemu is not installed.  same_bits: whether the outputs there
    were those of the export; None: not run.
    """

    flash: int
    ram: int
    stack: int
    instructions: Mapping[str, Counted]
    same_bits: bool | None

    @property
    def bits(self) -> str:
        """Whether the outputs are those of the export, in words; empty if that is not known."""
        return {None: "", True: "bit-identical to those of the export", False: "NOT those of the export"}[self.same_bits]

    def lines(self) -> list[str]:
        """Tables in Markdown."""
        sizes = {"flash": self.flash, "RAM": self.ram, "stack": self.stack}
        lines = ["| what | value |", "|---|---|", *(f"| {what} | {size} bytes |" for what, size in sizes.items())]
        if self.same_bits is None:
            return [*lines, "", f"Instructions are counted where {QEMU} is installed ({INSTALL})."]
        lines += [f"| outputs | {self.bits} |", "", "| step | calls | instructions, mean | most |", "|---|---|---|---|"]
        return [*lines, *(f"| {name} | {n.calls} | {n.mean} | {n.most} |" for name, n in self.instructions.items())]

    def text(self) -> list[str]:
        """The same in lines of a terminal, of the instructions those of a whole sample."""
        lines = [f"  flash {self.flash / 1000:.1f} kB, RAM {self.ram / 1000:.1f} kB, stack {self.stack} bytes"]
        if WHOLE in self.instructions:
            whole = self.instructions[WHOLE]
            lines.append(f"  instructions of a sample: {whole.mean} on average, at most {whole.most}, of {whole.calls}")
        return [*lines, *([f"  outputs in qemu: {self.bits}"] if self.bits else [])]


def figures(folder: Path, name: str) -> Figures | None:
    """What the filter `name` in an exported folder takes; None without the compiler and its C library.

    Raises `InsenvError` if the compiler refuses the filter.
    """
    if shutil.which(COMPILER) is None or shutil.which(SIZE) is None:
        return None
    if _called([COMPILER, f"-print-file-name={LIBRARY}"]).strip() == LIBRARY:
        return None
    with tempfile.TemporaryDirectory() as build:
        source, compiled = Path(build) / "sized.c", Path(build) / f"{name}.o"
        _called([COMPILER, *FLAGS, "-fcallgraph-info=su", "-c", str(folder / f"{name}.c"), "-o", str(compiled)])
        source.write_text(f'#include "{name}.h"\n{name} filter;\n')
        sized = source.with_suffix(".o")
        _called([COMPILER, *FLAGS, f"-I{folder}", "-c", str(source), "-o", str(sized)])
        flash, data, _ = _sizes(compiled)
        ram = _sizes(sized)[2]
        stack = deepest(compiled.with_suffix(".ci").read_text(), [f"{name}_{what}" for what in ("init", "sample", "output")])
        counted = _counted(folder, Path(build), name)
    instructions, same_bits = counted or ({}, None)
    return Figures(flash + data, ram, stack, instructions, same_bits)


def _sizes(compiled: Path) -> tuple[int, int, int]:
    """Bytes of code with constants, of data and of zeroed data in an object file."""
    numbers = _called([SIZE, str(compiled)]).splitlines()[1].split()
    return int(numbers[0]), int(numbers[1]), int(numbers[2])


def deepest(graph: str, functions: Sequence[str]) -> int:
    """Bytes on the stack of the deepest path from one of the functions.  graph: of GCC's -fcallgraph-info=su, in VCG.

    A function of a library counts nothing.
    """
    frames = {title: sum(map(int, _FRAME.findall(label))) for title, label in _NODE.findall(graph)}
    calls: dict[str, list[str]] = {}
    for source, target in _EDGE.findall(graph):
        calls.setdefault(source, []).append(target)
    known: dict[str, int] = {}

    def depth(title: str) -> int:
        if title not in known:
            known[title] = frames.get(title, 0) + max(map(depth, calls.get(title, ())), default=0)
        return known[title]

    return max(depth(title) for title in frames if title in functions)


def _counted(folder: Path, build: Path, name: str) -> tuple[dict[str, Counted], bool] | None:
    """Instructions by name of the step, counted in qemu, and whether the outputs had the same bits; None without qemu."""
    if shutil.which(QEMU) is None or shutil.which("make") is None:
        return None
    shutil.copytree(folder, build / "copy", ignore=shutil.ignore_patterns("build", "run.bin"))
    done = subprocess.run(["make", "-s", "board"], cwd=build / "copy", capture_output=True, text=True, check=False)
    if "same bits" not in done.stdout:
        raise InsenvError(f"the test of {name} in {QEMU} failed: {(done.stdout + done.stderr)[-2000:]}")
    numbers = {step: Counted(int(n), int(mean), int(most)) for step, n, mean, most in _COUNTED.findall(done.stdout)}
    return numbers, "NOT the same bits" not in done.stdout


def _called(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise InsenvError(f"{command[0]} failed: {done.stderr[-2000:]}")
    return done.stdout
