"""The list of figures."""

from __future__ import annotations

import os
import platform
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from insenv.base.errors import InputError, nearest
from insenv.base.installing import is_installed
from insenv.base.output import WIDTH
from insenv.bench.figure import Figure
from insenv.report.document import Block, Document, Line, Listing
from insenv.report.tables import number


def figures(only: str | None = None) -> Iterator[Figure]:
    """Measure the figures whose names start with `only` (all if None), one after another.

    Raises `InputError` if there is no such figure.
    """
    known = _measurements()
    chosen = {name: entry for name, entry in known.items() if only is None or name.startswith(only)}
    if not chosen:
        groups = dict.fromkeys(name.partition(".")[0] for name in known)
        raise InputError(f"no figure starts with {only!r}{nearest(str(only), groups)}")
    for name, (unit, measure) in chosen.items():
        yield replace(measure(), name=name, unit=unit)


def machine() -> dict[str, str | int]:
    """The machine that the figures are measured on."""
    from insenv.core.compile import find_compiler

    compilers = [compiler.command[0]] if (compiler := find_compiler()) else []
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compilers": ", ".join(compilers) or "none",
    }


def machine_line(machine: Mapping[str, str | int]) -> str:
    """What `machine` returned in one line."""
    words = {"cores": "1 core" if machine["cores"] == 1 else "{} cores", "python": "Python {}", "compilers": "compilers: {}"}
    return ", ".join(words.get(name, "{}").format(value) for name, value in machine.items())


def document(measured: Sequence[Figure]) -> Document:
    """What is printed of figures."""
    rows = [figure.as_json() for figure in measured]
    return Document("bench", {"machine": machine(), "figures": rows}, partial(_blocks, measured))


def _blocks(measured: Sequence[Figure]) -> Iterator[Block]:
    rows = [(f.name, number(f.value), number(f.floor), f.unit, str(f.n), _what(f)) for f in measured]
    yield Listing(("figure", "value", "floor", "unit", "n", "what"), rows, right=(1, 2, 4))
    yield Line()
    yield Line("floor: the same without the work itself (an empty model, a warm start)")
    for line in textwrap.wrap(f"machine: {machine_line(machine())}", WIDTH, subsequent_indent="  "):
        yield Line(line)


def _what(figure: Figure) -> str:
    return figure.note + ("" if figure.peer is None else f"; {figure.peer[0]}: {number(figure.peer[1])} {figure.unit}")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor())


def _measurements() -> dict[str, tuple[str, Callable[[], Figure]]]:
    """By name of a figure, its unit and how it is measured."""
    # here, so that `python -m insenv.bench.mavlink` starts without loading every measurement
    from insenv.bench import envs, estimators, fmu, mavlink, page_machine, speed, truth
    from insenv.estimators import registered

    stepped = [e.id for e in registered().values() if not e.smooths]
    table: dict[str, tuple[str, Callable[[], Figure]]] = {
        "native.propagate15": ("us", lambda: speed.single("native", 0.05)),
        "native.propagate15-each": ("us", lambda: speed.single("native", 0.0)),
        "interpreter.propagate15": ("us", lambda: speed.single("interpreter", 0.05)),
        "interpreter.propagate15-each": ("us", lambda: speed.single("interpreter", 0.0)),
        "batch.propagate15": ("ns", lambda: speed.batch(0.05)),
        "batch.propagate15-each": ("ns", lambda: speed.batch(0.0)),
        "batch.fusion-21": ("ns", lambda: estimators.composed_batch(21)),
        "numeric.one": ("us", speed.one_row),
        "numeric.many": ("ns", speed.many_rows),
        **{f"truth.drift.{vehicle}": ("mm", partial(truth.drift, vehicle)) for vehicle in truth.SCENARIOS},
        "smoother.flight": ("s", estimators.flight),
        "env.single": ("steps/s", envs.single),
        "env.hundred": ("us", envs.hundred),
        "env.reset": ("us", envs.reset),
        "env.frame": ("ms", envs.frame),
        "vector.plant": ("samples/s", envs.plant),
        "vector.small": ("us", envs.small),
        "vector.reset.ship": ("us", lambda: envs.resetting(envs.ID)),
        "vector.reset.tuning": ("us", lambda: envs.resetting("insenv/Tuning-v0")),
        "vector.reset.manoeuvre": ("us", lambda: envs.resetting("insenv/Manoeuvre-v0")),
        "vector.q-method": ("samples/s", envs.q_method),
        "vector.make": ("s", envs.making),
        "campaign.q-method": ("samples/s", estimators.campaign),
        "fmu.c-host": ("us", fmu.c_host),
        "fmu.loop": ("us", fmu.loop),
        "fmu.fmpy": ("us", fmu.fmpy),
        "fmu.pythonfmu": ("us", fmu.pythonfmu),
        "fmu.ssp": ("us", fmu.ssp),
        "fmu.export": ("s", fmu.export_time),
        "fmu.size": ("MB", fmu.size),
        "mavlink.message": ("us", mavlink.message),
        "mavlink.rate": ("Hz", mavlink.rate),
        "mavlink.lateness.p99": ("ms", mavlink.lateness),
        "mavlink.cpu": ("%", mavlink.cpu),
        "mavlink.lockstep": ("x", mavlink.lockstep),
        "import.insenv": ("s", speed.import_time),
        "start.help": ("x", lambda: speed.start("--help")),
        "start.list": ("x", lambda: speed.start("list")),
        "start.run": ("x", lambda: speed.start("run", "ship-swaying")),
        "first.run.ship": ("s", lambda: speed.first_run("ship-swaying")),
        "first.run.car": ("s", lambda: speed.first_run("car-city-drive", "-e", "loosely-coupled")),
        **{f"step.{id}": ("us", partial(estimators.step, id)) for id in stepped},
        "step.fusion-15": ("us", lambda: estimators.composed_step(15)),
        "step.fusion-21": ("us", lambda: estimators.composed_step(21)),
        **{name: ("us", partial(estimators.update, name)) for name in estimators.UPDATES},
    }
    if os.name == "posix" and is_installed("serial"):
        table |= {"mavlink.unit": ("ms", mavlink.unit)}
    if all(map(is_installed, ("wasmtime", "ziglang"))):
        table |= {"web.samples": ("ns", page_machine.samples), "web.size": ("kB", page_machine.size)}
    return table
