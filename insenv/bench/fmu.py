"""FMUs: time of a step in a C host and from Python beside the bare model and PythonFMU; time of export, and size.

The estimator is `qakf-improved` on the swaying ship, with the inputs of a simulated run; all outputs are read at every step.
"""

from __future__ import annotations

import csv
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from insenv.base.errors import InsenvError
from insenv.base.installing import install_extra
from insenv.base.resources import fmu_folder
from insenv.bench.figure import Figure
from insenv.core.codegen import native_source
from insenv.core.compile import Compiler, compile_library, find_compiler, pointer
from insenv.core.compile import load as load_library
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.fmu import export_fmu, export_ssp, run, run_ssp
from insenv.fmu.platforms import FLAGS, host
from insenv.fmu.running import flattened
from insenv.fmu.subject import Subject, subject
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows

ESTIMATOR, SCENARIO = "qakf-improved", "ship-swaying"
DURATION_S = 100.0
REPETITIONS = 9


def c_host() -> Figure:
    """A step of fmu/examples/host.c; the floor is the compiled loop of the model over the same inputs with all outputs."""
    columns, interval = _columns()
    estimator = subject(ESTIMATOR, {})
    rows = input_rows(estimator.model, columns, len(columns["dt"]))
    with _folder() as folder:
        hosted, bare = _hosted(folder, _exported(folder), columns, interval, estimator, rows)
    value, floor = statistics.median(hosted), statistics.median(bare)
    note = f"{ESTIMATOR}, C host, FMI 2, {value / floor:.2f} x the floor: the bare model in a C loop"
    return Figure(value, floor, len(hosted), note)


def loop() -> Figure:
    """A step of plant and estimator in one FMU in the C host; the floor is the compiled loop of both as one model."""
    both = subject(SCENARIO, {}, ESTIMATOR)
    steps = round(DURATION_S / both.sample_interval)
    with _folder() as folder:
        fmu = export_fmu(SCENARIO, folder / "loop.fmu", estimator=ESTIMATOR)
        rows = np.zeros((steps, both.model.inputs.size))
        hosted, bare = _hosted(folder, fmu, {}, both.sample_interval, both, rows)
    value, floor = statistics.median(hosted), statistics.median(bare)
    note = f"{ESTIMATOR} and {SCENARIO} in one FMU, C host, {value / floor:.2f} x the floor: the bare model of both in a C loop"
    return Figure(value, floor, len(hosted), note)


def fmpy() -> Figure:
    """A step of `insenv.fmu.run`; the floor is the bare model in a C loop."""
    columns, interval = _columns()
    with _folder() as folder:
        value = _step_time(_exported(folder), columns, interval)
    other = _pythonfmu()
    peer = None if other is None else (f"PythonFMU {version('pythonfmu')}", other)
    note = f"{ESTIMATOR}, insenv.fmu.run over FMPy, FMI 2; floor: the bare model in a C loop"
    return Figure(value, _floor(), REPETITIONS, note, peer)


def pythonfmu() -> Figure:
    """A step of PythonFMU with the same estimator, whose native runner is called from Python, in the same loop."""
    value = _pythonfmu()
    missing = "" if value is not None else f"; not installed: {install_extra('bench')}"
    note = f"{ESTIMATOR} in Python, by the same loop{missing}"
    return Figure(float("nan") if value is None else value, _floor(), REPETITIONS, note)


def _floor() -> float:
    """Time of a sample of the estimator in the compiled loop of its model, us."""
    columns, _ = _columns()
    estimator = subject(ESTIMATOR, {})
    return statistics.median(_bare(estimator, input_rows(estimator.model, columns, len(columns["dt"]))))


def ssp() -> Figure:
    """A step of `insenv.fmu.run_ssp`: plant, then estimator; the floor is the bare model of both in a C loop."""
    both = subject(SCENARIO, {}, ESTIMATOR)
    with _folder() as folder:
        export_ssp(SCENARIO, ESTIMATOR, folder / "loop.ssp")
        taken: dict[str, list[float]] = {"native": [], "interpreter": []}
        floors = []
        for _ in range(REPETITIONS):  # alternately, so that all run under the same load
            for backend, times in taken.items():
                times.append(_ssp_step_time(folder / "loop.ssp", backend))
            floors += _bare(both, np.zeros((round(DURATION_S / both.sample_interval), both.model.inputs.size)))
    note = f"{ESTIMATOR} and {SCENARIO}, insenv.fmu.run_ssp, FMI 2, all outputs; floor: the bare model of both in a C loop"
    value, python = (statistics.median(times) for times in taken.values())
    return Figure(value, statistics.median(floors), REPETITIONS, note, ("the same in Python", python))


def export_time() -> Figure:
    """Export for this machine with the library in the cache; the floor is the C compiler on an empty file."""
    compiler = _compiler("fmu.export")
    with _folder() as folder:
        taken = []
        for _ in range(4):
            begin = time.perf_counter()
            _exported(folder)
            taken.append(time.perf_counter() - begin)
        (folder / "empty.c").write_text("int nothing;\n")
        begin = time.perf_counter()
        command = [*compiler.command, "-shared", "-fPIC", str(folder / "empty.c"), "-o", str(folder / "empty.so")]
        subprocess.run(command, check=True, capture_output=True)
        floor = time.perf_counter() - begin
    note = f"{ESTIMATOR}, this platform, warm; floor: compiling an empty file"
    return Figure(statistics.median(taken[1:]), floor, 3, note)


def size() -> Figure:
    """Size of the FMU for all five platforms, MB; the floor is the FMU for this machine."""
    platforms = ("host",) if find_spec("ziglang") is None else ("all",)
    with _folder() as folder:
        value = export_fmu(ESTIMATOR, folder / "all.fmu", platforms=platforms).stat().st_size
        floor = _exported(folder).stat().st_size
    what = "five platforms" if platforms == ("all",) else "one platform: ziglang is not installed"
    return Figure(value / 1e6, floor / 1e6, 1, f"{ESTIMATOR}, {what}; floor: this platform alone")


def _compiler(name: str) -> Compiler:
    compiler = find_compiler()
    if compiler is None:
        raise InsenvError(f"{name}: no C compiler found")
    return compiler


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="insenv-bench-") as name:
        yield Path(name).resolve()


def _exported(folder: Path) -> Path:
    return export_fmu(ESTIMATOR, folder / "host.fmu")


@lru_cache
def _columns() -> tuple[dict[str, Array], float]:
    """The measurements of the ship's sensors by name, and the sample interval, s."""
    plant = build(load(SCENARIO), duration_s=DURATION_S)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns = {name: np.array(shown[name]) for name in ("delta_angle", "delta_velocity")}
    return {**columns, "dt": np.full(plant.samples, plant.sample_interval)}, plant.sample_interval


def _bare(of: Subject, rows: Array) -> list[float]:
    """Time of a sample in the compiled loop of the model, us, of several runs; compiled with the flags of the FMU.

    rows: (samples, inputs).
    """
    model, count, compiler = of.model, len(rows), _compiler("fmu.c-host")
    portable = Compiler(compiler.command, (*FLAGS, *host().further))
    library = load_library(str(compile_library(native_source(model), portable)))
    rows, taken = np.ascontiguousarray(rows), []
    p, x = np.array(of.parameters), np.zeros(model.state.size)
    y = np.empty((count, model.outputs.size))
    for _ in range(6):
        library.insenv_start(1, pointer(p), pointer(x))
        begin = time.process_time()
        library.insenv_run(1, pointer(p), pointer(x), pointer(rows), rows.shape[1], 0, pointer(y), 0, 1, count)
        taken.append((time.process_time() - begin) / count * 1e6)
    return taken[1:]


def _hosted(
    folder: Path, fmu: Path, columns: dict[str, Array], interval: float, of: Subject, rows: Array
) -> tuple[list[float], list[float]]:
    """Times of a step in the C host and in the bare loop of the model, us, of several runs."""
    host, table = _host(folder), folder / "input.csv"
    with ZipFile(fmu) as archive:
        archive.extractall(folder / "fmu")
    _write(table, columns, len(rows), interval)
    command = [str(host), str(folder / "fmu"), str(table), repr(interval), str(folder / "out.csv"), "6"]
    hosted, bare = [], []
    for _ in range(REPETITIONS):  # alternately, so that both run under the same load
        printed = subprocess.run(command, capture_output=True, text=True, check=True).stderr
        hosted += [float(us) for us in re.findall(r"([\d.]+) us a step", printed)[1:]]  # the first run warms the caches
        bare += _bare(of, rows)
    return hosted, bare


def _step_time(fmu: Path, columns: dict[str, Array], interval: float) -> float:
    """Processor time of a step of `insenv.fmu.run`, us."""
    runs = [_processor_time(partial(run, fmu, columns, step=interval)) for _ in range(REPETITIONS)]
    return statistics.median(runs)


def _ssp_step_time(path: Path, backend: str) -> float:
    """Processor time of a step of `insenv.fmu.run_ssp`, us."""
    return _processor_time(partial(run_ssp, path, stop_time=DURATION_S, backend=backend))


def _processor_time(steps: Callable[..., object]) -> float:
    """Processor time of a step, us, without loading and the first step; steps: makes them, and takes `progress`."""
    marks: list[tuple[int, float]] = []
    steps(progress=lambda done, _: marks.append((done, time.process_time())))
    (first, begin), (last, end) = marks[0], marks[-1]
    return (end - begin) / (last - first) * 1e6


def _host(folder: Path) -> Path:
    """The compiled C host."""
    compiler = _compiler("fmu.c-host")
    source, binary = fmu_folder() / "examples" / "host.c", folder / "host"
    libraries = () if sys.platform == "win32" else ("-ldl", "-lm")
    command = [*compiler.command, "-std=c99", "-O2", str(source), "-o", str(binary), *libraries]
    subprocess.run(command, check=True, capture_output=True)
    return binary


def _write(path: Path, columns: dict[str, Array], steps: int, interval: float) -> None:
    flat = flattened(columns)
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *flat])
        values = np.array(list(flat.values())).reshape(len(flat), steps).T.tolist()
        writer.writerows([repr(k * interval), *map(repr, row)] for k, row in enumerate(values))


@lru_cache
def _pythonfmu() -> float | None:
    """Time of a step of the same estimator as a PythonFMU, us; None if PythonFMU is not installed."""
    try:
        version("pythonfmu")
        from pythonfmu.builder import FmuBuilder
    except (ImportError, PackageNotFoundError):
        return None
    columns, interval = _columns()
    before, paths = os.environ.get("INSENV_SLAVE"), list(sys.path)
    os.environ["INSENV_SLAVE"] = json.dumps({"id": ESTIMATOR, "parameters": subject(ESTIMATOR, {}).parameters.tolist()})
    try:
        with _folder() as folder:
            script = folder / "peer.py"  # the builder puts its folder on sys.path
            script.write_bytes(Path(__file__).with_name("pythonfmu_slave.py").read_bytes())
            fmu = FmuBuilder.build_FMU(script, folder / "peer.fmu")
            return _step_time(fmu, columns, interval)
    finally:
        sys.path[:] = paths
        if before is None:
            del os.environ["INSENV_SLAVE"]
        else:
            os.environ["INSENV_SLAVE"] = before
