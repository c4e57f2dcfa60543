"""The list of figures."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from insenv.base.errors import InputError
from insenv.base.installing import is_installed
from insenv.bench.figure import Figure


def figures(only: str | None = None) -> Iterator[Figure]:
    """Measure the figures whose names start with `only` (all if None), one after another.

    Raises `InputError` if there is no such figure.
    """
    known = _measurements()
    chosen = {name: measure for name, measure in known.items() if only is None or name.startswith(only)}
    if not chosen:
        raise InputError(f"no figure starts with {only!r} (allowed: {', '.join(known)})")
    for measure in chosen.values():
        yield measure()


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


def machine_line(found: Mapping[str, str | int]) -> str:
    """What `machine` returned in one line."""
    words = {"cores": "1 core" if found["cores"] == 1 else "{} cores", "python": "Python {}", "compilers": "compilers: {}"}
    return ", ".join(words.get(name, "{}").format(value) for name, value in found.items())


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor())


def _measurements() -> dict[str, Callable[[], Figure]]:
    # here, so that `python -m insenv.bench.lockstep` starts without loading every measurement
    from insenv.bench import composed, envs, estimators, fmu, lockstep, mavlink, numeric, page_machine, speed, truth
    from insenv.estimators import registered

    stepped = [e.id for e in registered().values() if not e.smooths]
    return {
        "native.propagate15": lambda: speed.single("native", 0.05),
        "native.propagate15-each": lambda: speed.single("native", 0.0),
        "interpreter.propagate15": lambda: speed.single("interpreter", 0.05),
        "interpreter.propagate15-each": lambda: speed.single("interpreter", 0.0),
        "batch.propagate15": lambda: speed.batch(0.05),
        "batch.propagate15-each": lambda: speed.batch(0.0),
        "batch.fusion-21": lambda: composed.batch(21),
        "numeric.one": numeric.one,
        "numeric.many": numeric.many,
        "truth.drift.ship": lambda: truth.drift("ship"),
        "truth.drift.car": lambda: truth.drift("car"),
        "truth.drift.aircraft": lambda: truth.drift("aircraft"),
        "smoother.flight": estimators.flight,
        "env.single": envs.single,
        "env.hundred": envs.hundred,
        "vector.plant": envs.plant,
        "vector.small": envs.small,
        "vector.reset.ship": lambda: envs.resetting("ship", envs.ID),
        "vector.reset.tuning": lambda: envs.resetting("tuning", "insenv/Tuning-v0"),
        "vector.reset.manoeuvre": lambda: envs.resetting("manoeuvre", "insenv/Manoeuvre-v0"),
        "vector.q-method": envs.q_method,
        "vector.make": envs.making,
        "campaign.q-method": estimators.campaign,
        "fmu.c-host": fmu.c_host,
        "fmu.loop": fmu.loop,
        "fmu.fmpy": fmu.fmpy,
        "fmu.pythonfmu": fmu.pythonfmu,
        "fmu.ssp": fmu.ssp,
        "fmu.export": fmu.export_time,
        "fmu.size": fmu.size,
        "mavlink.message": mavlink.message,
        "mavlink.rate": mavlink.rate,
        "mavlink.lateness.p99": mavlink.lateness,
        "mavlink.cpu": mavlink.cpu,
        "mavlink.lockstep": lockstep.px4,
        "import.insenv": speed.import_time,
        "start.help": lambda: speed.start("help", "--help"),
        "start.list": lambda: speed.start("list", "list"),
        "start.run": lambda: speed.start("run", "run", "ship-swaying"),
        "first.run.ship": lambda: speed.first_run("ship", "ship-swaying"),
        "first.run.car": lambda: speed.first_run("car", "car-city-drive", "-e", "loosely-coupled"),
        **{f"step.{id}": partial(estimators.step, id) for id in stepped},
        "step.fusion-15": lambda: composed.step(15),
        "step.fusion-21": lambda: composed.step(21),
        "step.aqe-sukf.update": estimators.sukf,
        "step.lssvm.update": estimators.lssvm,
        "step.lssvm.infer": estimators.lssvm_infer,
        **(
            {"web.samples": page_machine.samples, "web.size": page_machine.size}
            if all(map(is_installed, ("wasmtime", "ziglang")))
            else {}
        ),
    }
