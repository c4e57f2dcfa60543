"""`run`: simulate a scenario and run estimators on its measurements, in one pass of bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, clock, declared
from insenv.core.runner import Progress, check_progress, make_runner, prepare
from insenv.core.tables import Array
from insenv.estimators import Estimator, EstimatorsLike, get_all
from insenv.estimators.registry import knowing_objects
from insenv.estimators.settings import Settings, setting_rows
from insenv.evaluation.errors import Result, Track, UnitError, errors, stated_sigma, statistics_from, track_of, unit_errors
from insenv.evaluation.health import Health
from insenv.evaluation.limits import Limit
from insenv.evaluation.outages import Outages
from insenv.evaluation.specific_force import SpecificForce
from insenv.report import Report
from insenv.runs.follower import Called, EstimateFunction, Follower, FunctionFollower, parted, sample_names
from insenv.runs.smoothed import SmoothingFollower
from insenv.scenario import Plant, ScenarioLike, build, limit_of, load, no_limit
from insenv.scenario.files import named_estimators
from insenv.scenario.inputs import chunks, recording_interval, sample_columns
from insenv.sensors import IMU
from insenv.sensors.imu import true_unit_errors


def follower_of(estimator: Estimator, parameters: Mapping[str, Any], every: int) -> Follower:
    """The estimator started with `parameters` (SI, by row name); its outputs are recorded every `every` samples."""
    kind = SmoothingFollower if estimator.smooths else Follower
    return kind.started(estimator, parameters, every)


@knowing_objects
def run(
    scenario: ScenarioLike,
    estimators: EstimatorsLike | EstimateFunction | Iterable[str | Estimator | EstimateFunction] | None = None,
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
    estimators: one or several, by id, as `Estimator` objects, or as plain functions; None: those that the scenario names.  A
        function takes one `Sample` and returns an attitude or a dict with it (`insenv.evaluation.errors.checked_estimate`).
    seed, duration_s: seed, and duration in s; None: the scenario's.
    settings: parameters by estimator id, with the keys of [estimator.ID], instead of those of the scenario:
        ``{"loosely-coupled": {"arw_deg_sqrt_h": 0.3}}``.
    progress: called with the numbers of samples done and in all; for the limit, once more from the first sample.

    Raises `InputError` for an unknown name, a wrong value, an estimator that cannot run on this scenario, or a function whose
    estimate is none; `InsenvError` if an estimator diverges or a function fails.
    """
    check_progress(progress)
    scenario = load(scenario)
    functions, others = parted(estimators)
    named = named_estimators(scenario) if estimators is None else others
    chosen = get_all(named) if named or not functions else []
    plant = build(scenario, seed=seed, duration_s=duration_s, driven=True)
    every = recording_interval(plant.samples)
    rows = setting_rows(settings, chosen)
    families, chosen = chosen, [plant.adapted(estimator, settings) for estimator in chosen]
    started = [plant.parameters_of(estimator, rows[estimator.id]) for estimator in chosen]
    prepare([plant.model, *(estimator.model for estimator in chosen)])
    runner = make_runner(plant.model, plant.parameters)
    followers: list[Follower | FunctionFollower] = [
        follower_of(e, parameters, every) for e, parameters in zip(chosen, started, strict=True)
    ]
    visible = sample_names((IMU, *(section.sensor for section in scenario.sensors.values())))
    for id, function in functions.items():
        if any(estimator.id == id for estimator in chosen):
            raise InputError(f"two estimators have the id {id!r}: results are kept by id, so a function needs another name")
        followers.append(FunctionFollower(function, id, every, plant.knowledge, visible))

    truths: list[Array] = []
    bridged = 0
    total = plant.samples // every * every
    for begin, count in chunks(total, every):
        outputs = runner.run(count, plant.inputs(begin, count))
        columns, lost = sample_columns(plant.model, outputs, plant.sample_interval)
        bridged += lost
        for follower in followers:
            follower.follow(columns, count)
        truths.append(outputs[every - 1 :: every])
        if progress is not None:
            progress(begin + count, total)

    truth = plant.model.outputs.unpack(np.concatenate(truths))
    track = track_of(truth["time"], truth)
    refusal = no_limit(plant)
    limit = limit_of(plant, progress) if followers and not refusal else None
    of_tuning = {
        e.id: (*e.without_effect(plant.tunings), *e.understated(plant.knowledge, plant.tunings, rows[e.id])) for e in chosen
    }
    true = true_unit_errors(runner.state, plant.model.parameters.unpack(runner.p))
    results = tuple(_result(f, plant, track, limit, true, of_tuning.get(f.estimator.id, ())) for f in followers)
    notes = (
        *scenario.notes,
        *members(families, chosen),
        *([_BRIDGED.filled(count=bridged)] if bridged else []),
        *refusal,
    )
    return Report(scenario.name, scenario.title, plant.seed, plant.duration_s, total, track, results, notes)


_BRIDGED = declared("samples-bridged", "{count} lost inertial samples bridged by interpolation")
_MEMBER = declared("estimator-composed", "{id}: {title}")


def members(families: Sequence[Estimator], chosen: Sequence[Estimator]) -> list[Remark]:
    """What the members of families of estimators are, such as the states and aids of a fusion filter."""
    pairs = zip(families, chosen, strict=True)
    return [_MEMBER.filled(id=member.id, title=member.title) for family, member in pairs if member is not family]


def _result(
    follower: Follower | FunctionFollower,
    plant: Plant,
    track: Track,
    limit: Limit | None,
    true: Mapping[str, Array],
    of_tuning: tuple[Remark, ...],
) -> Result:
    outputs = follower.named()
    health, covered = follower.health(outputs), track.since(follower.first)
    return result_of(
        follower.estimator,
        outputs,
        covered,
        limit,
        us_per_sample=follower.seconds / (len(track.time) * follower.every) * 1e6,
        notes=(*of_tuning, *follower.notes(covered.time, plant.duration_s, health, outputs)),
        health=health,
        settled=follower.settled(plant.duration_s),
        unit=unit_errors(plant.scenario.vehicle.kind, outputs, true),
    )


def result_of(
    estimator: Estimator | Called,
    outputs: dict[str, Array],
    track: Track,
    limit: Limit | None,
    *,
    us_per_sample: float,
    notes: tuple[Remark, ...],
    health: Health | None = None,
    settled: bool = True,
    sigma: dict[str, Array] | None = None,
    unit: tuple[UnitError, ...] = (),
    evaluated_s: tuple[float, float] | None = None,
    outages: Outages | None = None,
    specific_force: SpecificForce | None = None,
    reference_sigma: Mapping[str, float] | None = None,
) -> Result:
    """The result of estimates by row name against the truth, or a reference, at the same times.

    limit: None: there is none.  sigma: stated standard deviations by channel; None: those in the estimates.
    unit, outages, specific_force, reference_sigma: of `Result`.  evaluated_s: from and to when the estimate is
    judged; None: as a run is, to its end.  Of a track that has NaN the times count at which it has none.

    Raises `InputError` if nothing can be compared.
    """
    time, error = track.time, errors(track_of(track.time, outputs), track)
    sigma = stated_sigma(outputs) if sigma is None else sigma
    if evaluated_s is None:
        evaluated_s = statistics_from(estimator.navigates, float(time[-1])), np.inf
    from_s, to_s = evaluated_s
    inside = np.all([time <= to_s, *(np.isfinite(values) for values in error.values())], axis=0)
    if error and not np.any(inside & (time >= from_s)):
        raise InputError(
            f"nothing to compare: the replay covers {time[0]:.3f} to {time[-1]:.3f} s, [evaluation] asks for {clock(from_s)} "
            f"to {clock(to_s)} s, and the reference must cover some of that"
        )

    def covered(values: Mapping[str, Array]) -> dict[str, Array]:
        return {name: value[inside] for name, value in values.items()}

    bound, course = {}, {}
    if limit is not None and not estimator.smooths:  # it is that of what is known by the time; a smoother knows the whole run
        bound, course = limit.rms(time, from_s), limit.at(time)
    return Result(
        estimator=estimator.id,
        time=time[inside],
        outputs=covered(outputs),
        errors=covered(error),
        sigma=covered(sigma),
        limit={name: value for name, value in bound.items() if name in error},
        from_s=from_s,
        limit_sigma={name: value for name, value in course.items() if name in error},
        us_per_sample=us_per_sample,
        notes=notes,
        health=None if health is None else health.doubted(notes),
        settled=settled,
        unit=unit,
        outages=outages,
        specific_force=specific_force,
        reference_sigma=dict(reference_sigma or {}),
    ).judged()
