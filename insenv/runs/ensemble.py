"""Ensembles: one scenario and its estimators over many seeds at once, in the batch core."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.core.batch import Batch, make_batch
from insenv.core.model import Model
from insenv.errors import InsenvError
from insenv.estimators import Estimator, EstimatorsLike, get_all
from insenv.runs.simulated import recording_interval
from insenv.scenario import Plant, ScenarioLike, build, load
from insenv.sensors import SENSOR_ERROR

Array = NDArray[np.float64]
SAMPLES_AT_ONCE = 200_000  # rows times samples simulated before the estimators see them: some 100 MB


@dataclass(frozen=True)
class Ensemble:
    """What an ensemble gave at the recorded times.

    time (records,) s; truth: the plant's outputs by row name, (seeds, records, ...); outputs: by estimator id, the
    estimator's outputs by row name, likewise; plants: one of each seed; sensor_error_n (seeds, 6): mean error of gyros
    (rad/s) and accelerometers (m/s^2) in n along the whole run, noise left out.
    """

    time: Array
    truth: dict[str, Array]
    outputs: dict[str, dict[str, Array]]
    plants: tuple[Plant, ...]
    sensor_error_n: Array

    def attitude_errors_deg(self, id: str) -> Array:
        """Roll, pitch and heading of estimate minus truth (seeds, records, 3), degrees."""
        found, true = (np.stack(attitude.numeric.to_euler(q), axis=-1) for q in (self.outputs[id]["q_nb"], self.truth["q_nb"]))
        return (np.degrees(found - true) + 180.0) % 360.0 - 180.0


def ensemble(
    scenario: ScenarioLike,
    estimators: EstimatorsLike,
    seeds: Sequence[int],
    *,
    duration_s: float | None = None,
    records: int = 300,
    threads: int = 2,
    tuning: Mapping[str, Mapping[str, Any]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Ensemble:
    """Simulate `scenario` for every seed and run the estimators on it; each row equals `insenv.runs.simulated.run` with that
    seed.

    tuning: parameter rows by estimator id, on top of the scenario's.  Lost samples are not bridged here.
    """
    scenario, chosen = load(scenario), get_all(estimators)
    plants = tuple(build(scenario, seed=seed, duration_s=duration_s) for seed in seeds)
    model, samples, interval = plants[0].model, plants[0].samples, plants[0].sample_interval
    every = recording_interval(samples, records)
    total = samples // every * every
    plant = make_batch(model, len(plants), _rows(model, [p.parameters for p in plants]), threads=threads)
    batches = {e.id: _batch(e, plants, (tuning or {}).get(e.id, {}), threads) for e in chosen}

    kept: list[Array] = []
    found: dict[str, list[Array]] = {e.id: [] for e in chosen}
    excess = np.zeros((len(plants), 6))
    chunk = max(every, SAMPLES_AT_ONCE // len(plants) // every * every)
    for begin in range(0, total, chunk):
        count = min(chunk, total - begin)
        shown = plant.run(count, every=1)
        columns = model.outputs.unpack(shown)
        columns["dt"] = np.full((len(plants), count), interval)
        excess += _excess_n(columns)
        for estimator in chosen:
            rows = _inputs(estimator.model, columns, (len(plants), count))
            outputs = batches[estimator.id].run(count, rows, every=every)
            if not np.isfinite(outputs).all():
                raise InsenvError(f"estimator {estimator.id!r} diverged: its outputs are no longer finite numbers")
            found[estimator.id].append(outputs)
        kept.append(shown[:, every - 1 :: every])
        if progress is not None:
            progress(begin + count, total)

    truth = model.outputs.unpack(np.concatenate(kept, axis=1))
    estimated = {e.id: e.model.outputs.unpack(np.concatenate(found[e.id], axis=1)) for e in chosen}
    return Ensemble(truth["time"][0], truth, estimated, plants, excess / (total * interval))


def _rows(model: Model, parameters: Sequence[Mapping[str, Any]]) -> Array:
    return np.array([model.parameters.pack(p) for p in parameters])


def _batch(estimator: Estimator, plants: Sequence[Plant], tuning: Mapping[str, Any], threads: int) -> Batch:
    parameters = [p.parameters_of(estimator, tuning, whole=False) for p in plants]
    return make_batch(estimator.model, len(plants), _rows(estimator.model, parameters), threads=threads)


def _inputs(model: Model, columns: Mapping[str, Array], shape: tuple[int, int]) -> Array:
    """Inputs (seeds, samples, inputs.size): each row from the column of that name, else its start value."""
    rows = np.tile(model.inputs.start_vector(), (*shape, 1))
    for name in model.inputs.names:
        if name in columns:
            rows[..., model.inputs.slice(name)] = columns[name].reshape(*shape, -1)
    return rows


def _excess_n(columns: Mapping[str, Array]) -> Array:
    C_nb = attitude.numeric.to_dcm(columns["q_nb"])
    return np.concatenate([np.einsum("rnij,rnj->ri", C_nb, columns[name]) for name in SENSOR_ERROR.names], axis=1)
