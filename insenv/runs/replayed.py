"""`replay`: run estimators on a recorded log and compare them with its reference solution, if it has one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError, InsenvError
from insenv.base.output import as_path
from insenv.base.remarks import Remark, clock, declared
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Array
from insenv.estimators import Drive, Estimator, EstimatorsLike, get_all
from insenv.estimators.registry import knowing_objects
from insenv.estimators.settings import Settings, choices_in, setting_rows, settings_of, tuning
from insenv.evaluation.contradiction import contradiction_notes, sideways_notes
from insenv.evaluation.errors import ATTITUDE, Result, Track, statistics_from, unit_errors
from insenv.evaluation.outages import Outages, outages_of
from insenv.evaluation.specific_force import VelocityChanges, specific_force
from insenv.logs import RecordedLog, Reference, load
from insenv.logs.description import EvaluationSection
from insenv.logs.instruments import sample_columns
from insenv.logs.outages import OutagesLike, Withheld, listed, withheld
from insenv.logs.reference import at_imu, body_rate
from insenv.logs.rest import REST_WINDOW_S, travel
from insenv.report import Report
from insenv.runs.follower import Follower
from insenv.runs.instrument_start import with_datum
from insenv.runs.log_remarks import common_error, fixes_delayed, latitude_at_rest, noise_in_motion, standstill_missed, unseen
from insenv.runs.reference_check import reference_notes
from insenv.runs.replay_start import STARTS, Start, initial_knowledge, rounding, start_time
from insenv.runs.simulated import follower_of, members, result_of
from insenv.runs.velocity_changes import velocity_changes
from insenv.scenario.inputs import RECORDS, chunks, recording_interval
from insenv.sensors.gnss import ARM, COMMON
from insenv.vehicles.registry import traits_of


@knowing_objects
def replay(
    log: str | Path | RecordedLog,
    estimators: EstimatorsLike,
    *,
    start: str = "coarse",
    settings: Settings | None = None,
    outages: OutagesLike = (),
    progress: Progress | None = None,
) -> Report:
    """Run estimators on a recorded log.

    Parameters
    ----------
    log: the path of a flight log, the path of a ``.toml`` file that describes the files of a log, or a loaded
        `RecordedLog`.
    estimators: one or several, by id or as `Estimator` objects.
    start: initial state: "coarse", from the log alone; "reference", of navigation, from the log's reference solution; "stated",
        all of it as the log's [initial] states it.
    settings: parameters by estimator id, with the keys of [estimator.ID], instead of those of the log's description:
        ``{"loosely-coupled": {"arw_deg_sqrt_h": 0.3}}``.
    outages: windows of time (begin, end), s on the clock of the log, whose fixes are withheld from the estimators and then
        compared with the estimates (`Result.outages`); also as texts: ``"100:160"``, ``"+100:+160"`` from the start on,
        ``"every=120,length=60"``.
    progress: called with the numbers of samples done and in all.

    An estimator that the log is not for, or that diverges, is left out, with a note, if there is another one.

    Raises `InputError` for a wrong log or a wrong argument, or if the log is for none of them; `InsenvError` if all
    diverge.
    """
    check_progress(progress)
    name = log.description.title if isinstance(log, RecordedLog) else str(log)
    ready = prepared(log, estimators, start=start, settings=settings, outages=outages)
    log, first, columns, dropped, chosen, starts, parameter_rows = (
        ready.log, ready.first, ready.columns, ready.dropped, ready.chosen, ready.starts, ready.parameter_rows
    )  # fmt: skip
    description = log.description
    count = len(log.imu_time) - first
    # more records than in a simulated run, for the comparison with the reference, but not every sample of a long log
    every = recording_interval(count, 10 * RECORDS)
    total = count // every * every
    followers = [
        follower_of(e, e.parameters(s.knowledge, rows=parameter_rows[e.id]), every) for e, s in zip(chosen, starts, strict=True)
    ]
    columns = {**columns, "time": log.imu_time[first:]}  # for messages
    going, lost = list(range(len(followers))), []
    for begin, size in chunks(total, every):
        part = {name: column[begin : begin + size] for name, column in columns.items()}
        for k in tuple(going):
            try:
                followers[k].follow(part, size)
            except InsenvError as error:
                if len(going) == 1:
                    raise InsenvError(f"{error}; stop_s and start_s select a part of the log without that time") from None
                going.remove(k)
                lost.append(_left_out(chosen[k].id, error))
        if progress is not None:
            progress(begin + size, total)
    families, chosen = [ready.families[k] for k in going], [chosen[k] for k in going]
    starts, followers = [starts[k] for k in going], [followers[k] for k in going]

    times = log.imu_time[first : first + total][every - 1 :: every]
    evaluation = description.evaluation
    reference = _reference_track(log.reference, times)
    duration = float(log.dt[first : first + total].sum())
    changes, of_reference = velocity_changes(ready.whole), reference_notes(log)
    results = tuple(
        _result(f, begun, ready, reference, times, duration, changes) for f, begun in zip(followers, starts, strict=True)
    )
    if not of_reference:  # one on another clock, or in other axes, speaks against no estimate
        results = tuple(each.against_reference() for each in results)
    notes = [
        *ready.notes,
        *lost,
        *log.notes,
        *members(families, chosen),
        *latitude_at_rest(log, first, starts[0].knowledge.latitude),
    ]
    if log.assumed is not None and any(_takes_sensors(e, parameter_rows[e.id]) for e in chosen):
        notes.append(log.assumed.remark)
    if any(_takes_sensors(e, parameter_rows[e.id]) and (e.navigates or e.motion == "moving") for e in chosen):
        notes += noise_in_motion(log)
    if any(COMMON.name in e.model.parameters and COMMON.name not in parameter_rows[e.id] for e in chosen):
        notes += common_error(log)
    notes += of_reference
    if log.gaps.count:
        notes.append(_BRIDGED.filled(count=log.gaps.count, samples=log.gaps.samples))
    if dropped:
        notes.append(_DROPPED.filled(count=dropped))
    if ready.withheld is not None and ready.withheld.empty:
        notes.append(_EMPTY.filled(count=ready.withheld.empty))
    return Report(
        scenario=name,
        title=description.title,
        seed=None,
        duration_s=duration,
        imu_samples=total,
        truth=reference,
        results=results,
        notes=tuple(notes),
        published=tuple((p.name, dict(p.rms)) for p in evaluation.published),
    )


REFUSED = "estimator-refused"
_REFUSED = declared(REFUSED, "{id} is left out: {why}")
_BRIDGED = declared("gaps-bridged", "gaps bridged by interpolation: {count} ({samples} samples in all)")
_UNSEEN = declared(
    "outages-unseen", "outages left out, because no estimate was recorded while the fixes were withheld: {count}"
)
_EMPTY = declared("outages-empty", "outages left out, because the log itself has no fix in them: {count}")
_DROPPED = declared("fixes-dropped", "fixes not used, because a later one is in the same sample: {count}")


@dataclass(frozen=True)
class Prepared:
    """A log and estimators ready for a replay.

    first: number of the first sample; columns: samples from it on, by name of the estimators' inputs; dropped: fixes left out;
    begin_s: start time; families, chosen: estimators as asked for, and adapted to the log; starts: what each knows at the
    start; tunings: parameter rows (SI) that the log sets, by estimator id; parameter_rows: those in force.  notes: who else
    was asked for, and why the log is not for it; what the log contradicts of its instruments.
    whole: the log with the fixes that outages withhold from `log`; withheld: these, None without outages.
    """

    log: RecordedLog
    first: int
    begin_s: float
    columns: dict[str, Array]
    dropped: int
    families: list[Estimator]
    chosen: list[Estimator]
    starts: list[Start]
    tunings: dict[str, dict[str, Any]]
    parameter_rows: dict[str, dict[str, Any]]
    notes: tuple[Remark, ...]
    whole: RecordedLog
    withheld: Withheld | None


def prepared(
    log: str | Path | RecordedLog,
    estimators: EstimatorsLike,
    *,
    start: str = "coarse",
    settings: Settings | None = None,
    outages: OutagesLike = (),
) -> Prepared:
    """A log and estimators ready for a replay; arguments and errors are those of `replay`."""
    if start not in STARTS:
        raise InputError(f"start {start!r}: allowed is {', '.join(STARTS[:-1])} or {STARTS[-1]}")
    families = get_all(estimators)
    log, differing = with_datum(log if isinstance(log, RecordedLog) else load(as_path("log", log)))
    whole = log
    description = log.description
    begin_s = start_time(log, start)
    first = int(np.searchsorted(log.imu_time - log.dt, begin_s - rounding(begin_s)))
    if first >= len(log.imu_time):
        raise InputError(f"[initial] start_s = {clock(begin_s)} s: the log ends at {log.imu_time[-1]:.3f} s")
    lost: Withheld | None = None
    if asked_outages := listed(outages):
        log, lost = withheld(whole, asked_outages, begin_s)
    tunings: dict[str, dict[str, Any]] = {id: dict(rows) for id, rows in log.settings.items()}
    for id, table in description.estimator.items():
        tunings[id] = {**tunings.get(id, {}), **tuning(id, table)}
    drive = _drive(log, begin_s)
    columns, dropped = sample_columns(log, slice(first, None))
    chosen_settings = setting_rows(settings, families)

    def ready(family: Estimator) -> tuple[Estimator, Start]:
        if family.adapt is None:  # a family is what `adapted` makes of it
            family.check(drive, tunings.get(family.id))
        begun = initial_knowledge(log, family, start, first)
        estimator_settings = {**settings_of(family, description.estimator), **settings_of(family, settings)}
        estimator = family.adapted(begun.knowledge, drive, choices_in(family, estimator_settings))
        estimator.check(drive, tunings.get(estimator.id))
        if lost is not None and not estimator.navigates:
            raise InputError(
                f"estimator {estimator.id!r} has no position to compare with withheld fixes: allowed without outages"
            )
        if begun.refusal and not estimator.finds_attitude:
            raise InputError(begun.refusal)
        return estimator, begun

    taken, refused = [], []
    for family in families:
        try:
            taken.append((family, *ready(family)))
        except InputError as error:
            if len(families) == 1:
                raise
            refused.append(_left_out(family.id, error))
    if not taken:
        raise InputError("\n".join(refused))
    parameter_rows = {
        e.id: _whole_unit(e, _slow_error_once({**e.tuned(tunings), **chosen_settings[e.id]})) for _, e, _ in taken
    }
    asked, chosen, starts = (list(part) for part in zip(*taken, strict=True))
    notes = (*differing, *refused)
    return Prepared(log, first, begin_s, columns, dropped, asked, chosen, starts, tunings, parameter_rows, notes, whole, lost)


def _left_out(id: str, error: InsenvError) -> Remark:
    """What is said of an estimator that another one goes on without."""
    why, name = str(error), f"estimator {id!r} "
    return _REFUSED.filled(id=id, why=f"it {why.removeprefix(name)}" if why.startswith(name) else why)


def _drive(log: RecordedLog, begin_s: float) -> Drive:
    """What estimators check of a log, on the way that it shows from `begin_s` on.

    Raises `InputError` where the description says that a vehicle stays in place which travels.
    """
    end_s = float(log.imu_time[-1])
    way = travel(log, begin_s, end_s)
    motion = ""
    if way is not None and log.description.in_place:
        raise InputError(
            f"in_place = true, and the log shows that the vehicle moves, at {way.speed:.3g} m/s about {way.time:.0f} s: "
            "allowed is in_place = false, or a part of the log in which it stays, by start_s and stop_s"
        )
    if way is not None:
        motion = f"at {way.speed:.3g} m/s about {way.time:.0f} s; start_s and stop_s select the part in which it stays"
    sensors = {each.id for each in log.instruments} | (set() if log.gnss is None else {"gnss"})
    in_place = log.description.in_place if way is None else False
    measured = log.gnss is None or log.gnss.velocity_n is not None
    kind = log.description.vehicle_kind
    timed = {each.id: (each.arrival, each.age) for each in log.instruments}
    if log.gnss is not None:
        timed["gnss"] = log.gnss.arrival, log.gnss.age
    ages = {
        id: float(np.max(age[arrival >= begin_s], initial=0.0))
        for id, (arrival, age) in timed.items()
        if arrival is not None and age is not None
    }
    stands = log.rest is not None and log.rest[0] - REST_WINDOW_S <= begin_s and log.rest[1] > end_s - 2 * REST_WINDOW_S
    return Drive(
        "the log", frozenset(sensors), in_place, vehicle=kind, motion=motion, stands=stands, fix_velocity=measured, ages=ages
    )


_UNIT = ("angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma")


def _takes_sensors(estimator: Estimator, rows: Mapping[str, Any]) -> bool:
    """Whether noise or bias of the unit is not among `rows`, but as its data sheet says."""
    return any(name in estimator.model.parameters and name not in rows for name in _UNIT)


def _whole_unit(estimator: Estimator, rows: dict[str, Any]) -> dict[str, Any]:
    """Parameters that give noise and biases describe the whole unit: scale factors are then 0, unless stated."""
    if _takes_sensors(estimator, rows):
        return rows
    return {**{name: 0.0 for name in ("rotation_error", "thrust_error") if name in estimator.model.parameters}, **rows}


def _slow_error_once(rows: dict[str, Any]) -> dict[str, Any]:
    """Parameters that state the slow error of the fixes: beside it the fixes have none in common, unless it is stated too."""
    return {COMMON.name: np.zeros(3), **rows} if "fix_wander_sigma" in rows else rows


def _moved_to_imu(track: Track, log: RecordedLog, outputs: Mapping[str, Array]) -> Track:
    """A reference without attitude that has a lever arm, at the IMU by the attitude of an estimate at the same times."""
    arm = None if log.reference is None else log.reference.lever_arm_b
    if arm is None or "q_nb" not in outputs:
        return track
    place = None
    if track.latitude is not None and track.longitude is not None and track.height is not None:
        place = track.latitude, track.longitude, track.height
    C_nb = attitude.numeric.to_dcm(outputs["q_nb"])
    place, velocity_n = at_imu(place, track.velocity_n, C_nb, body_rate(log, track.time), arm)
    latitude, longitude, height = (None, None, None) if place is None else place
    return replace(track, latitude=latitude, longitude=longitude, height=height, velocity_n=velocity_n)


def _reference_track(reference: Reference | None, times: Array) -> Track:
    """The reference interpolated at `times`; an empty track if the log has none."""
    if reference is None:
        return Track(times)

    def at(values: Array) -> Array:
        columns = values.reshape(len(values), -1)
        columns = np.stack([np.interp(times, reference.time, c, np.nan, np.nan) for c in columns.T], axis=-1)
        return columns.reshape(len(times), *values.shape[1:])

    q_nb = None
    if reference.roll is not None and reference.pitch is not None and reference.heading is not None:
        angles = [at(np.unwrap(a)) for a in (reference.roll, reference.pitch, reference.heading)]
        q_nb = attitude.numeric.from_euler(*angles)
    return Track(
        times,
        q_nb,
        None if reference.velocity_n is None else at(reference.velocity_n),
        None if reference.latitude is None else at(reference.latitude),
        None if reference.longitude is None else at(np.unwrap(reference.longitude)),
        None if reference.height is None else at(reference.height),
    )


def _evaluated(estimator: Estimator, evaluation: EvaluationSection, begin_s: float, times: Array) -> tuple[float, float]:
    """From and to when (s) an estimator that starts at `begin_s` is judged: as the log says, otherwise as a run is."""
    first, last = float(times[0]), float(times[-1])
    to_s = last if evaluation.to_s is None else evaluation.to_s
    from_s = max(first, begin_s + statistics_from(estimator.navigates, min(to_s, last) - begin_s))
    return from_s if evaluation.from_s is None else evaluation.from_s, to_s


def _outages(ready: Prepared, follower: Follower, times: Array, outputs: Mapping[str, Array]) -> Outages | None:
    """The errors where fixes were withheld; None without outages."""
    lost = ready.withheld
    if lost is None:
        return None
    common = {COMMON.name: follower.parameters.get(COMMON.name, 0.0)}
    stated = {**ready.log.stated_errors, ARM.name: ready.log.lever_arm_b, **common}
    return outages_of(times, outputs, lost.fixes, lost.windows, lost.resumed, stated)


def _of_outages(lost: Withheld | None, outages: Outages | None) -> tuple[Remark, ...]:
    """What is said of outages, and of those in which nothing was compared."""
    if lost is None:
        return ()
    unseen = len(lost.windows) - (0 if outages is None else len(outages.each))
    left_out = (_UNSEEN.filled(count=unseen),) if unseen else ()
    return (*left_out, *(() if outages is None else outages.too_sure()))


def _result(
    follower: Follower,
    begun: Start,
    ready: Prepared,
    reference: Track,
    times: Array,
    duration_s: float,
    changes: VelocityChanges | None,
) -> Result:
    """times: of the records.  reference: at these times; empty if the log has none.  changes: of the receiver's velocity."""
    log, estimator, outputs = ready.log, follower.estimator, follower.named()
    rows, health = ready.parameter_rows[estimator.id], follower.health(outputs)
    # parameters that describe the whole unit are not compared with its data sheet
    understated = estimator.understated(begun.knowledge, rows=rows) if _takes_sensors(estimator, rows) else ()
    outages, evaluated_s = (
        _outages(ready, follower, times, outputs),
        _evaluated(estimator, log.description.evaluation, ready.begin_s, times),
    )
    force = None
    if changes is not None:
        sigma = outputs.get("attitude_sigma")
        force = specific_force(changes, times, outputs["q_nb"], sigma, reference.q_nb, *evaluated_s)
    return result_of(
        estimator,
        outputs,
        _moved_to_imu(reference, log, outputs),
        None,
        us_per_sample=follower.seconds / (len(times) * follower.every) * 1e6,
        notes=(
            *begun.notes,
            *estimator.without_effect(ready.tunings),
            *understated,
            *unseen(log, estimator, ready.begin_s, begun.knowledge.latitude),
            *standstill_missed(log, follower, times),
            *fixes_delayed(log, outputs),
            *follower.notes(times - (times[-1] - duration_s), duration_s, health, outputs),
            *contradiction_notes(times, outputs),
            *sideways_notes(times, outputs, traits_of(log.description.vehicle_kind).wheels),
            *_of_outages(ready.withheld, outages),
            *(force.reference_contradicted() if force is not None else ()),
        ),
        health=health,
        settled=follower.settled(duration_s),
        unit=unit_errors(log.description.vehicle_kind, outputs),
        evaluated_s=evaluated_s,
        outages=outages,
        specific_force=force,
        reference_sigma=_reference_sigma(log.reference),
    )


def _reference_sigma(reference: Reference | None) -> dict[str, float]:
    """The standard deviation of the error of a reference, by channel, where it is stated."""
    sigma = None if reference is None else reference.attitude_sigma
    return {} if sigma is None else dict(zip(ATTITUDE, np.degrees(sigma).tolist(), strict=True))
