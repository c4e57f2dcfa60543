"""Speed: one inertial sample of the 15-state filter, one row after another and in a batch; the import."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from insenv.bench import peers
from insenv.bench.figures import Figure
from insenv.core.batch import make_batch
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.estimators import get
from insenv.geodesy import NOMINAL_GRAVITY

REPETITIONS = 15
SAMPLES = 4000  # calls, or samples in all rows alike, a repetition
ROWS = 1024

EMPTY = Model(
    id="empty",
    title="counts its advances and does nothing else",
    parameters=Table(),
    state=Table((Row("count", "Number of advances"),)),
    inputs=Table(),
    outputs=Table(),
    steps={"sample": Step(lambda p, x, u: {"count": x.count + 1})},
    output=lambda p, x: {},
)
"""The floor: what a runner costs by itself."""


def single(backend: str, covariance_interval: float) -> Figure:
    """One advance of `loosely-coupled` without a fix, called from Python, at 200 Hz."""
    model = get("loosely-coupled").model
    runner = make_runner(model, {"covariance_interval": covariance_interval}, backend)
    runner.advance(_at_rest(model))
    empty = make_runner(EMPTY, None, backend)
    value, floor = (_median(r._advance, SAMPLES) / SAMPLES * 1e6 for r in (runner, empty))
    # pyins propagates over batches of samples: at each sample it would be used against its grain
    peer = peers.propagate15(covariance_interval) if backend == "native" and covariance_interval else None
    note = _covariance_note(covariance_interval)
    return Figure(_name(backend, covariance_interval), value, "us", floor, REPETITIONS, note, peer)


def batch(covariance_interval: float) -> Figure:
    """The same for 1024 rows on one core: time a row and sample."""
    model = get("loosely-coupled").model
    rows = make_batch(model, ROWS, {"covariance_interval": covariance_interval})
    inputs, empty, samples = _at_rest(model), make_batch(EMPTY, ROWS), 100

    def run() -> None:
        rows.run(samples, inputs)

    value = _median(run, 1) / (ROWS * samples) * 1e9
    floor = _median(lambda: empty.run(samples), 1) / (ROWS * samples) * 1e9
    lanes = getattr(rows, "lanes", 1)
    note = f"{ROWS} rows, one core, {lanes} lanes; {_covariance_note(covariance_interval)}"
    return Figure(_name("batch", covariance_interval), value, "ns", floor, REPETITIONS, note)


def import_time() -> Figure:
    """A new interpreter that imports insenv; the floor is one that imports nothing."""

    def started(statement: str) -> float:
        return _median(lambda: subprocess.run([sys.executable, "-c", statement], check=True), 1, repetitions=7)

    return Figure("import.insenv", started("import insenv"), "s", started("pass"), 7, "whole process")


def _name(prefix: str, covariance_interval: float) -> str:
    return f"{prefix}.propagate15" + ("" if covariance_interval else "-each")


def _covariance_note(interval: float) -> str:
    return f"200 Hz, covariance every {interval:g} s" if interval else "200 Hz, covariance at each sample"


def _at_rest(model: Model) -> np.ndarray:
    return model.inputs.pack({"delta_velocity": (0.0, 0.0, -NOMINAL_GRAVITY * 0.005), "dt": 0.005})


def _median(call: Callable[[], object], times: int, repetitions: int = REPETITIONS) -> float:
    """Median time of `times` calls, s."""
    call()
    taken = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        for _ in range(times):
            call()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken)
