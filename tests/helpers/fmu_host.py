"""The C host of fmu/examples: its input, its runs, and itself for other platforms."""

import subprocess
import sys
from pathlib import Path

import numpy as np
from fmu_tools import INTERVAL, host_binary, scratch

from insenv.base.resources import fmu_folder
from insenv.fmu.running import Series, flattened, read_csv, write_csv


def table(columns: dict[str, np.ndarray]) -> Series:
    """Inputs at times k INTERVAL."""
    flat = flattened(columns)
    values = np.array(list(flat.values())).T
    return Series(INTERVAL * np.arange(len(values)), tuple(flat), values)


def input_csv(columns: dict[str, np.ndarray], name: str) -> Path:
    write_csv(scratch() / name, table(columns))
    return scratch() / name


def started(folder: Path, given: Path, *more: str, step: float = INTERVAL, runner=(), host: Path | None = None):
    """A run of the C host that has ended, and the place of its output."""
    output = given.with_suffix(f".{folder.name}.out.csv")
    command = [*runner, str(host or host_binary()), str(folder), str(given), repr(step), str(output), *more]
    return subprocess.run(command, capture_output=True, text=True, timeout=300), output


def hosted(folder: Path, given: Path, *, runs: int = 1, **more) -> Series:
    done, output = started(folder, given, str(runs), **more)
    assert done.returncode == 0, done.stderr
    return read_csv(output)


def zig_host(target: str, name: str, *libraries: str) -> Path:
    """The host for another platform, compiled by zig."""
    source, binary = fmu_folder() / "examples" / "host.c", scratch() / name
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-std=c99", "-O2", str(source), "-o", str(binary)]
    subprocess.run([*command, *libraries], check=True, capture_output=True)
    return binary
