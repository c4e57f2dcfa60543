"""`replay`: a recorded log through estimators, compared with its reference solution if it has one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.errors import InputError
from insenv.estimators import Drive, Estimator, EstimatorsLike, Knowledge, get_all
from insenv.evaluation.errors import Result, Track, errors, stated_sigma
from insenv.logs import RecordedLog, Reference, load
from insenv.report import Report
from insenv.runs.follower import Follower
from insenv.runs.replay_columns import sample_columns
from insenv.runs.replay_start import COURSE_SIGMA, from_log, from_reference
from insenv.runs.simulated import CHUNK, RECORDS, Progress, follower_of, recording_interval, track_of
from insenv.scenario import tuning
from insenv.sensors import units

Array = NDArray[np.float64]

STARTS = ("coarse", "reference")
"""Where a navigation estimator's start comes from: the log alone, or the reference solution."""


def replay(
    log: str | Path | RecordedLog,
    estimators: EstimatorsLike,
    *,
    start: str = "coarse",
    progress: Progress | None = None,
) -> Report:
    """Run a recorded log through estimators.

    Parameters
    ----------
    log: the path of a flight log, or of a ``.toml`` file that describes the files of a log, or what `insenv.logs.load` gave.
    estimators: one or several, by id or as `Estimator` objects.
    start: "coarse": from the log alone; "reference": from the state of the log's reference solution.
    progress: called with the numbers of samples done and in all.

    Raises `InputError` for what is wrong with the log or the call.
    """
    if start not in STARTS:
        raise InputError(f"start {start!r}: allowed is {' or '.join(STARTS)}")
    chosen = get_all(estimators)
    name = log.description.title if isinstance(log, RecordedLog) else str(log)
    log = log if isinstance(log, RecordedLog) else load(log)
    description = log.description
    begin_s = _begin(log, start)
    first = int(np.searchsorted(log.imu_time - log.dt, begin_s - 1e-9))
    if first >= len(log.imu_time):
        raise InputError(f"[initial] start_s = {begin_s:g} s: the log ends at {log.imu_time[-1]:.3f} s")
    drive = Drive("the log", frozenset() if log.gnss is None else frozenset({"gnss"}))
    for estimator in chosen:
        estimator.check(drive)

    columns, dropped = sample_columns(log, slice(first, None))
    count = len(log.imu_time) - first
    # the reference is compared where it stands: often enough, but not at every sample of a long log
    every = recording_interval(count, 10 * RECORDS)
    total = count // every * every
    tunings = {id: tuning(id, table) for id, table in description.estimator.items()}
    followers = [follower_of(e, e.parameters(_known(log, e, start, first), tunings), every) for e in chosen]
    chunk = max(every, CHUNK // every * every)
    for begin in range(0, total, chunk):
        size = min(chunk, total - begin)
        part = {name: column[begin : begin + size] for name, column in columns.items()}
        for follower in followers:
            follower.follow(part, size)
        if progress is not None:
            progress(begin + size, total)

    times = log.imu_time[first : first + total][every - 1 :: every]
    evaluation = description.evaluation
    reference = _reference_track(log.reference, times)
    from_s = evaluation.from_s if evaluation.from_s is not None else float(times[0])
    to_s = evaluation.to_s if evaluation.to_s is not None else float(times[-1])
    duration = float(log.dt[first : first + total].sum())
    results = tuple(
        _result(f, reference, times, from_s, to_s, (*_assumed(log, f.estimator), *f.notes(duration))) for f in followers
    )
    notes = list(log.notes)
    if log.gaps.count:
        notes.append(f"{log.gaps.count} gaps ({log.gaps.samples} samples) bridged by interpolation")
    if dropped:
        notes.append(f"{dropped} fixes not used: more than one in a sample")
    published = tuple((p.name, dict(p.rms)) for p in evaluation.published)
    return Report(
        scenario=name,
        title=description.title,
        seed=None,
        duration_s=duration,
        imu_samples=total,
        truth=reference,
        results=results,
        notes=tuple(notes),
        published=published,
    )


def _begin(log: RecordedLog, start: str) -> float:
    """Time (s) from which the estimators run: as the log says, or at the first sample (that the reference covers, if it is the
    start)."""
    said = log.description.initial.start_s
    first = float(log.imu_time[0] - log.dt[0])
    if said is not None or start != "reference" or log.reference is None:
        return first if said is None else said
    return max(first, float(log.reference.time[0]))


def _known(log: RecordedLog, estimator: Estimator, start: str, first: int) -> Knowledge:
    """What the estimator is told: an alignment needs the place alone."""
    if start == "reference":
        return from_reference(log, first)
    if not estimator.navigates:
        return _place(log)
    return from_log(log, first)


def _place(log: RecordedLog) -> Knowledge:
    """The place, and a heading only where the log's [initial] gives one."""
    initial, gnss = log.description.initial, log.gnss
    if initial.latitude_deg is not None and initial.longitude_deg is not None:
        height = initial.height_m if initial.height_m is not None else 0.0
        place = (float(np.radians(initial.latitude_deg)), float(np.radians(initial.longitude_deg)), height)
    elif gnss is not None:
        place = (float(gnss.latitude[0]), float(gnss.longitude[0]), float(gnss.height[0]))
    else:
        raise InputError("alignment needs the place: [initial] latitude_deg, longitude_deg and height_m, or [gnss]")
    told = initial.heading_deg
    return Knowledge(
        *place,
        sample_interval=float(np.median(log.dt)),
        heading=0.0 if told is None else float(np.radians(told)),
        heading_sigma=np.pi if told is None else COURSE_SIGMA,
        tilt_sigma=np.pi,
        sensors=log.sensors(in_place=True),
    )


def _assumed(log: RecordedLog, estimator: Estimator) -> tuple[str, ...]:
    """What an alignment assumes of the sensors where the log does not tell."""
    told = log.description.estimator.get(estimator.id, {})
    if estimator.navigates or log.description.imu.grade or any("bias" in key for key in told):
        return ()
    sensors = log.sensors(in_place=True)
    gyro, accel = units.rad_s_to_deg_h(sensors.gyro_bias_sigma), units.m_s2_to_ug(sensors.accel_bias_sigma)
    return (
        f"the stated accuracy assumes gyros good to {gyro:.2g} deg/h and accelerometers to {accel:.3g} ug: say better by "
        f'[imu] grade, or [estimator."{estimator.id}"] gyro_bias_deg_h, accel_bias_ug, arw_deg_sqrt_h, vrw_ug_sqrt_hz',
    )


def _reference_track(reference: Reference | None, times: Array) -> Track:
    """The reference at the times, interpolated; nothing where the log has none."""
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
        at(reference.latitude),
        at(np.unwrap(reference.longitude)),
        at(reference.height),
    )


def _result(follower: Follower, reference: Track, times: Array, from_s: float, to_s: float, notes: tuple[str, ...]) -> Result:
    outputs = follower.named()
    found = errors(track_of(times, outputs), reference)
    # only where there is a reference to compare with, and within the window asked for
    inside = (times <= to_s) & np.all([np.isfinite(e) for e in found.values()] or [np.ones(len(times), bool)], axis=0)
    sigma = stated_sigma(outputs)
    late = inside & (times >= from_s)
    if found and not late.any():
        raise InputError(
            f"nothing to compare: the replay covers {times[0]:.3f} to {times[-1]:.3f} s, [evaluation] asks for {from_s:g} to "
            f"{to_s:g} s, and the reference must cover some of that"
        )
    limit = {name: float(np.sqrt(np.mean(value[late] ** 2))) for name, value in sigma.items()} if late.any() else {}
    return Result(
        estimator=follower.estimator.id,
        time=times[inside],
        outputs={name: value[inside] for name, value in outputs.items()},
        errors={name: value[inside] for name, value in found.items()},
        sigma={name: value[inside] for name, value in sigma.items()},
        limit=limit,
        from_s=from_s,
        us_per_sample=follower.seconds / (len(times) * follower.every) * 1e6,
        notes=notes,
    )
