"""Pages: speed of a model as WebAssembly beside native code, and the size of a page."""

from __future__ import annotations

import tempfile
from pathlib import Path

from insenv.bench.figure import Figure, empty_loop, median_time
from insenv.bench.page_machine import PageMachine
from insenv.core.runner import make_runner
from insenv.web.live import compressed, live
from insenv.web.page import page

SCENARIO, ESTIMATOR = "ship-swaying", "q-method"
SAMPLES, REPETITIONS = 60_000, 9


def samples() -> Figure:
    """One sample of the plant and the estimator in wasmtime; the peer is the same model in native code, in the same run."""
    made = live(SCENARIO, ESTIMATOR)
    machine, native = PageMachine(made), make_runner(made.page.model, made.parameters)
    value = median_time(lambda: machine.run(SAMPLES, every=made.every), REPETITIONS)
    beside = median_time(lambda: native.run(SAMPLES, every=made.every), REPETITIONS)
    note = f"{SCENARIO} with {ESTIMATOR}, one core, in wasmtime; floor: the native loop of an empty model"
    per_sample = 1e9 / SAMPLES
    peer = ("the same natively", beside * per_sample)
    return Figure("web.samples", value * per_sample, "ns", empty_loop(SAMPLES, REPETITIONS) * 1e3, REPETITIONS, note, peer)


def size() -> Figure:
    """The file of a page; the floor is its WebAssembly alone, compressed."""
    with tempfile.TemporaryDirectory(prefix="insenv-bench-") as folder:
        path = page(SCENARIO, Path(folder) / "page.html", ESTIMATOR)
        text = path.stat().st_size
    floor = len(compressed(live(SCENARIO, ESTIMATOR).wasm))
    return Figure(
        "web.size", text / 1e3, "kB", floor / 1e3, 1, f"page of {SCENARIO} with {ESTIMATOR}; floor: its code, compressed"
    )
