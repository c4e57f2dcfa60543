"""Speed of the smoother: a flight of two hours, filtered and smoothed."""

from __future__ import annotations

import time

import numpy as np

from insenv.bench.figures import Figure
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.plant.feeding import input_rows
from insenv.runs.simulated import CHUNK, recording_interval
from insenv.runs.smoothed import Smoother
from insenv.scenario import build, load


def flight() -> Figure:
    """`aircraft-survey`, 7200 s at 200 Hz, through the smoother, forward and backward; the floor is the filter alone."""
    plant = build(load("aircraft-survey"))
    parameters = get("smoother").parameters(plant.knowledge)
    every = recording_interval(plant.samples)
    simulator = make_runner(plant.model, plant.parameters)
    smoother, alone = Smoother(parameters), make_runner(get("loosely-coupled").model, parameters)
    taken, floor = 0.0, 0.0
    chunk = CHUNK // every * every
    for start in range(0, plant.samples, chunk):
        count = min(chunk, plant.samples - start)
        columns = plant.model.outputs.unpack(simulator.run(count))
        columns["dt"] = np.full(count, plant.sample_interval)
        begin = time.perf_counter()
        smoother.take(columns, np.arange(1, count + 1) % every == 0)
        middle = time.perf_counter()
        alone.run(count, input_rows(alone.model, columns, count), every)
        taken, floor = taken + middle - begin, floor + time.perf_counter() - middle
    begin = time.perf_counter()
    smoother.smoothed()
    taken += time.perf_counter() - begin
    note = f"2 h at 200 Hz, covariance every 0.05 s, a fix a second; record of {smoother.record.size / 1e6:.0f} MB"
    return Figure("smoother.flight", taken, "s", floor, 1, note)
