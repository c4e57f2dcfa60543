"""Ensembles: one scenario and its estimators for many seeds at once, as a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InsenvError
from insenv.core.batch import Batch, make_batch
from insenv.core.model import Model
from insenv.core.tables import Array
from insenv.estimators import EstimatorsLike, get_all
from insenv.evaluation.errors import wrapped_deg
from insenv.scenario import Plant, ScenarioLike, build, load
from insenv.scenario.inputs import chunks, input_rows, recording_interval
from insenv.sensors import SENSOR_ERROR

SAMPLES_AT_ONCE = 200_000  # seeds times samples that are simulated before the estimators take them: about 100 MB
THREADS = 2


@dataclass(frozen=True)
class Ensemble:
    """Results of an ensemble at the recorded times.

    time (records,) s; truth: the plant's outputs by row name, (seeds, records, ...); outputs: by estimator id and row
    name, (seeds, records, ...); plants: one per seed; sensor_error_n (seeds, 6): mean errors of the gyros (rad/s) and
    accelerometers (m/s^2) in n over the whole run, without white noise.
    """

    time: Array
    truth: dict[str, Array]
    outputs: dict[str, dict[str, Array]]
    plants: tuple[Plant, ...]
    sensor_error_n: Array

    def attitude_errors_deg(self, id: str) -> Array:
        """Errors of roll, pitch and heading (estimate minus truth), (seeds, records, 3), degrees."""
        estimated, true = (
            np.stack(attitude.numeric.to_euler(q), axis=-1) for q in (self.outputs[id]["q_nb"], self.truth["q_nb"])
        )
        return wrapped_deg(np.degrees(estimated - true))


def ensemble(
    scenario: ScenarioLike,
    estimators: EstimatorsLike,
    seeds: Sequence[int],
    *,
    duration_s: float | None = None,
    records: int = 300,
    tuning: Mapping[str, Mapping[str, Any]] | None = None,
) -> Ensemble:
    """Simulate `scenario` for every seed and run the estimators on it.

    The row of a seed equals `insenv.runs.simulated.run` with that seed, except that lost samples are not bridged.
    tuning: parameter rows by estimator id; they replace those of the scenario.
    """
    scenario, chosen = load(scenario), get_all(estimators)
    plants = tuple(build(scenario, seed=seed, duration_s=duration_s) for seed in seeds)
    chosen = [plants[0].adapted(estimator, offline=False) for estimator in chosen]
    model, samples, interval = plants[0].model, plants[0].samples, plants[0].sample_interval
    every = recording_interval(samples, records)
    total = samples // every * every
    plant = _batch(model, [p.parameters for p in plants])
    batches = {}
    for e in chosen:
        rows_of_tuning = (tuning or {}).get(e.id, {})
        batches[e.id] = _batch(e.model, [p.parameters_of(e, rows_of_tuning, offline=False) for p in plants])

    truths: list[Array] = []
    estimates: dict[str, list[Array]] = {e.id: [] for e in chosen}
    sensor_error_n = np.zeros((len(plants), 6))
    for _, count in chunks(total, every, SAMPLES_AT_ONCE // len(plants)):
        outputs_of_plant = plant.run(count, every=1)
        columns = model.outputs.unpack(outputs_of_plant)
        columns["dt"] = np.full((len(plants), count), interval)
        sensor_error_n += _sensor_error_sum_n(columns)
        for estimator in chosen:
            rows = input_rows(estimator.model, columns, len(plants), count)
            outputs = batches[estimator.id].run(count, rows, every=every)
            if not np.isfinite(outputs).all():
                raise InsenvError(f"estimator {estimator.id!r} diverged: its outputs are no longer finite numbers")
            estimates[estimator.id].append(outputs)
        truths.append(outputs_of_plant[:, every - 1 :: every])

    truth = model.outputs.unpack(np.concatenate(truths, axis=1))
    estimated = {e.id: e.model.outputs.unpack(np.concatenate(estimates[e.id], axis=1)) for e in chosen}
    return Ensemble(truth["time"][0], truth, estimated, plants, sensor_error_n / (total * interval))


def _sensor_error_sum_n(columns: Mapping[str, Array]) -> Array:
    """Sums over the samples of the errors of gyros and accelerometers in n, without white noise: (..., 6), rad and m/s.

    columns: the plant's outputs by row name, (..., samples, components).
    """
    C_nb = attitude.numeric.to_dcm(columns["q_nb"])
    return np.concatenate([np.einsum("...nij,...nj->...i", C_nb, columns[name]) for name in SENSOR_ERROR.names], axis=-1)


def _batch(model: Model, parameters: Sequence[Mapping[str, Any]]) -> Batch:
    rows = np.array([model.parameters.pack(p) for p in parameters])
    return make_batch(model, len(rows), rows, threads=THREADS)
