"""Run one block of a campaign, some tens of runs, in the batch core: a pure function of the plan on any machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.core.batch import Batch, make_batch
from insenv.core.tables import Array
from insenv.evaluation.health import models_slow_errors
from insenv.scenario import Plant
from insenv.studies.campaign.plan import Plan
from insenv.studies.campaign.run_remarks import as_text, estimator_parameters, of_batch

# Run a batch in pieces of about half a second, between which a caller looks at what has happened.

PIECE_S = 0.5
"""Approximate time between two looks, s."""
FIRST_PIECE = 2000
"""Inertial samples, all rows together, before the first look: milliseconds to a tenth of a second."""


@dataclass
class Begun:
    """What of a batch is done: samples of a row, and the outputs (rows, records, outputs.size) of the records so far."""

    samples: int
    pieces: list[Array]


def in_pieces(
    batch: Batch, records: int, record_samples: int, look: Callable[[Begun], None], begun: Begun | None = None
) -> Array:
    """Return the outputs (rows, records, outputs.size), one record every `record_samples` samples.

    look: called before each piece with what is done; it may raise.  begun: what is done already by a batch whose states are
    those after it.
    """
    so_far = Begun(0, []) if begun is None else begun
    pieces, piece = so_far.pieces, max(1, FIRST_PIECE // batch.rows)
    for record in range(so_far.samples // record_samples, records):
        left = (record + 1) * record_samples - so_far.samples
        while left:
            look(so_far)
            now = min(piece, left)
            left -= now
            clock = perf_counter()
            shown = batch.run(now, every=0 if left else now)
            so_far.samples += now
            # pieces grow and shrink towards PIECE_S; the results do not depend on them
            piece = max(1, min(int(now * PIECE_S / max(perf_counter() - clock, 1e-6)), 4 * piece))
        pieces.append(shown)
    return np.concatenate(pieces, axis=1)


Arrays = dict[str, NDArray[Any]]
Stopped = Callable[[], bool]


class StoppedError(Exception):
    """The campaign of a block was interrupted.  part: what is done of the block, for `run_block` to go on from; or None."""

    def __init__(self, part: Arrays | None = None) -> None:
        super().__init__(part)
        self.part = part


def run_block(plan: Plan, number: int, stopped: Stopped = lambda: False, part: Arrays | None = None) -> Arrays:
    """Simulate and estimate the runs of block `number` and return their summaries, run by run.

    part: what an interruption left of the block: the result is the same, to the bit.
    Arrays: `seed` (runs,); `values` (runs, variations); each output of `measured_model` (runs, records, ...); `said` (runs,):
    what the estimator says of the run (`insenv.studies.campaign.run_remarks`), `models_slow` (runs,): whether it models slow
    errors of the fixes. Raises `InputError` if the parts of the plant differ between
    runs, `StoppedError` soon after `stopped` returns true.
    """
    runs = plan.blocks[number]
    plants = _plants(plan, runs, stopped)
    measured = plan.measured
    batch = make_batch(measured.model, len(plants), plan.parameters_of(plants))
    begun = None
    if part is not None:
        batch.x = part["state"]
        begun = Begun(int(part["samples"]), [part["outputs"]] if part["outputs"].shape[1] else [])

    def look(done: Begun) -> None:
        if stopped():
            raise StoppedError(_part(batch, done))

    records = plan.samples // plan.record_samples
    shown = measured.model.outputs.unpack(in_pieces(batch, records, plan.record_samples, look, begun))
    return {
        "seed": np.array([plan.seed_of(run) for run in runs], dtype=np.float64),
        "values": plan.numbers(runs),
        **{name: np.ascontiguousarray(value) for name, value in shown.items()},
        "said": np.array([as_text(said) for said in of_batch(plan.chosen, batch, plan.duration_s, bool(plan.variations))]),
        "models_slow": np.array([models_slow_errors(p) for p in estimator_parameters(plan.chosen, batch)], dtype=np.float64),
    }


def _part(batch: Batch, done: Begun) -> Arrays:
    """What is done of a block: the states, the samples of a run, the outputs so far."""
    empty = np.zeros((batch.rows, 0, batch.model.outputs.size))
    return {
        "state": batch.x,
        "samples": np.array(float(done.samples)),
        "outputs": np.concatenate([empty, *done.pieces], axis=1),
    }


def _plants(plan: Plan, runs: range, stopped: Stopped) -> list[Plant]:
    plants = []
    for plant in plan.plants(runs):
        if stopped():
            raise StoppedError
        plants.append(plant)
    for plant in plants:
        if plant.model is not plan.plant.model:
            raise InputError(f"vary: in the run of seed {plant.seed} the parts of the plant differ from those of the first run")
    return plants
