"""The list of figures and what a figure is."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from insenv.errors import InputError


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    name; value in unit; floor: the same for no work, in the same unit; n: repetitions (or samples) it rests on; note: what
    it is. peer: another package measured in the same run, (name, value), where it is installed.
    """

    name: str
    value: float
    unit: str
    floor: float
    n: int
    note: str = ""
    peer: tuple[str, float] | None = None


def figures(only: str | None = None) -> Iterator[Figure]:
    """Measure the figures whose names start with `only` (all if None), one after the other.

    Raises `InputError` if there is none.
    """
    known = _measurements()
    chosen = {name: measure for name, measure in known.items() if only is None or name.startswith(only)}
    if not chosen:
        raise InputError(f"no figure starts with {only!r} (allowed: {', '.join(known)})")
    for measure in chosen.values():
        yield measure()


def machine() -> dict[str, str | int]:
    """What the figures were measured on."""
    from insenv.core.compile import find_compiler

    compilers = [compiler.command[0]] if (compiler := find_compiler()) else []
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compilers": ", ".join(compilers) or "none",
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.processor())


def _measurements() -> dict[str, Callable[[], Figure]]:
    from insenv.bench import campaign, envs, fmu, lockstep, mavlink, smoothing, speed, step, truth, update
    from insenv.estimators import registered

    stepped = [e.id for e in registered().values() if not e.smooths]
    return {
        "native.propagate15": lambda: speed.single("native", 0.05),
        "native.propagate15-each": lambda: speed.single("native", 0.0),
        "interpreter.propagate15": lambda: speed.single("interpreter", 0.05),
        "interpreter.propagate15-each": lambda: speed.single("interpreter", 0.0),
        "batch.propagate15": lambda: speed.batch(0.05),
        "batch.propagate15-each": lambda: speed.batch(0.0),
        "truth.drift.ship": lambda: truth.drift("ship"),
        "truth.drift.car": lambda: truth.drift("car"),
        "truth.drift.aircraft": lambda: truth.drift("aircraft"),
        "smoother.flight": smoothing.flight,
        "env.single": envs.single,
        "env.hundred": envs.hundred,
        "vector.plant": envs.plant,
        "vector.q-method": envs.q_method,
        "vector.make": envs.making,
        "campaign.q-method": campaign.q_method,
        "fmu.c-host": fmu.c_host,
        "fmu.fmpy": fmu.fmpy,
        "fmu.pythonfmu": fmu.pythonfmu,
        "fmu.export": fmu.export_time,
        "fmu.size": fmu.size,
        "mavlink.message": mavlink.message,
        "mavlink.rate": mavlink.rate,
        "mavlink.lateness.p99": mavlink.lateness,
        "mavlink.cpu": mavlink.cpu,
        "mavlink.lockstep": lockstep.px4,
        "import.insenv": speed.import_time,
        **{f"step.{id}": partial(step.step, id) for id in stepped},
        "step.aqe-sukf.update": update.sukf,
        "step.lssvm.update": update.lssvm,
        "step.lssvm.infer": update.lssvm_infer,
    }
