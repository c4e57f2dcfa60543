"""Results, truth and sensors in the formats of other tools (`write`), and simulated drives as recorded logs (`record`).

The log of a simulated drive has its truth as reference.  The samples, the fixes and the readings of the instruments are those
that estimators get in `insenv.run`, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.errors import InputError, nearest
from insenv.base.installing import need
from insenv.base.keys import keys_of
from insenv.base.remarks import Remark, declared
from insenv.core.runner import Progress, check_progress, make_runner, prepare
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY, Result, Track, stated_sigma, track_of
from insenv.logs import GnssFixes, RecordedLog, Reference
from insenv.logs.description import GnssSection, InitialSection
from insenv.logs.formats import WRITTEN as FORMATS
from insenv.logs.formats import log_tables
from insenv.logs.formats.contract import Columns, Drive, Files, NamedTrack
from insenv.logs.formats.log_tables import tables
from insenv.logs.formats.text_log import file_of
from insenv.logs.inertial import Gaps
from insenv.logs.instruments import description_class, section_of
from insenv.logs.recorded import Readings
from insenv.logs.text import COLDEST, HOTTEST
from insenv.report.files import OutputFolder, file_name, write_contents
from insenv.report.notebook import data_frame
from insenv.report.run_data import RunData
from insenv.scenario import Plant, ScenarioLike, build, load
from insenv.scenario.inputs import bridge_lost, chunks
from insenv.sensors import registry
from insenv.sensors.gnss import FIX
from insenv.sensors.imu import FIGURES
from insenv.sensors.units import ZERO_CELSIUS

if TYPE_CHECKING:
    from pandas import DataFrame

_TRACK = ("q_nb", "velocity_n", "latitude", "longitude", "height")


def check_formats(formats: Iterable[str]) -> tuple[str, ...]:
    """The names, each once.  Raises `InputError` for an unknown one, or one whose package is missing."""
    names = tuple(dict.fromkeys((formats,) if isinstance(formats, str) else formats))
    for name in names:
        if name not in FORMATS:
            raise InputError(f"formats: unknown name {name!r}{nearest(str(name), FORMATS)}")
        form = FORMATS[name]
        if form.module:
            need(f"format {name!r}", form.module, package=form.package, extra=form.extra)
    return names


def needs_log(formats: Iterable[str]) -> bool:
    """Whether one of the formats needs the log of the sensors."""
    return any(FORMATS[name].needs_log for name in formats)


def write(
    source: RunData | RecordedLog,
    folder: str | Path,
    formats: Iterable[str],
    *,
    log: RecordedLog | None = None,
    name: str | None = None,
) -> tuple[Path, ...]:
    """Write the results of a run, the log of a drive, or both, in the formats of other tools; return the paths.

    Parameters
    ----------
    source: the `Report` of a run or a replay, or a `RecordedLog`.
    folder: it is made if it does not exist.  All files are written, or none.
    formats: "csv", "gpx", "kml" of a report; "log", "nmea" of a log; "bag", "mcap", "rerun" of a log and, if there is one, a
        report.
    log: the log of the same drive, beside a report: `record` makes that of a scenario.
    name: first part of the file names; None: the scenario's.

    Raises `InputError` for an unknown format, for one that needs an absent argument, for a package that is missing, or for a
    folder that cannot be written to; `InsenvError` if writing fails.
    """
    report = source if isinstance(source, RunData) else None
    log = source if isinstance(source, RecordedLog) else log
    if report is None and log is None:
        raise InputError(f"source = {source!r}: allowed is a Report or a RecordedLog")
    contents = contents_of(report, log, check_formats(formats), name)
    target = OutputFolder(folder)
    with target.staged() as part:
        write_contents(contents, part)
    return tuple(target.path / each for each in contents)


def contents_of(report: RunData | None, log: RecordedLog | None, formats: Iterable[str], name: str | None = None) -> Files:
    """The contents of all files of some formats, by name.  Raises `InputError` for a format that needs an absent argument."""
    title = report.scenario if report is not None else log.description.title if log is not None else ""
    drive = Drive(name if name is not None else file_name(title or "run"), log)
    if report is not None:
        tracks, results = _tracks(report), {result.estimator: _columns(report, result) for result in report.results}
        drive = Drive(drive.name, log, report.scenario, report.title, tracks, results)
    files: dict[str, str | bytes] = {}
    for format in formats:
        form = FORMATS[format]
        for needed, present, what in ((form.needs_report, report, "a Report"), (form.needs_log, log, "a RecordedLog")):
            if needed and present is None:
                raise InputError(f"format {format!r} needs {what}")
        assert form.write is not None
        files |= form.write(drive)
    return files


def _tracks(report: RunData) -> tuple[NamedTrack, ...]:
    """The truth, or the reference, where it is known, then each estimate."""
    tracks = [_named("truth" if report.seed is not None else "reference", _known(report.truth), {})]
    for result in report.results:
        tracks.append(_named(result.estimator, track_of(result.time, result.outputs), stated_sigma(result.outputs)))
    return tuple(each for each in tracks if len(each.time) and (each.q_nb is not None or each.latitude is not None))


def _named(name: str, track: Track, sigma: Columns) -> NamedTrack:
    """sigma: standard deviations (n,) by channel; empty if none are stated."""

    def of(channels: tuple[str, ...]) -> Array | None:
        return np.stack([sigma[channel] for channel in channels], axis=1) if channels[0] in sigma else None

    place = (track.latitude, track.longitude, track.height)
    return NamedTrack(name, track.time, track.q_nb, track.velocity_n, *place, of(ATTITUDE), of(POSITION), of(VELOCITY))


def _known(track: Track) -> Track:
    """The rows in which all that the track has is known."""
    series = {name: value for name in _TRACK if (value := getattr(track, name)) is not None}
    if not series:
        return Track(track.time[:0])
    known = np.all([np.isfinite(value.reshape(len(value), -1)).all(axis=1) for value in series.values()], axis=0)
    return Track(track.time[known], **{name: value[known] for name, value in series.items()})


def _columns(report: RunData, result: Result) -> Columns:
    """All series of one estimator as columns (n,) by name: time_s, truth, estimate, errors, standard deviations, limit.

    Angles in degrees, positions in degrees and metres, velocities in m/s.
    """
    times = result.time
    columns: Columns = {"time_s": times}
    truth = Track(times, **report.truth.at(times))
    for prefix, track in (("truth", truth), ("estimate", track_of(times, result.outputs))):
        if track.q_nb is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(ATTITUDE, track.euler_deg().T, strict=True)}
        if track.latitude is not None and track.longitude is not None and track.height is not None:
            columns[f"{prefix}_latitude_deg"] = np.degrees(track.latitude)
            columns[f"{prefix}_longitude_deg"] = np.degrees(track.longitude)
            columns[f"{prefix}_height_m"] = track.height
        if track.velocity_n is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(VELOCITY, track.velocity_n.T, strict=True)}
    for prefix, series in (("error", result.errors), ("sigma", result.sigma), ("limit", result.limit_sigma)):
        columns |= {f"{prefix}_{name}": values for name, values in series.items()}
    return columns


def to_dataframes(log: RecordedLog) -> dict[str, DataFrame]:
    """The tables of a log by section (imu, gnss, the instruments, reference) as pandas DataFrames, indexed by time (s).

    The columns are those of the CSV files that `insenv.write` makes of a log.  Raises `InsenvError` if pandas is missing.
    """
    return {name: data_frame(columns.pop("time_s"), columns) for name, columns in tables(log).items()}


# Simulated drives as recorded logs.


def record(
    scenario: ScenarioLike, *, seed: int | None = None, duration_s: float | None = None, progress: Progress | None = None
) -> RecordedLog:
    """Simulate a scenario and return the log of its sensors; its reference is the truth.

    scenario, seed, duration_s, progress: as in `insenv.run`.  ``insenv.replay(record(scenario), ID, start="stated")`` gives the
    outputs of ``insenv.run(scenario, ID)``.  Lost samples are missing in the log; replay bridges them, as a run does.

    Raises `InputError` for an unknown name or a wrong value.
    """
    check_progress(progress)
    plant = build(load(scenario), seed=seed, duration_s=duration_s)
    prepare([plant.model])
    runner = make_runner(plant.model, plant.parameters)
    parts: list[dict[str, Array]] = []
    for begin, count in chunks(plant.samples, 1):
        outputs = plant.model.outputs.unpack(runner.run(count))
        part = {name: np.array(column) for name, column in outputs.items() if not name.startswith("true_")}
        part["lost"] = part["imu_valid"] == 0
        bridge_lost(part)
        parts.append(part)
        if progress is not None:
            progress(begin + count, plant.samples)
    return _log(plant, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _log(plant: Plant, columns: Mapping[str, Array]) -> RecordedLog:
    scenario, time, lost = plant.scenario, columns["time"], columns["lost"].astype(bool)
    if lost.all():
        raise InputError(f"scenario {scenario.name!r}: every inertial sample is lost: there is nothing to record")
    readings = tuple(_readings(id, columns) for id in registry.instruments() if id in scenario.sensors)
    gnss = _fixes(columns) if scenario.gnss is not None else None
    roll, pitch, heading = attitude.numeric.to_euler(columns["q_nb"])
    place = {name: columns[name] for name in ("latitude", "longitude", "height", "velocity_n")}
    reference = Reference(time, **place, roll=roll, pitch=pitch, heading=heading)
    return RecordedLog(
        imu_time=time,
        delta_angle=columns["delta_angle"],
        delta_velocity=columns["delta_velocity"],
        dt=np.full(len(time), plant.sample_interval),
        bridged=lost,
        temperature=columns["imu_temperature"] if _has_place(columns) else None,
        gaps=_gaps(time, lost, plant.sample_interval),
        gnss=gnss if gnss is not None and len(gnss.time) else None,
        lever_arm_b=np.array(scenario.gnss.lever_arm_m if scenario.gnss else (0.0, 0.0, 0.0)),
        reference=reference,
        sources=(),
        notes=(*scenario.notes, *_left_out(plant, columns)),
        description=description_class().model_validate(_description(plant, gnss, readings, reference)),
        unit=scenario.imu.rows(scenario.rate_hz),
        instruments=tuple(each for each in readings if len(each.time)),
        stated_errors=plant.knowledge.instruments,
    )


def _gaps(time: Array, lost: NDArray[np.bool_], interval: float) -> Gaps:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    spans = [(float(time[a] - interval), float(time[b - 1])) for a, b in edges.reshape(-1, 2)]
    longest = max((end - begin for begin, end in spans), default=0.0)
    return Gaps(len(spans), int(lost.sum()), longest, tuple(spans))


def _fixes(columns: Mapping[str, Array]) -> GnssFixes:
    at = columns["gnss_valid"] != 0
    arrival, moving = columns["time"][at], columns["gnss_velocity_valid"][at]
    flags = ("gnss_valid", "gnss_velocity_valid")
    fix: dict[str, Any] = {name.removeprefix("gnss_"): columns[name][at] for name in FIX.names if name not in flags}
    if not (moving.size and moving.all()):
        fix |= {"velocity_n": None, "velocity_sigma": None}
    return GnssFixes(arrival - fix["age"], arrival=arrival, **fix)


def _readings(id: str, columns: Mapping[str, Array]) -> Readings:
    instrument = registry.instruments()[id]
    at = columns[instrument.new] != 0
    names = tuple(row.name for row in instrument.values)
    values = np.concatenate([columns[name][at].reshape(int(at.sum()), -1) for name in names], axis=1)
    arrival, age = columns["time"][at], columns[instrument.age][at]
    return Readings(id, id, arrival - age, values, names, arrival, age)


def _has_place(columns: Mapping[str, Array]) -> bool:
    """Whether a log takes the temperatures of the unit."""
    celsius = columns["imu_temperature"] - ZERO_CELSIUS
    return bool(celsius.min() >= COLDEST and celsius.max() <= HOTTEST)


_LEFT_OUT = declared("left-out-of-log", "the format of a log has no place for: {others}")


def _left_out(plant: Plant, columns: Mapping[str, Array]) -> list[Remark]:
    """Notes on sensors that the format of a log does not have."""
    others = [id for id in plant.scenario.sensors if id != "gnss" and registry.instrument(id) is None]
    others += [] if _has_place(columns) else [f"temperatures of the unit beyond {COLDEST:g} to {HOTTEST:g} deg C"]
    return [_LEFT_OUT.filled(others=", ".join(others))] if others else []


def _description(plant: Plant, gnss: GnssFixes | None, readings: tuple[Readings, ...], reference: Reference) -> dict[str, Any]:
    """Values of the log's description: the unit, the instruments and the start, as stated to the estimators of a run."""
    scenario = plant.scenario
    data: dict[str, Any] = {
        "title": scenario.title,
        "source": f"simulated: scenario {scenario.name or 'without a name'}, seed {plant.seed}, {plant.duration_s:g} s",
        "vehicle_kind": scenario.vehicle.kind,
        "in_place": scenario.vehicle.in_place,
        "initial": _initial(plant),
        "estimator": {id: dict(table) for id, table in scenario.estimator.items()},
        "imu": {
            "file": file_of("imu"),
            **log_tables.IMU,
            "rate_hz": scenario.rate_hz,
            "noise_in_motion": False,  # what its samples show in motion is motion
            "unit": {"grade": scenario.imu.grade, **_common(scenario.imu, _SHEET_KEYS, exclude_defaults=True)},
        },
        "reference": {"file": file_of("reference"), **log_tables.reference_keys(reference)},
    }
    if gnss is not None and len(gnss.time) and scenario.gnss is not None:
        stated = plant.knowledge.instruments
        data["gnss"] = {
            "file": file_of("gnss"),
            **log_tables.gnss_keys(gnss),
            **{key: np.asarray(stated[each.row]).tolist() for key, each in keys_of(GnssSection).items()},
        }
    for each in readings:
        if len(each.time):
            keys = {"file": file_of(each.id), **log_tables.instrument_keys(each)}
            section, allowed = scenario.sensors[each.id], section_of(registry.instruments()[each.id]).model_fields
            data[each.id] = {**_common(section, allowed, mode="json", exclude_none=True), **keys}
    return data


def _common(section: Any, allowed: Container[str], **dumped: Any) -> dict[str, Any]:
    """The keys of a section of a scenario that the section of a log has too: figures, places, water track."""
    return {name: value for name, value in section.model_dump(**dumped).items() if name in allowed}


def _initial(plant: Plant) -> dict[str, Any]:
    """The initial conditions as the estimators of a run know them."""
    known, errors = plant.knowledge, plant.scenario.knowledge
    roll, pitch, heading = known.roll, known.pitch, known.heading
    if abs(pitch) > np.pi / 2:
        roll, pitch, heading = (float(v) for v in attitude.numeric.to_euler(attitude.numeric.from_euler(roll, pitch, heading)))
    values = {**known.rows, "roll": roll, "pitch": pitch, "heading": heading}
    stated = {
        key: degrees_of(values[each.row]) if key.endswith("_deg") else np.asarray(values[each.row]).tolist()
        for key, each in keys_of(InitialSection).items()
    }
    # the angles that the scenario states in degrees as they are there
    return stated | {"tilt_sigma_deg": errors.tilt_sigma_deg, "heading_sigma_deg": min(errors.heading_sigma_deg, 180.0)}


_SHEET_KEYS = (
    *FIGURES, "temperature_start_degc", "temperature_end_degc", "temperature_reference_degc", "temperature_ramp_k_h",
    "warm_up_s",
)  # fmt: skip


def degrees_of(angle: float) -> float:
    """The degrees (float) whose conversion to radians is `angle` (rad), to the bit where such degrees exist.

    Degrees are coarser than radians for about half of the angles: one in ten of these has no such degrees, and the result is
    then the nearest, one unit in the last place away.
    """
    degrees = math.degrees(angle)
    candidates = [degrees]
    for towards in (-math.inf, math.inf):
        near = degrees
        for _ in range(3):
            near = math.nextafter(near, towards)
            candidates.append(near)
    return min(candidates, key=lambda each: (abs(math.radians(each) - angle), abs(each - degrees)))
