"""Speed of composed filters: a sample along a drive with fixes, and a row of a batch without."""

from __future__ import annotations

import statistics

import numpy as np

from insenv.bench import peers
from insenv.bench.figure import EMPTY, Figure, empty_loop, median_time
from insenv.core.batch import make_batch
from insenv.estimators import Estimator
from insenv.estimators.fusion import fusion
from insenv.geodesy import NOMINAL_GRAVITY
from insenv.runs.simulated import run

SCENARIO = "car-survey"
DURATION_S = 120.0
REPETITIONS = 5
ROWS, SAMPLES = 1024, 100
STATES = {15: (), 21: ("gyro_scale", "accel_scale")}
"""Error states beside the biases, by the number of all states."""


def filter_of(size: int) -> Estimator:
    """The filter with `size` states, GNSS and zero velocity."""
    return fusion(STATES[size], ("gnss", "zero_velocity"), f"fusion-{size}")


def step(size: int) -> Figure:
    """One inertial sample on the survey drive, in the native loop, outputs at the recorded times; peer: pyins without fixes."""
    reports = [run(SCENARIO, filter_of(size), duration_s=DURATION_S) for _ in range(REPETITIONS)]
    samples = reports[0].imu_samples
    value = statistics.median(report.results[0].us_per_sample for report in reports)
    peer = peers.feedback_filter(0.05, scales=size == 21)
    note = f"{SCENARIO}, {samples} samples with fixes, covariance every 0.05 s"
    return Figure(f"step.fusion-{size}", value, "us", empty_loop(samples, REPETITIONS), REPETITIONS, note, peer)


def batch(size: int) -> Figure:
    """One inertial sample of a row of a batch at rest without fixes, on one core."""
    model = filter_of(size).model
    rows, empty = make_batch(model, ROWS, threads=1), make_batch(EMPTY, ROWS, threads=1)
    inputs: np.ndarray = model.inputs.pack({"delta_velocity": (0.0, 0.0, -NOMINAL_GRAVITY * 0.005), "dt": 0.005})
    value = median_time(lambda: rows.run(SAMPLES, inputs), REPETITIONS) / (ROWS * SAMPLES) * 1e9
    floor = median_time(lambda: empty.run(SAMPLES), REPETITIONS) / (ROWS * SAMPLES) * 1e9
    note = f"{ROWS} rows, one core, {getattr(rows, 'lanes', 1)} lanes; 200 Hz, covariance every 0.05 s"
    return Figure(f"batch.fusion-{size}", value, "ns", floor, REPETITIONS, note)
