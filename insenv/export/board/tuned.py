"""What an export needs of an estimator: its equations and parameters on a scenario or a log, and the samples of that run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from insenv.base.errors import InputError
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Vector
from insenv.estimators import Estimator, get
from insenv.estimators.settings import Settings, setting_rows
from insenv.logs import RecordedLog
from insenv.logs.loading import is_log
from insenv.runs.replayed import prepared
from insenv.scenario import USUAL, ScenarioLike, build, load
from insenv.scenario.inputs import RECORDS, chunks, input_rows, recording_interval, sample_columns


class Running(Protocol):
    """A filter that runs, at its start."""

    def output(self) -> Vector:
        """The outputs (outputs.size,) of the current state."""

    def run(self, n: int, inputs: Array, every: int = 1, /) -> Array:
        """Take n samples (n, inputs.size); outputs (n // every, outputs.size) after every `every`-th."""


@dataclass(frozen=True, eq=False)
class Tuned:
    """An estimator as it runs on a scenario or a log.

    parameters: flat, SI.  dt: shortest and longest length of a sample (s) that the filter takes.  values_from: a sentence that
    says where the parameters come from.  samples, every: their number in the run, and from one recorded output to the next.
    inputs: gives the input rows of the run, in parts of (count, inputs.size).
    """

    estimator: Estimator
    parameters: Vector
    dt: tuple[float, float]
    values_from: str
    samples: int
    every: int
    inputs: Callable[[], Iterator[Array]]

    def runner(self) -> Running:
        """The filter at its start, as insenv runs it."""
        return make_runner(self.estimator.model, self.parameters)

    def first(self, count: int, runner: Running) -> tuple[Array, Array, Array]:
        """Inputs (count, inputs.size) of the first samples, outputs (outputs.size,) at the start, and after each of them."""
        inputs = next(self.inputs())[:count]
        begin = runner.output()
        return inputs, begin, runner.run(len(inputs), inputs)

    def run(self, runner: Running) -> Iterator[tuple[Array, Array]]:
        """The whole run: inputs and, after each `every` of them, outputs; in parts."""
        for part in self.inputs():
            yield part, runner.run(len(part), part, self.every)


def tuned(
    estimator: Estimator | str,
    source: ScenarioLike | RecordedLog | None = None,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    start: str | None = None,
) -> Tuned:
    """The estimator as `insenv run` or `insenv replay` runs it; arguments and errors are those of `export_c`."""
    family = get(estimator)
    if family.smooths:
        raise InputError(f"estimator {family.id!r} smooths: a microcontroller knows no future; allowed is a filter")
    if isinstance(source, RecordedLog) or is_log(source):
        for name, value in (("seed", seed), ("duration_s", duration_s)):
            if value is not None:
                raise InputError(f"{name} = {value!r}: allowed with a scenario; a log is used as it is")
        return _on_log(family, source, settings, start or "coarse")
    if start is not None:
        raise InputError(f"start = {start!r}: allowed with a log; a scenario states its start in [start] and [knowledge]")
    return _on_scenario(family, USUAL[family.kind] if source is None else source, seed, duration_s, settings)


def _on_scenario(
    family: Estimator, source: ScenarioLike, seed: int | None, duration_s: float | None, settings: Settings | None
) -> Tuned:
    scenario = load(source)
    plant = build(scenario, seed=seed, duration_s=duration_s, driven=True)
    rows = setting_rows(settings, [family])[family.id]
    estimator = plant.adapted(family, settings)
    parameters = estimator.model.parameters.pack(plant.parameters_of(estimator, rows))
    every = recording_interval(plant.samples)
    total = plant.samples // every * every

    def inputs() -> Iterator[Array]:
        runner = make_runner(plant.model, plant.parameters)
        for begin, count in chunks(total, every):
            outputs = runner.run(count, plant.inputs(begin, count))
            yield input_rows(estimator.model, sample_columns(plant.model, outputs, plant.sample_interval)[0], count)

    origin = f"The values of {family.id} in the scenario {scenario.name}, seed {plant.seed}"
    return Tuned(estimator, parameters, _around(plant.sample_interval), _said(origin, settings), total, every, inputs)


def _on_log(family: Estimator, source: str | Path | RecordedLog, settings: Settings | None, start: str) -> Tuned:
    ready = prepared(source, family, settings=settings, start=start)
    (estimator,), (begun,) = ready.chosen, ready.starts
    rows = ready.parameter_rows[estimator.id]
    parameters = estimator.model.parameters.pack(estimator.parameters(begun.knowledge, rows=rows))
    lengths = ready.log.dt[ready.first :]
    every = recording_interval(len(lengths), 10 * RECORDS)
    total = len(lengths) // every * every

    def inputs() -> Iterator[Array]:
        for begin, count in chunks(total, every):
            part = {name: column[begin : begin + count] for name, column in ready.columns.items()}
            yield input_rows(estimator.model, part, count)

    shortest, longest = _around(float(np.median(lengths)))
    dt = min(shortest, float(lengths.min())), max(longest, float(lengths.max()))
    origin = f"The values of {family.id} on the log {ready.log.description.title}"
    return Tuned(estimator, parameters, dt, _said(origin, settings), total, every, inputs)


def _around(interval: float) -> tuple[float, float]:
    """Half and twice the sample interval (s): what lies outside is a lost or doubled sample."""
    return 0.5 * interval, 2.0 * interval


def _said(origin: str, settings: Settings | None) -> str:
    return f"{origin}, with {', '.join(settings)} as set at the export." if settings else f"{origin}."
