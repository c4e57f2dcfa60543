"""Run one block of a campaign, some tens of runs, in the batch core: a pure function of the plan on any machine."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from insenv.campaigns.model import measured_model
from insenv.campaigns.plan import Plan
from insenv.core.batch import Batch, make_batch
from insenv.errors import InputError
from insenv.estimators import Estimator
from insenv.scenario import Plant, reseeded

Arrays = dict[str, NDArray[np.float64]]
Stopped = Callable[[], bool]

PIECE_S = 0.5
"""Approximate time between two looks at whether the campaign was interrupted, s."""
FIRST_PIECE = 2000
"""Inertial samples of a block, all its runs together, before the first look: milliseconds to a tenth of a second."""


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
    estimator = plan.chosen
    measured = measured_model(plants[0].model, estimator)
    batch = make_batch(measured.model, len(plants), _parameters(plan, plants, estimator))
    shown = measured.model.outputs.unpack(_records(batch, plan, stopped))
    return {
        "seed": np.array(seeds, dtype=np.float64),
        "values": np.array([[v.value(seed) for v in plan.variations] for seed in seeds]).reshape(len(seeds), -1),
        **{name: np.ascontiguousarray(value) for name, value in shown.items()},
    }


def _records(batch: Batch, plan: Plan, stopped: Stopped) -> NDArray[np.float64]:
    """Return the outputs (runs, records, outputs.size), computed in pieces of about `PIECE_S`."""
    found, piece = [], max(1, FIRST_PIECE // batch.rows)
    for _ in range(plan.samples // plan.record_samples):
        left = plan.record_samples
        while left:
            if stopped():
                raise StoppedError
            now = min(piece, left)
            left -= now
            begun = perf_counter()
            shown = batch.run(now, every=0 if left else now)
            # pieces grow and shrink towards PIECE_S; the results do not depend on them
            piece = max(1, min(int(now * PIECE_S / max(perf_counter() - begun, 1e-6)), 4 * piece))
        found.append(shown)
    return np.concatenate(found, axis=1)


def _plants(plan: Plan, seeds: list[int], stopped: Stopped) -> list[Plant]:
    if not plan.variations:
        return reseeded(plan.plant, seeds)
    plants = []
    for seed in seeds:
        if stopped():
            raise StoppedError
        plants.append(plan.plant_of(seed))
    for plant in plants:
        if plant.model is not plan.plant.model:
            raise InputError(f"vary: in the run of seed {plant.seed} the parts of the plant differ from those of the first run")
    return plants


def _parameters(plan: Plan, plants: list[Plant], estimator: Estimator) -> NDArray[np.float64]:
    """Parameters of the campaign's model, one row per run."""
    model = plants[0].model
    place, one = model.parameters.slice("seed").start, model.parameters.pack(plants[0].parameters)
    own = estimator.model.parameters
    rows = []
    for plant in plants:
        if plan.variations:
            one = model.parameters.pack(plant.parameters)
        one[place] = plant.seed
        parts = [one, own.pack(plant.parameters_of(estimator))]
        parts.append(np.array([plan.evaluation_samples, plan.evaluations], dtype=np.float64))
        rows.append(np.concatenate(parts))
    return np.array(rows)
