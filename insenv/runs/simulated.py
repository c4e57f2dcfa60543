"""`run`: simulate a scenario and run estimators on its measurements, in one pass of bounded memory."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.core.progress import Progress, check_progress
from insenv.core.runner import make_runner
from insenv.estimators import Estimator, EstimatorsLike, get, get_all
from insenv.evaluation import limits
from insenv.evaluation.errors import POSITION, Result, Track, errors, rms, stated_sigma, track_of
from insenv.plant.feeding import bridge_lost, chunks, recording_interval
from insenv.report import Report
from insenv.runs.follower import Follower
from insenv.runs.smoothed import SmoothingFollower
from insenv.scenario import Plant, ScenarioLike, build, load
from insenv.scenario.tuning import Settings, setting_rows
from insenv.sensors import SENSOR_ERROR

Array = NDArray[np.float64]


def follower_of(estimator: Estimator, parameters: Mapping[str, Any], every: int) -> Follower:
    """The estimator started with `parameters` (SI, by row name); its outputs are recorded every `every` samples."""
    kind = SmoothingFollower if estimator.smooths else Follower
    return kind.started(estimator, parameters, every)


def run(
    scenario: ScenarioLike,
    estimators: EstimatorsLike | None = None,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Report:
    """Simulate a scenario and run estimators on the measurements of its sensors.

    Parameters
    ----------
    scenario: a name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a
    file.
    estimators: one or several, by id or as `Estimator` objects; None: those that the scenario names.
    seed, duration_s: seed, and duration in s; None: the scenario's.
    settings: parameters by estimator id, with the keys of [estimator.ID], instead of those of the scenario:
        ``{"loosely-coupled": {"arw_deg_sqrt_h": 0.3}}``.
    progress: called with the numbers of samples done and in all.

    Raises `InputError` for an unknown name, a wrong value, or an estimator that cannot run on this scenario;
    `InsenvError` if an estimator diverges.
    """
    check_progress(progress)
    scenario = load(scenario)
    chosen = get_all(scenario.estimators if estimators is None else estimators)
    plant = build(scenario, seed=seed, duration_s=duration_s)
    every = recording_interval(plant.samples)
    rows = setting_rows(settings, chosen)
    started = [plant.parameters_of(estimator, rows[estimator.id]) for estimator in chosen]
    runner = make_runner(plant.model, plant.parameters)
    followers = [follower_of(e, parameters, every) for e, parameters in zip(chosen, started, strict=True)]
    # the covariance of the 15-state filter without fixes is the limit of free-inertial navigation
    predictor = None
    if any(e.navigates and not e.aided for e in chosen):
        filter15 = get("loosely-coupled")
        predictor = follower_of(filter15, filter15.parameters(plant.knowledge, rows={"standing_window": 0.0}), every)

    kept: list[Array] = []
    bridged, sensor_error_n = 0, np.zeros(6)
    total = plant.samples // every * every
    for begin, count in chunks(total, every):
        shown = runner.run(count)
        columns = plant.model.outputs.unpack(shown)
        columns = {name: np.array(column) for name, column in columns.items()}
        columns["dt"] = np.full(count, plant.sample_interval)
        bridged += bridge_lost(columns)
        sensor_error_n += sensor_error_sum_n(columns) / (total * plant.sample_interval)
        for follower in followers:
            follower.follow(columns, count)
        if predictor is not None:
            predictor.follow({**columns, "gnss_valid": np.zeros(count)}, count)
        kept.append(shown[every - 1 :: every])
        if progress is not None:
            progress(begin + count, total)

    truth = plant.model.outputs.unpack(np.concatenate(kept))
    track = track_of(truth["time"], truth)
    results = tuple(_result(f, plant, track, sensor_error_n, predictor) for f in followers)
    notes = (*scenario.notes, *((f"{bridged} lost inertial samples bridged by interpolation",) if bridged else ()))
    return Report(scenario.name, scenario.title, plant.seed, plant.duration_s, total, track, results, notes)


def sensor_error_sum_n(columns: Mapping[str, Array]) -> Array:
    """Sums over the samples of the errors of gyros and accelerometers in n, without white noise: (..., 6), rad and m/s.

    columns: the plant's outputs by row name, (..., samples, components).
    """
    C_nb = attitude.numeric.to_dcm(columns["q_nb"])
    return np.concatenate([np.einsum("...nij,...nj->...i", C_nb, columns[name]) for name in SENSOR_ERROR.names], axis=-1)


def _result(follower: Follower, plant: Plant, track: Track, sensor_error_n: Array, predictor: Follower | None) -> Result:
    outputs = follower.named()
    estimator = follower.estimator
    sigma, health = stated_sigma(outputs), follower.health(outputs)
    from_s = 0.0
    if not estimator.navigates:
        from_s = 0.75 * float(track.time[-1])
        limit = _alignment_limit(plant, track, sensor_error_n)
    elif estimator.aided:
        limit = _aided_limit(plant, sigma)
    else:
        limit = rms(stated_sigma(predictor.named())) if predictor is not None else {}
    return Result(
        estimator=estimator.id,
        time=track.time,
        outputs=outputs,
        errors=errors(track_of(track.time, outputs), track),
        sigma=sigma,
        limit=limit,
        from_s=from_s,
        us_per_sample=follower.seconds / (len(track.time) * follower.every) * 1e6,
        notes=follower.notes(plant.duration_s, health),
        health=health,
        settled=not follower.too_short(plant.duration_s),
    )


def _aided_limit(plant: Plant, sigma: dict[str, Array]) -> dict[str, float]:
    """The filter's standard deviations; for position, with the slow errors of the fixes, which do not average out."""
    limit = rms(sigma)
    wander = np.broadcast_to(np.asarray(plant.parameters.get("gnss_wander_sigma", 0.0), dtype=float), 3)
    for name, slow in zip(POSITION, wander, strict=True):
        limit[name] = float(np.hypot(limit[name], slow))
    return limit


def _alignment_limit(plant: Plant, track: Track, sensor_error_n: Array) -> dict[str, float]:
    known, sensors = plant.knowledge, plant.knowledge.sensors
    bias = limits.bias_tilts(sensor_error_n[:3], sensor_error_n[3:], known.latitude, known.height)
    noises = sensors.angle_random_walk, sensors.velocity_random_walk
    noise = limits.noise_bound(*noises, known.latitude, known.height, np.array([plant.duration_s]))[0]
    heading = np.radians(track.euler_deg()[:, 2])
    return limits.alignment_limit(bias, noise, float(np.angle(np.mean(np.exp(1j * heading)))))
