"""Flight logs: the TOML file with what such a log does not hold, and the `RecordedLog` of one continuous segment of it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import model_validator

from insenv.base.errors import InputError, nearest
from insenv.base.remarks import Remark, declared
from insenv.base.toml import NotNegative, Number, Vector3, key, validated
from insenv.core.tables import Array
from insenv.logs.barometric import with_barometer_judged
from insenv.logs.build import LEFT_OUT, check_wander, overlaps, place_of, recorded_log, span_of
from insenv.logs.columns import before, window_words
from insenv.logs.description import AnyLog, Grade, LogDescription, Sigma3
from insenv.logs.files import read_bytes
from insenv.logs.formats import SUFFIXES, Format, flight_format
from insenv.logs.formats.series import FixSeries, Flight, ImuSeries, SolutionSeries, rows_of
from insenv.logs.formats.vehicle_parameters import lever_arm, settings, unit_rows
from insenv.logs.inertial import implausible, increments, sampling
from insenv.logs.instruments import description_class
from insenv.logs.magnetic import with_magnetometer_judged
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, Reference, Source
from insenv.logs.units import wrap

USABLE_HZ = 20.0
"""Lowest rate at which the attitude can be propagated through a vehicle's turns."""
SLOW_HZ = 90.0
RESTART_S = 1.0
"""A clock that goes back by more has restarted; by less, samples are out of order."""
POSITION_SIGMA = (2.5, 2.5, 5.0)
"""Assumed if a log states no accuracy: a single-frequency receiver under open sky (m)."""
VELOCITY_SIGMA = (0.3, 0.3, 0.5)
_NONE = "none"
AnySeries = TypeVar("AnySeries", ImuSeries, FixSeries, SolutionSeries, Readings)

_NO_FIXES = declared("log-without-fixes", "no GNSS: the log has no fixes")
_FIXES_UNUSED = declared("fixes-unused", "no GNSS: the log's fixes are not used")
_GNSS_ELSEWHEN = declared(
    "fixes-no-overlap", "no GNSS: its times do not overlap those of the inertial unit, {begin:.3f} to {end:.3f} s"
)
_SIMULATED_UNIT = declared(
    "unit-simulated", "the data sheet of the inertial unit is that of the simulated one, by the parameters in the log"
)
_SETTINGS = declared("settings-of-log", "settings of {estimators} by the parameters in the log")
_UNIT = declared("unit-used", "inertial unit: {name} at {rate:.4g} Hz (in the log: {units})")
_LOW_RATE = declared("rate-low", "{rate:.3g} Hz is a low rate: motion between the samples, such as vibration, is lost")
_NOT_FINITE = declared("samples-not-finite", "{count} samples with values that are not finite are skipped")
_RECEIVER = declared("receiver-used", "GNSS: {name}, {count} fixes")
_SEA_LEVEL = declared(
    "heights-above-sea", "{name}: heights above mean sea level are used as ellipsoidal heights (undulation_m corrects it)"
)
_NO_VELOCITY = declared("fixes-without-velocity", "{name}: no velocity")
_LEVER_ARM = declared(
    "lever-arm-of-log",
    "lever arm of the antenna {numbers} m (forward, right, down), by the parameters {names} in the log",
)
_PLACE_OF = declared("place-of", "the place is that of {name}, {latitude:.6f}, {longitude:.6f} deg")
_ACCURACY_ASSUMED = declared("accuracy-assumed", "the log states no accuracy of the fixes' {what}: {numbers} (N, E, D) assumed")
_REFERENCE_TRUE = declared("reference-true", "reference: {name}, a simulator's truth")
_REFERENCE_ESTIMATE = declared(
    "reference-estimate", "reference: {name}, the vehicle's own estimate: errors against it are differences"
)
_ATTITUDE_ALONE = declared("reference-attitude", "{name}: attitude without {lacking}")
_SORTED = declared("samples-sorted", "{count} samples are repeated or out of order: they are sorted, and each time counts once")
_LONGEST = declared(
    "segment-longest",
    "{count} segments between restarts and gaps longer than {gap:g} s: the longest is used, {begin:.3f} to {end:.3f} s "
    "(start_s and stop_s select another one)",
)
_NO_RESTART = declared("restart-missing", "{what}: {name} lacks a restart of the clock that the inertial unit has: not used")


SLOW = ("fix_wander_sigma", "fix_common_sigma")
"""Parameter rows of estimators that gnss_wander_sigma_m goes before."""


class FlightDescription(AnyLog):
    """A flight log and additional information about it."""

    flight: str = key(
        ...,
        f"the log: {SUFFIXES}, or the folder of a ROS 2 bag, relative to this TOML file; .gz and .zip with one file are "
        "unpacked",
        min_length=1,
    )
    imu: str = key("", 'the inertial unit, if not the default: "HIGHRES_IMU", "IMU[1]", "sensor_combined"')
    gnss: str = key("", 'the receiver, likewise: "GPS_RAW_INT", "GPS[1]"; "none": without GNSS')
    reference: str = key("", 'the solution for comparison, likewise: "ATTITUDE"; "none": none')
    grade: Grade = key("", "grade of the catalogue (docs/sensors.md), or a grade file (docs/allan.md), of the unit")
    max_gap_s: Number = key(
        1.0, "a longer gap in the samples ends the segment; shorter ones are interpolated and counted", "s", ge=0, le=60
    )
    lever_arm_m: Vector3 | None = key(
        None, "from the IMU to the antenna: forward, right, down; absent: by the parameters in the log, or 0", "m"
    )
    gnss_time_offset_s: Number = key(
        0.0, "added to the fixes' stamps, as time_offset_s of other logs; negative where they are late", "s", ge=-5, le=5
    )
    position_sigma_m: Sigma3 | None = key(None, "standard deviations N, E, D of the fixes, instead of those in the log", "m")
    gnss_wander_sigma_m: NotNegative | None = key(
        None, "the part of them that changes slowly, with a correlation time of 60 s", "m"
    )
    velocity_sigma_mps: Sigma3 | None = key(None, "standard deviations N, E, D of their velocities, likewise", "m/s")
    undulation_m: Number | None = key(
        None, "height of the geoid above the ellipsoid, where the log has heights above mean sea level", "m"
    )

    @model_validator(mode="before")
    @classmethod
    def _one_sign(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(delay := data.get("gnss_delay_s"), (int, float)):
            raise ValueError(
                f"gnss_delay_s = {delay:g} s: offsets of clocks are added to the stamps in all logs: write gnss_time_offset_s ="
                f" {-delay:g}"
            )
        return data


def build_flight(description: FlightDescription, folder: Path) -> RecordedLog:
    """The log of a description; a relative path starts at `folder`. Raises InputError for any wrong input."""
    form = flight_format(folder / description.flight)
    if form is None:
        raise InputError(
            f"flight = {description.flight!r}: its name must end in {SUFFIXES} (or that and .gz, .zip), or it is"
            " the folder of a ROS 2 bag"
        )
    label, data = read_bytes(description.flight, folder)
    flight = _read(form, label, data)
    notes = list(flight.notes)
    imu, part, left_out = _imu(label, form, flight, description, notes)
    if left_out <= LEFT_OUT:
        description = description.model_copy(update={"start_s": None})
    sampled = sampling(imu.time, None, imu.name)
    notes += sampled.notes
    samples = np.hstack([imu.rate_ib_b, imu.specific_force_b])
    inertial = increments(imu.time, samples, sampled, "rate", imu.stamp, description.max_gap_s, imu.name)
    notes += implausible(inertial)
    span = span_of(inertial)

    fixes = _chosen(label, "gnss", flight.fixes, description.gnss, part, notes)
    if fixes is None:
        notes.append(_FIXES_UNUSED if flight.fixes else _NO_FIXES)
    undulation = description.undulation_m
    if undulation is None and fixes is not None:
        undulation = fixes.undulation
    gnss = None if fixes is None else _gnss(fixes, description, undulation, notes)
    solution = _chosen(label, "reference", flight.solutions, description.reference, part, notes)
    if gnss is not None and not overlaps(gnss, span):
        notes.append(_GNSS_ELSEWHEN.filled(begin=span[0], end=span[1]))
        gnss = None
    reference = None if solution is None else _reference(solution, span, undulation or 0.0, notes)
    arm = _lever_arm(flight, description, gnss is not None, notes)
    description = _placed(flight, description, gnss, notes)
    unit = None if description.grade else unit_rows(flight.parameters)
    tuned = settings(flight.parameters)
    if description.gnss_wander_sigma_m is not None:  # goes before what the log says that its estimators were told
        tuned = {id: {name: row for name, row in rows.items() if name not in SLOW} for id, rows in tuned.items()}
    if unit is not None:
        notes.append(_SIMULATED_UNIT)
    if tuned:
        notes.append(_SETTINGS.filled(estimators=", ".join(tuned)))
    log = recorded_log(
        inertial,
        gnss,
        reference,
        _readings(flight, part, span, undulation or 0.0, place_of(gnss, description) is not None),
        description=_as_log_description(description, label, form, imu, fixes, arm),
        lever_arm_b=arm,
        sources=[Source("flight", label, flight.rows, len(imu.time), hashlib.sha256(data).hexdigest())],
        notes=notes,
        unit=unit,
        settings=tuned,
        unix=flight.unix,
    )
    return with_barometer_judged(with_magnetometer_judged(log))


def _read(form: Format, label: str, data: bytes) -> Flight:
    """The series of a log, those that it does not have left out, units by their rate and a simulator's truth first."""
    assert form.read_flight is not None
    try:
        flight = form.read_flight(label, data)
    except InputError:
        raise
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:  # wrong names or sizes of columns in a damaged file
        raise InputError(f"{label}: the log is damaged, or of an unknown kind: {type(error).__name__}: {error}") from None
    solutions = [each for each in flight.solutions if each is not None]
    solutions.sort(key=lambda solution: not solution.true)
    return replace(
        flight,
        imus=sorted(flight.imus, key=lambda imu: -imu.rate_hz),
        fixes=[each for each in flight.fixes if each is not None],
        solutions=solutions,
    )


def _chosen(
    label: str, section: str, series: Sequence[AnySeries | None], name: str, part: int, notes: list[Remark]
) -> AnySeries | None:
    """The series of a name, or the first, in the segment after `part` restarts; None if there is none."""
    chosen = _named(label, section, series, name)
    return None if chosen is None else only(chosen, part, section, notes)


def _named(label: str, section: str, series: Sequence[AnySeries | None], name: str) -> AnySeries | None:
    if name == _NONE or not (name or series):
        return None
    chosen = next((each for each in series if each is not None and name in ("", each.name)), None)
    if chosen is None:
        names = [each.name for each in series if each is not None]
        raise InputError(f"{label}: no {section} {name!r} in the log{nearest(name, names)}")
    return chosen


def _readings(flight: Flight, part: int, span: tuple[float, float], undulation: float, placed: bool) -> list[Readings]:
    """The readings of the segment that is used, heights above the ellipsoid; those of a magnetometer only with a place."""
    readings = []
    for series in flight.readings:
        each = None if series is None else only(series, part, series.id, [])
        if each is None or not overlaps(each, span) or (each.id == "magnetometer" and not placed):
            continue
        readings.append(replace(each, values=each.values + undulation) if each.id == "barometer" else each)
    return readings


def _imu(
    label: str, form: Format, flight: Flight, description: FlightDescription, notes: list[Remark]
) -> tuple[ImuSeries, int, int]:
    """The unit's samples of one segment, the number of restarts of the clock before them, and of samples before start_s."""
    units = ", ".join([f"{imu.name} at {imu.rate_hz:.3g} Hz" for imu in flight.imus] + list(flight.others)) or "none at all"
    imu = _named(label, "imu", flight.imus, description.imu)
    if imu is None or imu.rate_hz < USABLE_HZ:
        raise InputError(
            f"{label}: this {form.kind} has no inertial unit at a usable rate, {USABLE_HZ:g} Hz or more: found {units};"
            f" {form.hint}"
        )
    notes.append(_UNIT.filled(name=imu.name, rate=imu.rate_hz, units=units))
    if imu.rate_hz < SLOW_HZ:
        notes.append(_LOW_RATE.filled(rate=imu.rate_hz))
    finite = np.isfinite(imu.rate_ib_b).all(axis=1) & np.isfinite(imu.specific_force_b).all(axis=1)
    if not finite.all():
        notes.append(_NOT_FINITE.filled(count=np.count_nonzero(~finite)))
    low = -np.inf if description.start_s is None else description.start_s
    high = np.inf if description.stop_s is None else description.stop_s
    early = before(imu.time, low)
    inside = np.asarray(finite & ~early & ~before(-imu.time, -high))
    if np.count_nonzero(inside) < 3:
        raise InputError(
            f"{label}: {np.count_nonzero(inside)} samples of {imu.name}"
            f" {window_words(description.start_s, description.stop_s)}: its times are {imu.time.min():.3f} to"
            f" {imu.time.max():.3f} s"
        )
    return *longest(imu, inside, description.max_gap_s, notes), int(np.count_nonzero(early))


def _gnss(fixes: FixSeries, description: FlightDescription, undulation: float | None, notes: list[Remark]) -> GnssFixes:
    notes.append(_RECEIVER.filled(name=fixes.name, count=len(fixes.time)))
    height = fixes.height
    if fixes.height_sea:
        if undulation is None:
            notes.append(_SEA_LEVEL.filled(name=fixes.name))
        height = height + (undulation or 0.0)
    position_sigma = _sigma(fixes.position_sigma, fixes, description.position_sigma_m, POSITION_SIGMA, "position", notes)
    check_wander("gnss_wander_sigma_m", description.gnss_wander_sigma_m, position_sigma)
    velocity_sigma = None
    if fixes.velocity_n is None:
        notes.append(_NO_VELOCITY.filled(name=fixes.name))
    else:
        velocity_sigma = _sigma(fixes.velocity_sigma, fixes, description.velocity_sigma_mps, VELOCITY_SIGMA, "velocity", notes)
    time = fixes.time + description.gnss_time_offset_s
    return GnssFixes(time, fixes.latitude, wrap(fixes.longitude), height, position_sigma, fixes.velocity_n, velocity_sigma)


def _lever_arm(flight: Flight, description: FlightDescription, fixes: bool, notes: list[Remark]) -> Array:
    """Lever arm (3,) m: of the description, or by the parameters in the log, or 0."""
    if description.lever_arm_m is not None:
        return np.array(description.lever_arm_m)
    stated = lever_arm(flight.parameters) if fixes else None
    if stated is None:
        return np.zeros(3)
    arm, names = stated
    numbers = ", ".join(f"{value:.3g}" for value in arm)
    notes.append(_LEVER_ARM.filled(numbers=numbers, names=names))
    return arm


def _placed(flight: Flight, description: FlightDescription, gnss: GnssFixes | None, notes: list[Remark]) -> FlightDescription:
    """The description with the place that the log states, if there are neither fixes nor a place in `[initial]`."""
    place, initial = flight.place, description.initial
    if place is None or gnss is not None or initial.latitude_deg is not None or initial.longitude_deg is not None:
        return description
    latitude, longitude = np.degrees([place.latitude, place.longitude])
    notes.append(_PLACE_OF.filled(name=place.name, latitude=latitude, longitude=longitude))
    height = place.height + (description.undulation_m or 0.0 if place.height_sea else 0.0)
    values = {"latitude_deg": float(np.degrees(place.latitude)), "longitude_deg": float(np.degrees(place.longitude))}
    if initial.height_m is None:
        values["height_m"] = height
    return description.model_copy(update={"initial": initial.model_copy(update=values)})


def _sigma(
    stated: Array | None,
    fixes: FixSeries,
    wanted: tuple[float, ...] | None,
    assumed: tuple[float, ...],
    what: str,
    notes: list[Remark],
) -> Array:
    if wanted is None and stated is not None and not np.isnan(stated).any():
        return stated
    if wanted is None:
        numbers = ", ".join(f"{value:g}" for value in assumed)
        notes.append(_ACCURACY_ASSUMED.filled(what=what, numbers=numbers))
    return np.tile(np.array(assumed if wanted is None else wanted), (len(fixes.time), 1))


def _reference(solution: SolutionSeries, span: tuple[float, float], undulation: float, notes: list[Remark]) -> Reference | None:
    inside = (solution.time >= span[0]) & (solution.time <= span[1])
    if np.count_nonzero(inside) < 2:
        return None
    notes.append((_REFERENCE_TRUE if solution.true else _REFERENCE_ESTIMATE).filled(name=solution.name))
    columns = {each.name: getattr(rows_of(solution, inside), each.name) for each in fields(Reference)}
    columns |= {name: wrap(columns[name]) for name in ("longitude", "roll", "heading") if columns[name] is not None}
    if columns["height"] is not None and solution.height_sea:
        columns["height"] = columns["height"] + undulation
    lacking = [what for what, name in (("position", "latitude"), ("velocity", "velocity_n")) if columns[name] is None]
    if lacking:
        notes.append(_ATTITUDE_ALONE.filled(name=solution.name, lacking=" and ".join(lacking)))
    return Reference(**columns)


def _as_log_description(
    description: FlightDescription,
    label: str,
    form: Format,
    imu: ImuSeries,
    fixes: FixSeries | None,
    arm: Array,
) -> LogDescription:
    """The flight log as a description of text files: what a run reads of a description, and the columns that were used."""
    data: dict[str, Any] = {
        "title": description.title or Path(label).name,
        "source": description.source or f"{form.kind} {label}",
        "licence": description.licence,
        "start_s": description.start_s,
        "stop_s": description.stop_s,
        "imu": {
            "file": label,
            "time": "time",
            "gyro": [f"{imu.name}.rate_{axis}" for axis in "xyz"],
            "accel": [f"{imu.name}.force_{axis}" for axis in "xyz"],
            "kind": "rate",
            "stamp": imu.stamp,
            "gyro_unit": "rad/s",
            "accel_unit": "m/s2",
            "axes": "FRD",
            "grade": description.grade,
            "max_gap_s": description.max_gap_s,
        },
        "vehicle_kind": description.vehicle_kind,
        "in_place": description.in_place,
        "evaluation": description.evaluation.model_dump(),
        "estimator": description.estimator,
    }
    if fixes is not None:
        place = {name: f"{fixes.name}.{name}" for name in ("latitude", "longitude", "height")}
        data["gnss"] = {
            "file": label,
            "time": "time",
            **place,
            "position_unit": "rad",
            "position_sigma": [f"{fixes.name}.sigma_{axis}" for axis in "ned"],
            "lever_arm_m": arm.tolist(),
            "wander_sigma_m": description.gnss_wander_sigma_m,
        }
    return validated(description_class(), data, label).model_copy(update={"initial": description.initial})


# Restarts of the clock, gaps, samples twice or out of order.


def restarts(time: Array) -> np.ndarray:
    """Number of restarts of the clock before each row: (n,) integers."""
    return np.concatenate([[0], np.cumsum(np.diff(time) < -RESTART_S)]).astype(np.int64)


def ordered(series: AnySeries) -> tuple[AnySeries, int]:
    """The series in order of time, each time once; number of rows removed or moved."""
    steps = np.diff(series.time)
    wrong = int(np.count_nonzero(steps <= 0.0))
    if not wrong:
        return series, 0
    _, first = np.unique(series.time, return_index=True)
    return rows_of(series, first), wrong


def longest(imu: ImuSeries, inside: np.ndarray, max_gap_s: float, notes: list[Remark]) -> tuple[ImuSeries, int]:
    """The samples `inside` of the longest segment without a restart or a gap longer than `max_gap_s`, in order of time.

    Returns them and the number of restarts before them. Appends to `notes`.
    """
    part = restarts(imu.time)
    nominal = 1.0 / imu.rate_hz
    best: tuple[float, ImuSeries, int] | None = None
    count, moved = 0, 0
    for number in np.unique(part[inside]):
        piece, wrong = ordered(rows_of(imu, np.flatnonzero(inside & (part == number))))
        moved += wrong
        edges = np.flatnonzero(np.diff(piece.time) > max_gap_s + nominal)
        for begin, end in zip([0, *(edges + 1)], [*(edges + 1), piece.time.size], strict=True):
            count += 1
            duration = float(piece.time[end - 1] - piece.time[begin])
            if best is None or duration > best[0]:
                best = duration, rows_of(piece, np.arange(begin, end)), int(number)
    assert best is not None  # `inside` is not empty
    _, chosen, number = best
    if moved:
        notes.append(_SORTED.filled(count=moved))
    if count > 1:
        notes.append(_LONGEST.filled(count=count, gap=max_gap_s, begin=chosen.time[0], end=chosen.time[-1]))
    return chosen, number


def only(series: AnySeries, part: int, what: str, notes: list[Remark]) -> AnySeries | None:
    """The rows after `part` restarts, in order; None, with a note, if the series has fewer restarts."""
    of = restarts(series.time)
    if part > of[-1]:
        notes.append(_NO_RESTART.filled(what=what, name=series.name))
        return None
    return ordered(rows_of(series, np.flatnonzero(of == part)))[0]
