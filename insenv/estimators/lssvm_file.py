"""The file of a trained LS-SVM: JSON, with its format's version and the conditions it was trained under.

    {"format": "insenv-lssvm", "version": 1, "insenv": "0.1.0",
     "training": {"runs": [{"scenario", "digest", "seeds", "duration_s"}], "filter", "samples", "parameters", "scores", ...},
     "machine": {"support", "coefficients", "offset", "scale", "machine_sigma"}}

The numbers of `machine` are the rows of `insenv.estimators.lssvm.MACHINE`, float64 to the last bit.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.errors import InputError, InsenvError
from insenv.files.output import atomic

FORMAT = "insenv-lssvm"
VERSION = 1
FEATURES, OUTPUTS = 6, 3
LARGEST_FILE = 20_000_000
_SHAPES: dict[str, tuple[int, ...]] = {
    "support": (-1, FEATURES),
    "coefficients": (-1, OUTPUTS),
    "offset": (OUTPUTS,),
    "scale": (FEATURES,),
    "machine_sigma": (OUTPUTS,),
}

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrainedMachine:
    """A trained machine and how it was trained.

    support (S, 6): support vectors over the kernel's width.  coefficients (S, 3), offset (3): rad.  scale (6): what inputs are
    multiplied by.  machine_sigma (3): scatter about what it learnt, rad.  training: its conditions, as in the file.
    insenv: version of insenv that trained it.
    """

    support: Array
    coefficients: Array
    offset: Array
    scale: Array
    machine_sigma: Array
    training: Mapping[str, Any]
    insenv: str

    def rows(self, room: int) -> dict[str, Any]:
        """Parameter rows for a model with room for so many support vectors.  Raises `InputError` if there are more."""
        count = len(self.support)
        if count > room:
            raise InputError(f"machine of {count} support vectors: allowed is up to {room}")
        support, coefficients = np.zeros((room, FEATURES)), np.zeros((room, OUTPUTS))
        support[:count], coefficients[:count] = self.support, self.coefficients
        return {
            "support": support,
            "coefficients": coefficients,
            "offset": self.offset,
            "scale": self.scale,
            "machine_sigma": self.machine_sigma,
        }

    @property
    def seeds(self) -> dict[str, set[int]]:
        """Seeds that it was trained on, by scenario."""
        found: dict[str, set[int]] = {}
        for run in self.training["runs"]:
            found.setdefault(run["scenario"], set()).update(run["seeds"])
        return found

    def save(self, path: str | Path) -> None:
        """Write the file, under a temporary name first.  Raises `InsenvError` if the disk does not take it."""
        path = Path(path)
        machine = {name: np.asarray(getattr(self, name)).tolist() for name in _SHAPES}
        content = {"format": FORMAT, "version": VERSION, "insenv": self.insenv, "training": self.training, "machine": machine}
        try:
            with atomic(path) as stream:
                stream.write(_text(content).encode())
        except OSError as error:
            raise InsenvError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


def load(path: str | Path) -> TrainedMachine:
    """The machine of a file.  Raises `InputError`: missing, no such file, damaged, of a newer insenv."""
    name = str(path)
    try:
        if Path(path).stat().st_size > LARGEST_FILE:
            raise InputError(f"{name!r} is larger than {LARGEST_FILE} bytes: this is no trained machine")
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {name!r}: {error.strerror or error}") from None
    except (UnicodeDecodeError, ValueError, RecursionError):
        raise InputError(f"{name!r} is not JSON: damaged, or not a file that `insenv train` has written") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{name!r} is not a trained machine: its format is not {FORMAT!r}")
    version = content.get("version")
    if isinstance(version, int) and version > VERSION:
        raise InputError(f"{name!r} has version {version}: this insenv reads up to {VERSION}; use a newer insenv")
    if version != VERSION:
        raise InputError(f"{name!r} has version {version!r}: allowed is {VERSION}")
    machine, training = content.get("machine"), content.get("training")
    if not isinstance(machine, dict) or not isinstance(training, dict):
        raise InputError(f"{name!r} is damaged: it lacks its machine or the conditions of its training")
    try:
        runs = training["runs"]
        for run in runs:
            str(run["scenario"]), [int(seed) for seed in run["seeds"]]
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{name!r} is damaged: it does not say which runs it was trained on") from None
    arrays = {key: _array(name, machine, key, shape) for key, shape in _SHAPES.items()}
    if len(arrays["support"]) != len(arrays["coefficients"]):
        raise InputError(
            f"{name!r} is damaged: {len(arrays['support'])} support vectors, {len(arrays['coefficients'])} coefficients"
        )
    return TrainedMachine(**arrays, training=training, insenv=str(content.get("insenv", "")))


@functools.cache
def shipped() -> TrainedMachine:
    """The machine that insenv ships."""
    return load(str(files("insenv.estimators") / "data" / "lssvm.json"))


def _array(name: str, machine: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(machine[key], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{name!r} is damaged: machine.{key} is not an array of numbers") from None
    rows = array.shape[0] if array.ndim else 0
    expected = tuple(rows if n == -1 else n for n in shape)
    if array.shape != expected or not np.isfinite(array).all():
        raise InputError(f"{name!r} is damaged: machine.{key} has shape {array.shape} or numbers that are not finite")
    return array


def _text(content: Mapping[str, Any]) -> str:
    """JSON, with one row of numbers on a line."""
    machine = content["machine"]
    rest = json.dumps({k: v for k, v in content.items() if k != "machine"}, indent=1, ensure_ascii=True, allow_nan=False)
    parts = []
    for key, value in machine.items():
        nested = bool(value) and isinstance(value[0], list)
        shown = "[\n" + ",\n".join(json.dumps(row) for row in value) + "]" if nested else json.dumps(value)
        parts.append(f'"{key}": {shown}')
    return rest[:-2] + ',\n "machine": {\n' + ",\n".join(parts) + "}\n}\n"
