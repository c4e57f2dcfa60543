"""Speed of estimators in whole runs: a sample along a run, one update, a smoothed flight, a campaign."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from insenv.bench import peers
from insenv.bench.figure import EMPTY, Figure, empty_loop, median_time
from insenv.bench.speed import batch_at_rest
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.estimators import Estimator, get
from insenv.estimators.fusion import fusion
from insenv.reproduce import large_misalignment as paper
from insenv.runs.simulated import run
from insenv.runs.smoothed import Smoother
from insenv.scenario import build, load
from insenv.scenario.inputs import chunks, input_rows, recording_interval
from insenv.studies.campaign import make_plan, run_campaign
from insenv.studies.campaign.running import cores

REPETITIONS = 5
DURATION_S = 120.0
BLOCKS_PER_CORE = 2
CAMPAIGNS = 3  # repetitions


def scenario_of(estimator: Estimator) -> str:
    """The scenario that one sample of an estimator is measured on."""
    if estimator.navigates:
        return "car-city-drive"
    if estimator.motion == "moving":
        return "car-unknown-heading"
    return "large-misalignment" if estimator.aided else "car-parked"


def step(id: str) -> Figure:
    """One inertial sample of an estimator on a scenario that suits it, in the native loop, outputs at the recorded times."""
    name = scenario_of(get(id))
    return _sampled(name, id, f"{name}, {{}} samples")


def _sampled(name: str, estimator: str | Estimator, note: str, peer: peers.Peer | None = None) -> Figure:
    """The time that a sample of a run takes; note: with a place for the number of samples."""
    reports = [run(name, estimator, duration_s=DURATION_S) for _ in range(REPETITIONS)]
    samples = reports[0].imu_samples
    value = statistics.median(report.results[0].us_per_sample for report in reports)
    return Figure(value, empty_loop(samples, REPETITIONS), REPETITIONS, note.format(samples), peer)


UPDATES = {
    "step.aqe-sukf.update": ("aqe-sukf", paper.SUKF_STEPS, "time update and fix"),
    "step.lssvm.update": ("lssvm", paper.LSSVM_STEPS, "differences, inputs and answer"),
    "step.lssvm.infer": ("lssvm", paper.INFER_STEPS, "answer of the machine, fed back"),
}
"""By name of a figure, an estimator, its steps that run with a fix, and what they do."""


def update(name: str) -> Figure:
    """One update of `UPDATES`."""
    id, steps, note = UPDATES[name]
    floor = empty_loop(paper.UPDATES, paper.REPETITIONS)
    value = paper.microseconds(id, steps)
    return Figure(value, floor, paper.REPETITIONS, f"{note}; {paper.UPDATES} times")


def flight() -> Figure:
    """`aircraft-survey`, 7200 s at 200 Hz, through the smoother, forward and backward; the floor is the filter alone."""
    plant = build(load("aircraft-survey"))
    parameters = get("smoother").parameters(plant.knowledge)
    every = recording_interval(plant.samples)
    simulator = make_runner(plant.model, plant.parameters)
    smoother, alone = Smoother(parameters), make_runner(get("loosely-coupled").model, parameters)
    taken, floor = 0.0, 0.0
    for _, count in chunks(plant.samples, every):
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
    note = f"2 h at 200 Hz, covariance every 0.05 s, one fix per second; record of {smoother.record.size / 1e6:.0f} MB"
    return Figure(taken, floor, 1, note)


def campaign() -> Figure:
    """`ship-swaying` with `q-method`, 600 s at 200 Hz, on all cores, from planning to the summary.

    It has the shape of a campaign of 10,000 runs, with fewer runs.  The floor is an empty model for as many rows and samples;
    the note gives the speed of the plant alone.
    """
    scenario, threads = load("ship-swaying"), cores()
    plan = make_plan(scenario, "q-method", 1, duration_s=600.0)
    runs = BLOCKS_PER_CORE * threads * (plan.block_samples // plan.samples // 8 * 8)
    samples = runs * plan.samples
    plant = make_batch(plan.plant.model, runs, plan.plant.parameters, threads=threads)
    empty = make_batch(EMPTY, runs, threads=threads)
    works: tuple[Callable[[], object], ...] = (
        lambda: run_campaign(make_plan(scenario, "q-method", runs, duration_s=600.0)),
        lambda: plant.run(plan.samples),
        lambda: empty.run(plan.samples),
    )
    value, alone, floor = (samples / median_time(work, CAMPAIGNS) for work in works)
    note = f"{runs} runs of 600 s at 200 Hz, {threads} cores; plant alone {alone:.3g}"
    return Figure(value, floor, CAMPAIGNS, note)


# Composed filters: a sample along a drive with fixes, and a row of a batch without.

DRIVE = "car-survey"
STATES = {15: (), 21: ("gyro_scale", "accel_scale")}
"""Error states beside the biases, by the number of all states."""


def filter_of(size: int) -> Estimator:
    """The filter with `size` states, GNSS and zero velocity."""
    return fusion(STATES[size], ("gnss", "zero_velocity"), f"fusion-{size}")


def composed_step(size: int) -> Figure:
    """One inertial sample on the survey drive, in the native loop, outputs at the recorded times; peer: pyins without fixes."""
    peer = peers.feedback_filter(0.05, scales=size == 21)
    return _sampled(DRIVE, filter_of(size), f"{DRIVE}, {{}} samples with fixes, covariance every 0.05 s", peer)


def composed_batch(size: int) -> Figure:
    """One inertial sample of a row of a batch at rest without fixes, on one core."""
    return batch_at_rest(filter_of(size).model, {}, REPETITIONS, "200 Hz, covariance every 0.05 s")
