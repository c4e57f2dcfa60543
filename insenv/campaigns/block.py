"""Run one block of a campaign, some tens of runs, in the batch core: a pure function of the plan on any machine."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from insenv.campaigns.parameters import known_values
from insenv.campaigns.plan import Plan
from insenv.core.batch import Batch, make_batch
from insenv.errors import InputError
from insenv.scenario import Plant

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

    Arrays: `seed` (runs,); `values` (runs, variations); each output of `measured_model` (runs, records, ...); `known`
    (runs, 4): latitude (rad), height (m) and the white noise of gyros and accelerometers that the estimator knows;
    `wander` (runs, 3), m: standard deviation of the correlated error of the fixes. Raises `InputError` if the parts of
    the plant differ between runs, `StoppedError` soon after `stopped` returns true.
    """
    runs = plan.blocks[number]
    seeds = [plan.first_seed + run for run in runs]
    plants = _plants(plan, seeds, stopped)
    measured = plan.measured
    batch = make_batch(measured.model, len(plants), plan.parameters_of(plants))
    shown = measured.model.outputs.unpack(_records(batch, plan, stopped))
    wander = [np.broadcast_to(np.asarray(plant.parameters.get("gnss_wander_sigma", 0.0), dtype=float), 3) for plant in plants]
    return {
        "seed": np.array(seeds, dtype=np.float64),
        "values": np.array([[v.value(seed) for v in plan.variations] for seed in seeds]).reshape(len(seeds), -1),
        "known": known_values(plants),
        "wander": np.array(wander),
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
    plants = []
    for plant in plan.plants(seeds):
        if stopped():
            raise StoppedError
        plants.append(plant)
    for plant in plants:
        if plant.model is not plan.plant.model:
            raise InputError(f"vary: in the run of seed {plant.seed} the parts of the plant differ from those of the first run")
    return plants
