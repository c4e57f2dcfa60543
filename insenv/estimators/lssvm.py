"""`lssvm`: large-misalignment alignment by a least-squares support vector machine trained on `aqe-sukf`.

Source: the LS-SVM large misalignment paper, sections 3 and 4. The machine takes the place of the filter in the loop:
from the differences between SINS and GNSS (`insenv.estimators.parts.sins_gnss_differences`) it infers the misalignment,
which is fed back to the SINS.

    y(x) = sum over i of a_i K(x, x_i) + b,   K = exp(-|x - x_i|^2 / sigma^2)                                  (14)

Outputs: the vector part of half of R - R^T about north, east, down: the axis of the misalignment times the sine of its
angle. For small angles it is the rotation vector, and unlike that it has no discontinuity at 180 deg. Fed back at every
fix it reduces any misalignment to zero in some steps, because the remainder appears at the next fix in the same
differences.

The exponential of the kernel is a Taylor polynomial at 1/64 of the argument, squared six times: exactly rounded
operations, and `insenv.studies.learning` trains with the same function.

File of a trained machine: JSON, with the version of the format and the conditions of the training.

    {"format": "insenv-lssvm", "version": 1, "insenv": "0.1.0",
     "training": {"runs": [{"scenario", "digest", "seeds", "duration_s"}], "filter", "samples", "scores", ...},
     "machine": {"support", "coefficients", "offset", "scale", "machine_sigma"}}

"raw_inputs" in "machine" says that it takes the differences of velocity and position themselves, as the paper prints it,
and answers from the first fix on: 1, those of a SINS that runs free; 2, of one whose velocity and position every fix sets.

The numbers of `machine` are the rows of `MACHINE`, float64 to the last bit.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from insenv import geodesy
from insenv.base.errors import InputError, InsenvError
from insenv.base.output import atomic
from insenv.core.elementary import minimum, polynomial, select
from insenv.core.model import Model, Step
from insenv.core.tables import Array, Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import frozen_frame, rows
from insenv.estimators.parts import sins_gnss_differences as differences
from insenv.estimators.parts.sins_gnss_differences import FEATURES, READY

FORMAT = "insenv-lssvm"
VERSION = 1
LARGEST_FILE = 20_000_000
SUPPORT = 96
"""Support vectors that the model has room for; a machine with fewer has coefficient 0 in the rest."""
LARGEST_ARGUMENT = 40.0
_EXP = tuple(1 / math.factorial(k) for k in range(10))

MACHINE = Table((
    Row("support", "Support vectors, over the kernel's width", "1", (SUPPORT, FEATURES), lower=-1e9, upper=1e9),
    Row("coefficients", "Coefficient of each in each output", "rad", (SUPPORT, 3), lower=-1e12, upper=1e12),
    Row("offset", "Constant term of each output", "rad", (3,), "n", lower=-1e12, upper=1e12),
    Row("scale", "Factor of the inputs: 1 / the kernel's width", "1", (FEATURES,), lower=0.0, upper=1e12),
    Row("machine_sigma", "Scatter of the machine's output about that of the filter it was trained on", "rad", (3,), "n",
        lower=0.0, upper=10.0),
    Row("raw_inputs", "1: the inputs are the differences of velocity and position themselves; 2: since the last fix", "1",
        lower=0.0, upper=2.0),
))  # fmt: skip
"""The machine as parameter rows: all zero, it leaves the SINS at its start attitude."""
_SHAPES = {row.name: tuple(-1 if n == SUPPORT else n for n in row.shape) for row in MACHINE if row.shape}
"""Shapes of the arrays in a file, -1 for its number of support vectors."""

PARAMETERS = differences.PARAMETERS + rows.chosen(
    rows.START_SIGMAS, "tilt_sigma", "heading_sigma", tilt_sigma=1.0, heading_sigma=1.0
) + MACHINE  # fmt: skip

STATE = differences.STATE + Table((
    Row("features", "The machine's inputs at the last fix", "1", (FEATURES,), "n"),
    Row("infer_due", "1 when the machine is to be evaluated"),
    Row("answers", "Number of its evaluations", "1"),
))  # fmt: skip

OUTPUTS = rows.ALIGNMENT + Table((
    STATE["features"],
    Row("ready", "1 when they show the heading", "1"),
))  # fmt: skip


def kernel(square: Any) -> Any:
    """exp(-square) of a squared distance (SX or array): relative error 1e-7 above 1e-6, absolute error 1e-17 below."""
    clipped = minimum(square, LARGEST_ARGUMENT) if isinstance(square, (float, ca.SX)) else square.clip(max=LARGEST_ARGUMENT)
    value = polynomial(clipped * (-1 / 64), _EXP)
    for _ in range(6):
        value = value * value
    return value


def machine(p: Any, x: Any) -> Any:
    """Output (3, rad) of the machine for inputs (6), (14)."""
    scaled, answer = x * p.scale, p.offset
    for i in range(SUPPORT):
        answer = answer + p.coefficients[i, :].T * kernel(ca.sumsqr(scaled - p.support[i, :].T))
    return answer


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    return {**differences.sample(p, x, u), "infer_due": 0}


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix: the differences, and the inputs of the machine."""
    at = differences.measured(p, x, u)
    changed = differences.fix(p, x, u, at)
    after = SimpleNamespace(**{**vars(x), **changed})
    inputs = select(p.raw_inputs > 0.0, differences.raw(x, u, at, p.raw_inputs > 1.0), differences.features(p, after))
    return {**changed, "features": inputs, "infer_due": _ready(p, after)}


def _ready(p: Any, x: Any) -> Any:
    """1 when the inputs show the heading; for a machine on raw inputs always."""
    return select(ca.logic_or(p.raw_inputs > 0.0, differences.heading_sigma(x) < READY), 1.0, 0.0)


def infer(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Evaluate the machine and feed its answer back."""
    return {"q_n0i": differences.turned_back(x, machine(p, x.features)), "answers": x.answers + 1}


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude, and the stated error from noise, biases and the machine's scatter (that of the start at first)."""
    horizontal = geodesy.OMEGA_IE * (ca.fabs(x.axis_n[0]) + 1e-12)
    by_bias = p.accel_bias_sigma / x.gravity
    tilt, heading = differences.tilt_sigma(x), differences.heading_sigma(x)
    sigma = ca.sqrt(
        ca.vertcat(
            tilt**2 + by_bias**2,
            tilt**2 + by_bias**2,
            heading**2 + (p.gyro_bias_sigma / horizontal) ** 2 + (by_bias * x.axis_n[2]) ** 2 / (x.axis_n[0] ** 2 + 1e-24),
        )
        + p.machine_sigma**2
    )
    start = ca.vertcat(p.tilt_sigma, p.tilt_sigma, p.heading_sigma)
    answered = x.answers > 0
    return {
        "q_nb": frozen_frame.q_nb(x, x.q_n0i),
        "attitude_sigma": ca.vertcat(*[select(answered, minimum(sigma[i], start[i] + sigma[i]), start[i]) for i in range(3)]),
        "features": x.features,
        "ready": _ready(p, x),
    }


MODEL = Model(
    id="lssvm",
    title="large misalignment in place: least-squares support vector machine trained on aqe-sukf",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS + rows.FIX_INPUTS,
    outputs=OUTPUTS,
    steps={
        "sample": Step(sample),
        "fix": Step(fix, when="gnss_valid"),
        "infer": Step(infer, when="infer_due"),
    },
    output=output,
    start=differences.start,
)


@dataclass(frozen=True)
class TrainedMachine:
    """A trained machine and how it was trained.

    support (S, 6): support vectors over the kernel's width. coefficients (S, 3), offset (3): rad. scale (6): factors of
    the inputs. machine_sigma (3): scatter about the training targets, rad. training: its conditions, as in the file.
    insenv: version of insenv that trained it. raw_inputs: as in the file.
    """

    support: Array
    coefficients: Array
    offset: Array
    scale: Array
    machine_sigma: Array
    training: Mapping[str, Any]
    insenv: str
    raw_inputs: int = 0

    def rows(self, room: int) -> dict[str, Any]:
        """Parameter rows for a model with room for `room` support vectors. Raises `InputError` if there are more."""
        count = len(self.support)
        if count > room:
            raise InputError(f"machine of {count} support vectors: allowed is up to {room}")
        arrays = {name: getattr(self, name) for name in _SHAPES}
        for name in ("support", "coefficients"):
            arrays[name] = np.pad(arrays[name], ((0, room - count), (0, 0)))
        return {**arrays, "raw_inputs": float(self.raw_inputs)}

    @property
    def seeds(self) -> dict[str, set[int]]:
        """Seeds it was trained on, by scenario."""
        seeds: dict[str, set[int]] = {}
        for run in self.training["runs"]:
            seeds.setdefault(run["scenario"], set()).update(run["seeds"])
        return seeds

    def save(self, path: str | Path) -> None:
        """Write the file, under a temporary name first. Raises `InsenvError` if it cannot be written."""
        path = Path(path)
        machine = {name: np.asarray(getattr(self, name)).tolist() for name in _SHAPES}
        if self.raw_inputs:
            machine["raw_inputs"] = self.raw_inputs
        content = {"format": FORMAT, "version": VERSION, "insenv": self.insenv, "training": self.training, "machine": machine}
        try:
            with atomic(path) as stream:
                stream.write(_text(content).encode())
        except OSError as error:
            raise InsenvError(f"cannot write {str(path)!r}: {error.strerror or error}") from error


def load(path: str | Path) -> TrainedMachine:
    """The machine of a file. Raises `InputError` if it is missing, no trained machine, damaged or of a newer insenv."""
    name = str(path)
    try:
        if Path(path).stat().st_size > LARGEST_FILE:
            raise InputError(f"{name!r} is larger than {LARGEST_FILE} bytes: not a trained machine")
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {name!r}: {error.strerror or error}") from None
    except (UnicodeDecodeError, ValueError, RecursionError):
        raise InputError(f"{name!r} is not JSON: damaged, or not written by `insenv train`") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{name!r} is not a trained machine: its format is not {FORMAT!r}")
    version = content.get("version")
    if version != VERSION:
        newer = "; use a newer insenv" if isinstance(version, int) and version > VERSION else ""
        raise InputError(f"{name!r} has version {version!r}: this insenv reads version {VERSION}{newer}")
    machine, training = content.get("machine"), content.get("training")
    if not isinstance(machine, dict) or not isinstance(training, dict):
        raise InputError(f"{name!r} is damaged: it lacks its machine or the conditions of its training")
    try:
        runs = training["runs"]
        for run in runs:
            str(run["scenario"]), [int(seed) for seed in run["seeds"]]
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{name!r} is damaged: it does not list the runs it was trained on") from None
    arrays = {key: _array(name, machine, key, shape) for key, shape in _SHAPES.items()}
    if len(arrays["support"]) != len(arrays["coefficients"]):
        raise InputError(
            f"{name!r} is damaged: {len(arrays['support'])} support vectors, {len(arrays['coefficients'])} coefficients"
        )
    raw = machine.get("raw_inputs", 0)
    if raw not in (0, 1, 2):
        raise InputError(f"{name!r} is damaged: machine.raw_inputs is {raw!r}: allowed are 0, 1 and 2")
    return TrainedMachine(**arrays, training=training, insenv=str(content.get("insenv", "")), raw_inputs=int(raw))


@functools.cache
def shipped(name: str = "lssvm") -> TrainedMachine:
    """A machine that insenv ships: "lssvm"; on raw inputs "lssvm-printed", "lssvm-printed-validated" (parameters by
    cross-validation) and "lssvm-printed-reset" (differences since the last fix)."""
    return load(str(files("insenv.estimators") / "data" / f"{name}.json"))


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
    """JSON with one row of numbers per line."""
    machine = content["machine"]
    rest = json.dumps({k: v for k, v in content.items() if k != "machine"}, indent=1, ensure_ascii=True, allow_nan=False)
    parts = []
    for key, value in machine.items():
        nested = isinstance(value, list) and bool(value) and isinstance(value[0], list)
        text = "[\n" + ",\n".join(json.dumps(row) for row in value) + "]" if nested else json.dumps(value)
        parts.append(f'"{key}": {text}')
    return rest[:-2] + ',\n "machine": {\n' + ",\n".join(parts) + "}\n}\n"


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known, with the machine that insenv ships."""
    return {
        **known.rows_of(PARAMETERS),
        "tilt_sigma": min(known.tilt_sigma, math.pi),
        "heading_sigma": min(known.heading_sigma, 2 * math.pi),
        **shipped().rows(SUPPORT),
    }


def read_file(path: str) -> Mapping[str, Any]:
    """Rows of `MACHINE` of a file that `insenv train lssvm` wrote. Raises `InputError`."""
    return load(path).rows(SUPPORT)


ESTIMATOR = Estimator(MODEL, kind="alignment", sensors=("gnss",), prepare=prepare, read_file=read_file)
