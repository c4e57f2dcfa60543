"""Speed of a sample of the 15-state filter, one by one and in a batch; of functions on arrays; of starts."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
from scipy.spatial.transform import Rotation

from insenv.attitude import numeric
from insenv.bench import peers
from insenv.bench.figure import EMPTY, Figure, median_time
from insenv.core.batch import make_batch
from insenv.core.model import Model
from insenv.core.numeric import vectorized
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.geodesy import NOMINAL_GRAVITY

REPETITIONS = 15
SAMPLES = 4000  # calls in a repetition
ROWS = 1024
STARTS = 7  # repetitions of the import
FIRST_RUNS = 3


def single(backend: str, covariance_interval: float) -> Figure:
    """One advance of `loosely-coupled` without a fix, called from Python, at 200 Hz."""
    model = get("loosely-coupled").model
    runner = make_runner(model, {"covariance_interval": covariance_interval}, backend)
    runner.advance(_at_rest(model))
    empty = make_runner(EMPTY, None, backend)
    value, floor = (median_time(r._advance, REPETITIONS, SAMPLES) * 1e6 for r in (runner, empty))
    # pyins is designed for steps of several samples: with a covariance at each sample the comparison would be unfair
    peer = peers.feedback_filter(covariance_interval) if backend == "native" and covariance_interval else None
    note = _covariance_note(covariance_interval)
    return Figure(value, floor, REPETITIONS, note, peer)


def batch(covariance_interval: float) -> Figure:
    """The same for 1024 rows on one core: time per row and sample."""
    model = get("loosely-coupled").model
    return batch_at_rest(
        model, {"covariance_interval": covariance_interval}, REPETITIONS, _covariance_note(covariance_interval)
    )


def batch_at_rest(model: Model, parameters: dict[str, float], repetitions: int, note: str) -> Figure:
    """Time per row and sample of 1024 rows of a filter at rest without fixes, on one core."""
    rows, empty, inputs, samples = make_batch(model, ROWS, parameters), make_batch(EMPTY, ROWS), _at_rest(model), 100
    value = median_time(lambda: rows.run(samples, inputs), repetitions) / (ROWS * samples) * 1e9
    floor = median_time(lambda: empty.run(samples), repetitions) / (ROWS * samples) * 1e9
    return Figure(value, floor, repetitions, f"{ROWS} rows, one core, {getattr(rows, 'lanes', 1)} lanes; {note}")


def first_run(*arguments: str) -> Figure:
    """`insenv run` of a new user: nothing is compiled; the floor is the same run once more."""
    command = [sys.executable, "-m", "insenv", "run", *arguments, "--no-figure"]

    def taken(folder: str) -> float:
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env={**os.environ, "INSENV_CACHE_DIR": folder})
        return time.perf_counter() - begin

    cold, warm = [], []
    for _ in range(FIRST_RUNS):
        with tempfile.TemporaryDirectory(prefix="insenv-bench-") as folder:
            cold.append(taken(folder))
            warm.append(taken(folder))
    note = f"insenv run {' '.join(arguments)} with an empty cache, whole process; floor: the same with a full one"
    return Figure(statistics.median(cold), statistics.median(warm), FIRST_RUNS, note)


def import_time() -> Figure:
    """A new interpreter that imports insenv; the floor is one that imports nothing."""

    def started(statement: str) -> float:
        return median_time(lambda: subprocess.run([sys.executable, "-c", statement], check=True), STARTS)

    return Figure(started("import insenv"), started("pass"), STARTS, "whole process")


def start(*arguments: str) -> Figure:
    """A command with everything compiled, in units of a new interpreter's import of NumPy: processor times."""
    command = [sys.executable, "-m", "insenv", *arguments]
    subprocess.run(command, check=True, capture_output=True)
    taken, floor = [], []
    for _ in range(STARTS):
        taken.append(_processor_time(command))
        floor.append(_processor_time([sys.executable, "-c", "import numpy"]))
    unit = statistics.median(floor)
    note = f"insenv {' '.join(arguments)}, processor time; floor: python -c 'import numpy', here {unit:.2f} s"
    return Figure(statistics.median(taken) / unit, 1.0, STARTS, note)


def _processor_time(command: list[str]) -> float:
    """Processor time of a process and those that it started, s; os.times knows it to 10 ms."""
    before = os.times()
    subprocess.run(command, check=True, capture_output=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def _covariance_note(interval: float) -> str:
    return f"200 Hz, covariance every {interval:g} s" if interval else "200 Hz, covariance at each sample"


def _at_rest(model: Model) -> np.ndarray:
    return model.inputs.pack({"delta_velocity": (0.0, 0.0, -NOMINAL_GRAVITY * 0.005), "dt": 0.005})


# Functions for NumPy arrays: on one row, and on many.

NUMERIC_REPETITIONS = 9
NUMERIC_CALLS = 2000  # on one row, in a repetition
NUMERIC_ROWS = 10_000
_IDENTITY = vectorized(lambda q, v: v, 4, 3)


def one_row() -> Figure:
    """A vector rotated by a quaternion, as agents of one's own do at each sample."""
    value, floor, peer = (1e6 * taken for taken in _rotation_times((), NUMERIC_CALLS))
    return Figure(value, floor, NUMERIC_REPETITIONS, _rotation_note("one row"), ("SciPy's Rotation", peer))


def many_rows() -> Figure:
    """The same of many rows: time of a row."""
    value, floor, peer = (1e9 * taken / NUMERIC_ROWS for taken in _rotation_times((NUMERIC_ROWS,), 1))
    return Figure(value, floor, NUMERIC_REPETITIONS, _rotation_note(f"a row of {NUMERIC_ROWS}"), ("SciPy's Rotation", peer))


def _rotation_note(rows: str) -> str:
    return f"attitude.numeric.rotate, {rows}; floor: a function that returns its argument"


def _rotation_times(leading: tuple[int, ...], calls: int) -> tuple[float, ...]:
    """Of a call of the function, of an empty one, and of the peer, s."""
    draw = np.random.default_rng(1)
    q, v = draw.normal(size=(*leading, 4)), draw.normal(size=(*leading, 3))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    last = np.roll(q, -1, axis=-1)  # SciPy has the scalar last
    return tuple(
        median_time(call, NUMERIC_REPETITIONS, calls)
        for call in (lambda: numeric.rotate(q, v), lambda: _IDENTITY(q, v), lambda: Rotation.from_quat(last).apply(v))
    )
