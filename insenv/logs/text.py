"""`build`: a recorded log in text files, by its description."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.estimators.parts.rows import FIX_INPUTS
from insenv.geodesy import STANDARD_GRAVITY
from insenv.logs import instruments
from insenv.logs.assemble import LogReader, checked_position, ned_velocity
from insenv.logs.barometric import with_barometer_judged
from insenv.logs.build import LEFT_OUT, check_wander, overlaps, recorded_log, span_of
from insenv.logs.declared_units import check_units
from insenv.logs.description import SLOPES, GnssSection, ImuSection, LogDescription
from insenv.logs.files import Faults
from insenv.logs.formats.csv_table import Column, TextTable
from insenv.logs.inertial import InertialSamples, covered_steps, implausible, increments, sampling
from insenv.logs.magnetic import with_magnetometer_judged
from insenv.logs.recorded import GnssFixes, RecordedLog, fixes_from_course
from insenv.logs.reference import read_reference
from insenv.logs.rest import rest_rate_notes, turn_notes
from insenv.logs.units import ANGLE_UNITS, SPEED_UNITS, wrap
from insenv.sensors import registry, units
from insenv.sensors.imu_tables import without_thermal_errors

# A receiver's values that a logger repeats in every row until the next ones arrive: each counts as one fix, at its first row.
#
# Taken for fixes of their own, they would count a hundred times, late, with errors that are the same in all of them. In an
# outage the last value is repeated for as long as it lasts, and is wrong by the whole way of the vehicle.

MIN_FIXES = 3
"""Different fixes from which the receiver's interval is known."""
MAX_REPEAT_S = 0.05
"""Rows farther apart are a receiver's own: a receiver at rest may state the same place again and again."""


@dataclass(frozen=True)
class Repeats:
    """Rows (k,) that are fixes of their own, and the number of rows that each stands for, in the median."""

    rows: np.ndarray
    each: int


def repeats(time: Array, values: Array) -> Repeats | None:
    """The rows that hold new values; None if the rows are not repetitions.

    time (n,) s; values (n, k): position and, where the receiver has it, velocity.
    """
    if len(time) < 2:
        return None
    new = np.concatenate([[True], (np.diff(values, axis=0) != 0.0).any(axis=1)])
    first = np.flatnonzero(new)
    length = np.diff(np.append(first, len(time)))
    known = len(first) >= MIN_FIXES
    each = int(np.median(length[:-1])) if known else len(time)
    step = float(np.median(np.diff(time)))
    if each < 2 or (not known and step > MAX_REPEAT_S):
        return None
    return Repeats(first, each)


COLDEST, HOTTEST = -100.0, 200.0
"""Temperatures of a unit, deg C: beyond them the column has another unit."""
MAX_RATE = math.radians(1e5)
"""rad/s: no gyro measures more; those of spinning shells go to 2e4 deg/s and beyond."""
MAX_FORCE = 2e5 * STANDARD_GRAVITY
"""m/s^2: no accelerometer measures more; those of impact tests go to 2e5 g."""
_MAX_STEPS = 100.0
"""Median steps that a sample's interval is long at most: beyond it the unit of the column is wrong."""
_MERGED = declared(
    "increments-merged",
    "imu: {count} increments are those of several samples by their size: each covers the time since the one before",
)
_COMPENSATED = declared(
    "thermal-errors-off", "imu: the calibrated thermal errors are subtracted, at {coldest:.3g} to {hottest:.3g} deg C"
)
_REPEATED = declared(
    "fixes-repeated",
    "gnss: {rows} rows repeat {fixes} fixes, each about {each} times: a fix counts once, at its first row",
)


def build(description: LogDescription, folder: Path) -> RecordedLog:
    """The log of a description; relative paths start at `folder`. Raises InputError for any wrong input."""
    reader = LogReader(folder, description.start_s, description.stop_s)
    faults = Faults()
    imu = faults.attempt(lambda: _imu(description.imu, reader))
    gnss = None if description.gnss is None else faults.attempt(partial(_gnss, description.gnss, reader))
    sections = {id: section for id in registry.instruments() if (section := getattr(description, id, None)) is not None}
    measured = [faults.attempt(partial(instruments.read, id, section, reader)) for id, section in sections.items()]
    reference = None
    if description.reference is not None and imu is not None:
        reference = faults.attempt(partial(read_reference, description.reference, reader, imu))
    faults.check()
    assert imu is not None
    if reader.left_out["imu"] <= LEFT_OUT:
        description = description.model_copy(update={"start_s": None})
    span = span_of(imu)
    readings = [each for each in measured if each is not None]
    for name, table in (("gnss", gnss), ("reference", reference), *((each.id, each) for each in readings)):
        if table is not None and not overlaps(table, span):
            raise InputError(
                f"{name}: its times {table.time[0]:.3f} to {table.time[-1]:.3f} s do not overlap the imu's"
                f" {span[0]:.3f} to {span[1]:.3f} s; check time_unit and time_offset_s of both"
            )
    unit = description.imu.unit
    log = recorded_log(
        imu,
        gnss,
        reference,
        readings,
        description=description,
        lever_arm_b=np.array(description.gnss.lever_arm_m if description.gnss else (0.0, 0.0, 0.0)),
        sources=reader.sources,
        notes=[*reader.notes, *turn_notes(imu, gnss)],
        unit=None if unit is None else unit.rows(1.0 / float(np.median(imu.dt))),
    )
    check_units(log)
    log = with_barometer_judged(with_magnetometer_judged(log))
    return replace(log, notes=(*log.notes, *rest_rate_notes(log)))


def _imu(section: ImuSection, reader: LogReader) -> InertialSamples:
    table, stamps = reader.read("imu", section, between=section.kind == "rate")
    sampled = sampling(stamps, section.rate_hz)
    reader.notes += sampled.notes
    spans, of_gyro, of_accel = _spans(section, stamps), section.gyro_matrix(), section.accel_matrix()
    _check_measurable(table, "gyro", section.gyro, section.gyro_unit, MAX_RATE * spans / np.linalg.norm(of_gyro[0]))
    _check_measurable(table, "accel", section.accel, section.accel_unit, MAX_FORCE * spans / np.linalg.norm(of_accel[0]))
    accel = table.columns(section.accel) @ of_accel.T
    samples = np.hstack([table.columns(section.gyro) @ of_gyro.T, accel])
    covered, lengths = None, None if section.interval is None else _intervals(section.interval, table, stamps)
    if section.kind == "increment" and lengths is None:
        covered = covered_steps(stamps, accel, sampled, section.stamp)
        if covered.any():
            reader.notes.append(_MERGED.filled(count=np.count_nonzero(covered)))
    imu = increments(stamps, samples, sampled, section.kind, section.stamp, section.max_gap_s, covered=covered, lengths=lengths)
    if section.temperature is not None:
        celsius = _temperature(section.temperature, table, stamps, imu.imu_time)
        imu = replace(imu, temperature=np.asarray(units.deg_c_to_k(celsius)))
        if any(np.any(getattr(section, slope)) for slope in SLOPES):
            imu = _compensated(section, celsius, imu, reader.notes)
    reader.notes += implausible(imu)
    return imu


def _spans(section: ImuSection, stamps: Array) -> Array:
    """Factors (m,) from a rate to what a sample holds: 1, or of increments the longest of the steps beside the stamp and the
    mean step, s: within a burst of stamps of arrival a sample covers more than the steps beside it.
    """
    if section.kind == "rate":
        return np.ones(stamps.size)
    steps = np.diff(stamps)
    return np.maximum(np.maximum(np.append(steps, 0.0), np.insert(steps, 0, 0.0)), np.mean(steps))


def _check_measurable(table: TextTable, triad: str, names: Sequence[Column], unit: str, most: Array) -> None:
    """Raise `InputError` for a sample beyond `most` (m,), in the unit of its column: no sensor measures it."""
    values = table.columns(names)
    bad = np.abs(values) > most[:, None]
    table.refuse(
        names,
        bad,
        lambda row, axis: (
            f"{triad} is {values[row, axis]:g} {unit}, allowed {-most[row]:.4g} to {most[row]:.4g} {unit}, what "
            f"such sensors measure at most ({np.count_nonzero(bad)} such values); is {triad}_unit right?"
        ),
    )


def _temperature(column: Column, table: TextTable, stamps: Array, time: Array) -> Array:
    """Temperature (n,) deg C of the unit at times (n,), s.  Raises `InputError` for one that no unit has."""
    celsius = table.column(column)
    bad = (celsius < COLDEST) | (celsius > HOTTEST)
    table.refuse([column], bad, lambda row, _: f"temperature is {celsius[row]:g} deg C, allowed {COLDEST:g} to {HOTTEST:g}")
    return np.interp(time, stamps, celsius)


def _compensated(section: ImuSection, celsius: Array, samples: InertialSamples, notes: list[Remark]) -> InertialSamples:
    """The samples without the calibrated thermal errors, by the log's own temperature (n,), deg C."""
    warmth = celsius - section.temperature_reference_degc

    def cleaned(increments: Array, C_bs: Array, bias_slope: Any, scale_slope: Any) -> Array:
        sensed: Array = np.linalg.solve(C_bs, increments.T).T.astype(np.float64)
        clean = without_thermal_errors(sensed, samples.dt, warmth, np.array(bias_slope), units.ppm_to_one(scale_slope))
        return np.asarray(clean @ C_bs.T)

    notes.append(_COMPENSATED.filled(coldest=celsius.min(), hottest=celsius.max()))
    return replace(
        samples,
        delta_angle=cleaned(
            samples.delta_angle,
            section.gyro_axes(),
            units.deg_h_to_rad_s(section.gyro_temperature_slope_deg_h_k),
            section.gyro_scale_factor_slope_ppm_k,
        ),
        delta_velocity=cleaned(
            samples.delta_velocity,
            section.force_axes(),
            units.ug_to_m_s2(section.accel_temperature_slope_ug_k),
            section.accel_scale_factor_slope_ppm_k,
        ),
    )


def _intervals(column: Column, table: TextTable, stamps: Array) -> Array:
    """Lengths (m,) s of the sample intervals as the log states them.  Raises `InputError` for one that no sample has."""
    lengths = table.column(column)
    usual = float(np.median(np.diff(stamps)))
    allowed = f"allowed is above 0 up to {_MAX_STEPS:g} times the median step of the time stamps, {usual:g} s"
    bad = (lengths <= 0.0) | (lengths > _MAX_STEPS * usual)
    table.refuse([column], bad, lambda row, _: f"interval is {lengths[row]:g} s, {allowed}")
    return lengths


def _gnss(section: GnssSection, reader: LogReader) -> GnssFixes:
    course = () if section.course is None else (section.course,)
    table, time = reader.read("gnss", section, optional=course)
    moving = [c for c in (*(section.velocity or ()), section.speed, section.course) if c is not None]
    repeated = repeats(time, np.nan_to_num(table.columns((section.latitude, section.longitude, section.height, *moving))))
    if repeated is not None:
        reader.notes.append(_REPEATED.filled(rows=len(time), fixes=len(repeated.rows), each=repeated.each))
        table, time = table.select(repeated.rows), time[repeated.rows]
    faults = Faults()
    place = faults.attempt(lambda: checked_position("gnss", section, table, reader.notes))
    height = table.column(section.height) + section.height_offset_m
    position_sigma = faults.attempt(lambda: _sigma(table, section.position_sigma, section.position_sigma_m, "m"))
    motion = faults.attempt(lambda: _motion(section, table))
    delivery = faults.attempt(lambda: reader.validity(section, table, time, FIX_INPUTS["gnss_age"].upper))
    faults.check()
    check_wander("gnss.wander_sigma_m", section.wander_sigma_m, position_sigma)
    assert place is not None and position_sigma is not None and motion is not None and delivery is not None
    return GnssFixes(delivery[0], place[0], wrap(place[1]), height, position_sigma, *motion, *delivery[1:])


def _motion(section: GnssSection, table: TextTable) -> tuple[Array | None, Array | None]:
    """Velocity (m, 3) m/s and its standard deviation, or None of both."""
    if section.speed is not None and section.course is not None:
        return _from_course(section, section.speed, section.course, table)
    velocity = ned_velocity(section, table)
    if velocity is None:
        return None, None
    return velocity, _sigma(table, section.velocity_sigma, section.velocity_sigma_mps, "m/s")


def _from_course(section: GnssSection, speed: str | int, course: str | int, table: TextTable) -> tuple[Array, Array]:
    """Velocity (m, 3) m/s and its standard deviation from speed over ground and course."""
    values = table.column(speed) * SPEED_UNITS[section.speed_unit]
    table.refuse([speed], values < 0, lambda row, _: f"speed is {table.column(speed)[row]:g}, must be from 0 up")
    names = None if section.speed_sigma is None else [section.speed_sigma]
    sigma = _sigma(table, names, [section.speed_sigma_mps], "m/s")[:, 0]
    return fixes_from_course(values, table.column(course) * ANGLE_UNITS[section.course_unit], sigma)


def _sigma(table: TextTable, names: Sequence[Column] | None, constant: Any, unit: str) -> Array:
    """(m, k) standard deviations, from k columns or constant. Raises InputError: zero or negative."""
    if names is None:
        return np.tile(np.array(constant, dtype=np.float64), (table.values.shape[0], 1))
    sigma = table.columns(names)
    table.refuse(
        names,
        sigma <= 0,
        lambda row, axis: f"standard deviation is {sigma[row, axis]:g} {unit}, must be above 0",
        "; keep_where can exclude invalid fixes",
    )
    return sigma
