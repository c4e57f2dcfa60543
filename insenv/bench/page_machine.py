"""A page's WebAssembly in wasmtime, driven as web/worker.js drives it: for tests and benchmarks."""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from insenv.bench.figure import Figure, empty_loop, median_time
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.report.page import compressed
from insenv.web.live import Live, live, page
from insenv.web.start import reported_places


class PageMachine:
    """One instance of the module of `live`, at the start of its seed."""

    def __init__(self, live: Live) -> None:
        import wasmtime

        self.live, self._store = live, wasmtime.Store()
        module = wasmtime.Module(self._store.engine, live.wasm)
        exports: Any = wasmtime.Instance(self._store, module, []).exports(self._store)
        self._begin, self._run, self._memory = exports["begin"], exports["run"], exports["memory"]
        self._free = (exports["__heap_base"].value(self._store) + 15) // 16 * 16
        model = live.page.model
        self._width = model.outputs.size
        self._p, self._x, self._u, self._known = (
            self._room(size) for size in (model.parameters.size, model.state.size, model.inputs.size, 36)
        )
        self._y = self._room(64 * self._width)
        self.begin(live.plant.seed)

    def begin(self, seed: int, parameters: Array | None = None, known: Array | None = None) -> None:
        """Start with a seed of the page."""
        live = self.live
        p = np.array(live.parameters if parameters is None else parameters)
        for place, _ in reported_places(live.page, live.plant):
            p[place] = 0.0  # begin fills it in; without this, one that does not would go unseen
        p[live.page.model.parameters.slice("seed")] = seed
        k = np.array(live.known if known is None else known)
        k[:9] = live.normals[live.seeds.index(seed)]
        self._set(self._p, p)
        self._set(self._known, k)
        self._set(self._u, live.page.model.inputs.start_vector())
        if self._begin(self._store, self._known, self._p, self._x):
            raise ValueError(f"seed {seed}: a reported angle is beyond a full turn")

    def run(self, n: int, every: int) -> Array:
        """Advance n times; outputs after every `every`-th advance."""
        shown = []
        while n > 0:
            count = min(n, 64 * every)
            self._run(self._store, self._p, self._x, self._u, self._y, every, count)
            shown.append(self._get(self._y, count // every * self._width).reshape(-1, self._width))
            n -= count
        return np.concatenate(shown)

    @property
    def parameters(self) -> Array:
        """The parameters, with the initial knowledge of the estimators."""
        return self._get(self._p, self.live.page.model.parameters.size)

    @property
    def state(self) -> Array:
        """The state."""
        return self._get(self._x, self.live.page.model.state.size)

    def named(self, rows: Array) -> dict[str, Any]:
        """Outputs by row name."""
        return self.live.page.model.outputs.unpack(rows)

    def _room(self, size: int) -> int:
        place, self._free = self._free, self._free + 8 * max(size, 1)
        lacking = self._free - self._memory.data_len(self._store)
        if lacking > 0:
            self._memory.grow(self._store, -(-lacking // 65536))
        return place

    def _view(self, place: int, size: int) -> Array:
        at = ctypes.addressof(self._memory.data_ptr(self._store).contents) + place
        return np.ctypeslib.as_array((ctypes.c_double * size).from_address(at)) if size else np.zeros(0)

    def _set(self, place: int, values: Array) -> None:
        self._view(place, len(values))[:] = values

    def _get(self, place: int, size: int) -> Array:
        return self._view(place, size).copy()


# Pages: speed of a model as WebAssembly beside native code, and the size of a page.

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
    return Figure(value * per_sample, empty_loop(SAMPLES, REPETITIONS) * 1e3, REPETITIONS, note, peer)


def size() -> Figure:
    """The file of a page; the floor is its WebAssembly alone, compressed."""
    with tempfile.TemporaryDirectory(prefix="insenv-bench-") as folder:
        path = page(SCENARIO, Path(folder) / "page.html", ESTIMATOR)
        text = path.stat().st_size
    floor = len(compressed(live(SCENARIO, ESTIMATOR).wasm))
    return Figure(text / 1e3, floor / 1e3, 1, f"page of {SCENARIO} with {ESTIMATOR}; floor: its code, compressed")
