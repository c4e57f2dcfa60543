"""A figure; the empty model whose cost is the floor of many figures; median times."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    value: in `unit`.  floor: the same without the work itself, in `unit`.  n: number of repetitions or samples.
    note: what was measured.  peer: name and value of another package measured in the same run, if it is installed.
    name, unit: those of the table of figures, which `figures` fills in.
    """

    value: float
    floor: float
    n: int
    note: str = ""
    peer: tuple[str, float] | None = None
    name: str = ""
    unit: str = ""

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        row = {name: getattr(self, name) for name in ("name", "value", "unit", "floor", "n", "note")}
        return row if self.peer is None else {**row, "peer": dict(zip(("name", "value"), self.peer, strict=True))}


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
"""A model without work: its cost is that of the runner alone."""


def empty_loop(samples: int, repetitions: int) -> float:
    """Median processor time of a sample in the native loop of the empty model, us."""
    runner, taken = make_runner(EMPTY), []
    for _ in range(repetitions):
        begin = time.process_time()
        runner.run(samples, every=0)
        taken.append(time.process_time() - begin)
    return statistics.median(taken) / samples * 1e6


def median_time(call: Callable[[], object], repetitions: int, count: int = 1) -> float:
    """Median wall-clock time of a call, s, over repetitions of `count` calls, after one call to warm up."""
    call()
    taken = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        for _ in range(count):
            call()
        taken.append((time.perf_counter() - begin) / count)
    return statistics.median(taken)
