"""Speed of a campaign: the shape of 10,000 runs of 600 s, with fewer runs."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from insenv.bench.figures import Figure
from insenv.bench.speed import EMPTY
from insenv.campaigns import make_plan, run_campaign
from insenv.campaigns.executors import cores
from insenv.core.batch import make_batch
from insenv.scenario import load

BLOCKS = 2  # for each core
REPETITIONS = 3


def q_method() -> Figure:
    """`ship-swaying` with `q-method`, 600 s at 200 Hz: whole runs, from planning to the summary, on all cores.

    The floor is an empty model for as many rows and samples; the note says what the plant alone comes to.
    """
    scenario, threads = load("ship-swaying"), cores()
    plan = make_plan(scenario, "q-method", 1, duration_s=600.0)
    runs = BLOCKS * threads * (plan.block_samples // plan.samples // 8 * 8)
    samples = runs * plan.samples

    def campaign() -> None:
        run_campaign(make_plan(scenario, "q-method", runs, duration_s=600.0))

    plant = make_batch(plan.plant.model, runs, plan.plant.parameters, threads=threads)
    empty = make_batch(EMPTY, runs, threads=threads)
    value, alone, floor = (
        samples / _median(work) for work in (campaign, lambda: plant.run(plan.samples), lambda: empty.run(plan.samples))
    )
    note = f"{runs} runs of 600 s at 200 Hz, {threads} cores; plant alone {alone:.3g}"
    return Figure("campaign.q-method", value, "samples/s", floor, REPETITIONS, note)


def _median(work: Callable[[], object]) -> float:
    """Median time, s; compiled before."""
    taken = []
    for _ in range(REPETITIONS + 1):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken[1:])
