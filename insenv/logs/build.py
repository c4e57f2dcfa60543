"""Build a `RecordedLog` from a description and its text files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from insenv.errors import InputError
from insenv.logs import kf_gins
from insenv.logs.assemble import LogReader, checked_position
from insenv.logs.description import GnssSection, ImuSection, LogDescription, PositionSection, ReferenceSection
from insenv.logs.inertial import InertialSamples, implausible, increments, nominal_interval
from insenv.logs.motion import rest_until
from insenv.logs.readers import TextTable
from insenv.logs.recorded import GnssFixes, RecordedLog, Reference
from insenv.logs.units import ANGLE_UNITS, Array, wrap


def build(description: LogDescription, folder: Path) -> RecordedLog:
    """The log of a description; relative paths start at `folder`. Raises InputError for any wrong input."""
    reader = LogReader(folder, description.start_s, description.stop_s)
    imu = _imu(description.imu, reader)
    gnss = _gnss(description.gnss, reader) if description.gnss else None
    reference = _reference(description.reference, reader) if description.reference else None
    span = (float(imu.imu_time[0]), float(imu.imu_time[-1]))
    for name, table in (("gnss", gnss), ("reference", reference)):
        if table is not None and (table.time[-1] < span[0] or table.time[0] > span[1]):
            raise InputError(
                f"{name}: its times {table.time[0]:.3f} to {table.time[-1]:.3f} s do not overlap the imu's"
                f" {span[0]:.3f} to {span[1]:.3f} s; check time_unit and time_offset_s of both"
            )
    description = _with_rest(description, imu, gnss, reader.notes)
    return RecordedLog(
        **vars(imu),
        gnss=gnss,
        lever_arm_b=np.array(description.gnss.lever_arm_m if description.gnss else (0.0, 0.0, 0.0)),
        reference=reference,
        sources=tuple(reader.sources),
        notes=tuple(reader.notes),
        description=description,
    )


def _with_rest(description: LogDescription, imu: InertialSamples, gnss: GnssFixes | None, notes: list[str]) -> LogDescription:
    """The description with the end of the time at rest, as the log shows it if the description does not state it."""
    initial = description.initial
    if initial.static_until_s is not None:
        return description
    dt = imu.dt[:, None]
    until = rest_until(imu.imu_time, imu.delta_angle / dt, imu.delta_velocity / dt, gnss, initial.static_from_s)
    if until is None:
        return description
    return description.model_copy(update={"initial": initial.model_copy(update={"static_until_s": until})})


def _imu(section: ImuSection, reader: LogReader) -> InertialSamples:
    expected = kf_gins.IMU_FIELDS if section.format == "kf-gins" else None
    table, stamps = reader.read("imu", section, (*section.gyro, *section.accel), expected)
    interval = nominal_interval(stamps, section.rate_hz)
    gyro = table.columns(section.gyro) @ section.gyro_matrix().T
    accel = table.columns(section.accel) @ section.accel_matrix().T
    samples = np.hstack([gyro, accel])
    found = increments(stamps, samples, interval, section.kind, section.stamp, section.max_gap_s)
    reader.notes += implausible(found)
    return found


def _position(
    name: str, section: PositionSection, table: TextTable, notes: list[str]
) -> tuple[Array, Array, Array, Array | None]:
    latitude, longitude = checked_position(name, section, table, notes)
    velocity = None
    if section.velocity is not None:
        velocity = table.columns(section.velocity)
        if section.velocity_vertical == "up":
            velocity = velocity * np.array([1.0, 1.0, -1.0])
    return latitude, wrap(longitude), table.column(section.height) + section.height_offset_m, velocity


def _gnss(section: GnssSection, reader: LogReader) -> GnssFixes:
    expected, variants = None, {}
    if section.format == "kf-gins" and section.velocity is not None:
        expected = kf_gins.GNSS_VELOCITY_FIELDS
    elif section.format == "kf-gins":
        expected = kf_gins.GNSS_FIELDS
        further = [column for group in kf_gins.GNSS_VELOCITY.values() for column in group]
        variants = dict.fromkeys(kf_gins.GNSS_VELOCITY_FIELDS, further)
    wanted = [section.latitude, section.longitude, section.height]
    wanted += [c for group in (section.position_sigma, section.velocity, section.velocity_sigma) if group for c in group]
    table, time = reader.read("gnss", section, wanted, expected, variants)
    if table.fields in variants:
        section = section.model_copy(update=kf_gins.GNSS_VELOCITY)
    latitude, longitude, height, velocity = _position("gnss", section, table, reader.notes)
    position_sigma = _sigma(table, section.position_sigma, section.position_sigma_m, "m")
    velocity_sigma = None
    if velocity is not None:
        velocity_sigma = _sigma(table, section.velocity_sigma, section.velocity_sigma_mps, "m/s")
    return GnssFixes(time, latitude, longitude, height, position_sigma, velocity, velocity_sigma)


def _sigma(
    table: TextTable,
    names: tuple[str | int, str | int, str | int] | None,
    constant: tuple[float, float, float] | None,
    unit: str,
) -> Array:
    """(m, 3) standard deviations, from columns or constant. Raises InputError: zero or negative."""
    if names is None:
        return np.tile(np.array(constant, dtype=np.float64), (table.values.shape[0], 1))
    sigma = table.columns(names)
    bad = np.argwhere(sigma <= 0)
    if bad.size:
        row, axis = bad[0]
        raise InputError(
            f"{table.where(row)}, column {names[axis]!r}: standard deviation is {sigma[row, axis]:g} {unit}, must be above 0"
            f" ({len(bad)} such values; keep_where can exclude invalid fixes)"
        )
    return sigma


def _reference(section: ReferenceSection, reader: LogReader) -> Reference:
    wanted = [section.latitude, section.longitude, section.height, *(section.velocity or ())]
    attitude = [c for c in (section.roll, section.pitch, section.heading) if c is not None]
    expected = kf_gins.REFERENCE_FIELDS if section.format == "kf-gins" else None
    table, time = reader.read("reference", section, (*wanted, *attitude), expected)
    latitude, longitude, height, velocity = _position("reference", section, table, reader.notes)
    if not attitude or section.attitude_unit is None:
        return Reference(time, latitude, longitude, height, velocity)
    roll, pitch, heading = (table.column(c) * ANGLE_UNITS[section.attitude_unit] for c in attitude)
    steep = np.flatnonzero(np.abs(pitch) > math.pi / 2 + 1e-9)
    if steep.size:
        raise InputError(
            f"{table.where(steep[0])}, column {attitude[1]!r}: pitch is {math.degrees(pitch[steep[0]]):.6g} deg,"
            " allowed -90 to 90; check attitude_unit and the order of roll, pitch, heading"
        )
    return Reference(time, latitude, longitude, height, velocity, wrap(roll), pitch, wrap(heading))
