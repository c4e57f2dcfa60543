"""Speed of every estimator along a run: microseconds an inertial sample, in the native loop, outputs at the recorded times."""

from __future__ import annotations

import statistics
import time

from insenv import estimators
from insenv.bench.figures import Figure
from insenv.bench.speed import EMPTY
from insenv.core.runner import make_runner
from insenv.runs.simulated import run
from insenv.scenario import load

REPETITIONS = 5
DURATION_S = 120.0
SCENARIOS = {
    ("alignment", False): "car-parked",
    ("alignment", True): "large-misalignment",
    ("navigation", False): "car-city-drive",
    ("navigation", True): "car-city-drive",
}
"""By kind of estimator, and whether it takes fixes."""


def step(id: str) -> Figure:
    """One estimator on the scenario of its kind; the floor is an empty model's loop over as many samples."""
    estimator = estimators.get(id)
    name = SCENARIOS[estimator.kind, estimator.aided]
    reports = [run(load(name), [id], duration_s=DURATION_S) for _ in range(REPETITIONS)]
    samples = reports[0].imu_samples
    value = statistics.median(report.results[0].us_per_sample for report in reports)
    empty, taken = make_runner(EMPTY), []
    for _ in range(REPETITIONS):
        begin = time.process_time()
        empty.run(samples, every=0)
        taken.append(time.process_time() - begin)
    return Figure(
        f"step.{id}", value, "us", statistics.median(taken) / samples * 1e6, REPETITIONS, f"{name}, {samples} samples"
    )
