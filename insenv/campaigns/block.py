"""Run one block of a campaign, some tens of runs, in the batch core: a pure function of the plan on any machine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from insenv.campaigns.pieces import in_pieces
from insenv.campaigns.plan import Plan
from insenv.core.batch import make_batch
from insenv.errors import InputError
from insenv.scenario import Plant

Arrays = dict[str, NDArray[np.float64]]
Stopped = Callable[[], bool]


class StoppedError(Exception):
    """The campaign of a block was interrupted."""


def run_block(plan: Plan, number: int, stopped: Stopped = lambda: False) -> Arrays:
    """Simulate and estimate the runs of block `number` and return their summaries, run by run.

    Arrays: `seed` (runs,); `values` (runs, variations); each output of `measured_model` (runs, records, ...). Raises
    `InputError` if the parts of the plant differ between runs, `StoppedError` soon after `stopped` returns true.
    """
    runs = plan.blocks[number]
    seeds = [plan.first_seed + run for run in runs]
    plants = _plants(plan, seeds, stopped)
    measured = plan.measured
    batch = make_batch(measured.model, len(plants), plan.parameters_of(plants))

    def look(done: int) -> None:
        if stopped():
            raise StoppedError

    records = plan.samples // plan.record_samples
    shown = measured.model.outputs.unpack(in_pieces(batch, records, plan.record_samples, look))
    return {
        "seed": np.array(seeds, dtype=np.float64),
        "values": np.array([[v.value(seed) for v in plan.variations] for seed in seeds]).reshape(len(seeds), -1),
        **{name: np.ascontiguousarray(value) for name, value in shown.items()},
    }


def _plants(plan: Plan, seeds: list[int], stopped: Stopped) -> list[Plant]:
    plants = []
    for plant in plan.plants(seeds):
        if stopped():
            raise StoppedError
        plants.append(plant)
    for plant in plants:
        if plant.model is not plan.plant.model:
            raise InputError(f"vary: in the run of seed {plant.seed} the parts of the plant differ from those of the first run")
    return plants
