"""Speed of one filter update of the large-misalignment estimators."""

from __future__ import annotations

import statistics
import time

from insenv.bench.figures import Figure
from insenv.bench.speed import EMPTY
from insenv.core.runner import make_runner
from insenv.reproduce import update_time


def sukf() -> Figure:
    """Time update and fix of `aqe-sukf`."""
    return _figure("step.aqe-sukf.update", "aqe-sukf", update_time.SUKF, "time update and fix")


def lssvm() -> Figure:
    """All that `lssvm` does with a fix: differences, inputs, answer."""
    return _figure("step.lssvm.update", "lssvm", update_time.LSSVM, "differences, inputs and answer")


def lssvm_infer() -> Figure:
    """The answer of the `lssvm` machine, fed back."""
    return _figure("step.lssvm.infer", "lssvm", update_time.INFER, "answer of the machine, fed back")


def _figure(name: str, id: str, steps: tuple[str, ...], note: str) -> Figure:
    """The floor is an empty model's loop."""
    value = update_time.microseconds(id, steps)
    empty, idle = make_runner(EMPTY), []
    for _ in range(update_time.REPETITIONS):
        begin = time.process_time()
        empty.run(update_time.UPDATES, every=0)
        idle.append(time.process_time() - begin)
    floor = statistics.median(idle) / update_time.UPDATES * 1e6
    return Figure(name, value, "us", floor, update_time.REPETITIONS, f"{note}; {update_time.UPDATES} times over")
