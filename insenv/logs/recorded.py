"""A recorded log in the project's conventions: increments in body FRD, radians, NED; `build` makes it from a
description."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insenv.errors import InputError
from insenv.estimators.contract import SensorNotes
from insenv.logs.assemble import Source, checked_position, column, columns3, read_section, within
from insenv.logs.bridging import Gaps, bridge, nominal_interval
from insenv.logs.description import GnssSection, ImuSection, LogDescription, ReferenceSection
from insenv.logs.readers import KF_GINS_GNSS_VELOCITY, TextTable
from insenv.logs.units import ANGLE_UNITS, Array, wrap
from insenv.scenario.sensor_notes import sensor_notes
from insenv.sensors import imu_grade

__all__ = ["Gaps", "GnssFixes", "RecordedLog", "Reference", "Source", "build"]

_MIN_FORCE, _MAX_FORCE = 8.8, 10.8
"""Median magnitude of the specific force of an Earth-bound vehicle [m/s2]; outside of it a note is made."""


@dataclass(frozen=True)
class GnssFixes:
    """Fixes of the antenna. time (m,) s of validity, on the IMU's clock; latitude, longitude (m,) rad; height
    (m,) m above the ellipsoid; position_sigma (m, 3) m N E D; velocity_n (m, 3) m/s NED and its sigma (m, 3)
    m/s, or None."""

    time: Array
    latitude: Array
    longitude: Array
    height: Array
    position_sigma: Array
    velocity_n: Array | None = None
    velocity_sigma: Array | None = None


@dataclass(frozen=True)
class Reference:
    """Reference solution at the IMU. time (r,) s; latitude, longitude (r,) rad; height (r,) m; velocity_n (r,
    3) m/s NED or None; roll, pitch, heading (r,) rad or None, heading in [-pi, pi) clockwise from north."""

    time: Array
    latitude: Array
    longitude: Array
    height: Array
    velocity_n: Array | None = None
    roll: Array | None = None
    pitch: Array | None = None
    heading: Array | None = None


@dataclass(frozen=True)
class RecordedLog:
    """A recorded log.

    imu_time (n,) s: end of each sample interval; delta_angle (n, 3) rad and delta_velocity (n, 3) m/s, body
    FRD: increments over the interval (bridged samples included); dt (n,) s: its length; gnss, reference: None
    where the log has none; lever_arm_b (3,) m FRD from IMU to antenna; gaps: what was bridged; bridged (n,)
    True for samples put in; sources: the files read; notes: remarks that a user should see; description: the
    file that it was made from.
    """

    imu_time: Array
    delta_angle: Array
    delta_velocity: Array
    dt: Array
    gnss: GnssFixes | None
    lever_arm_b: Array
    reference: Reference | None
    gaps: Gaps
    bridged: np.ndarray
    sources: tuple[Source, ...]
    notes: tuple[str, ...]
    description: LogDescription

    @property
    def rate_hz(self) -> float:
        """Mean sample rate [Hz]."""
        return float(self.dt.size / self.dt.sum())

    @property
    def duration_s(self) -> float:
        """Time covered by the IMU samples [s]."""
        return float(self.imu_time[-1] - self.imu_time[0] + self.dt[0])

    def sensors(self, in_place: bool) -> SensorNotes:
        """What the log says of its unit: the grade of [imu], or what is assumed of an unknown one."""
        grade = self.description.imu.grade
        return sensor_notes(imu_grade(grade).parameters(), in_place) if grade else SensorNotes()


def build(description: LogDescription, folder: Path) -> RecordedLog:
    """The log of a description; relative paths start at `folder`. Raises InputError on any bad input."""
    sources: list[Source] = []
    notes: list[str] = []
    window = (description.start_s, description.stop_s)
    imu = _read_imu(description.imu, folder, window, sources, notes)
    gnss = _read_gnss(description.gnss, folder, window, sources, notes) if description.gnss else None
    reference = _read_reference(description.reference, folder, window, sources, notes) if description.reference else None
    span = (float(imu[0][0]), float(imu[0][-1]))
    for name, table in (("gnss", gnss), ("reference", reference)):
        if table is not None and (table.time[-1] < span[0] or table.time[0] > span[1]):
            raise InputError(
                f"{name}: its times {table.time[0]:.3f} to {table.time[-1]:.3f} s do not overlap the imu's"
                f" {span[0]:.3f} to {span[1]:.3f} s; check time_unit and time_offset_s of both"
            )
    lever = np.array(description.gnss.lever_arm_m if description.gnss else (0.0, 0.0, 0.0))
    time, angle, velocity, dt, bridged, gaps = imu
    return RecordedLog(
        time,
        angle,
        velocity,
        dt,
        gnss,
        lever,
        reference,
        gaps,
        bridged,
        tuple(sources),
        tuple(notes),
        description,
    )


def _read_imu(
    section: ImuSection,
    folder: Path,
    window: tuple[float | None, float | None],
    sources: list[Source],
    notes: list[str],
) -> tuple[Array, Array, Array, Array, np.ndarray, Gaps]:
    expected = (7,) if section.format == "kf-gins" else None
    table, stamps = read_section("imu", section, (*section.gyro, *section.accel), folder, sources, notes, expected)
    stamps, table = within("imu", stamps, table, window)
    interval = nominal_interval(stamps, section.rate_hz)
    gyro = columns3(table, section.gyro) @ section.gyro_matrix().T
    accel = columns3(table, section.accel) @ section.accel_matrix().T
    samples = np.hstack([gyro, accel])
    result = increments(stamps, samples, interval, section.kind, section.stamp, section.max_gap_s)
    sanity(result[2], result[3], notes)
    return result


def increments(
    stamps: Array, samples: Array, interval: float, kind: str, stamp: str, max_gap_s: float
) -> tuple[Array, Array, Array, Array, np.ndarray, Gaps]:
    """Samples without holes as increments: end of each interval (n,) s, delta angle (n, 3) rad, delta velocity (n, 3) m/s,
    length (n,) s, whether it was bridged (n,), and what was.

    stamps (m,) s strictly increasing; samples (m, 6): gyro and accelerometer in SI and body FRD; interval: nominal (s);
    kind, stamp, max_gap_s: see the keys of a log's [imu]. Raises InputError where a hole is longer.
    """
    is_rate = kind == "rate"
    result = bridge(stamps, samples if is_rate else samples / interval, interval, max_gap_s)
    if stamp == "interval_end":
        end, dt = result.time, np.diff(result.time, prepend=result.time[0] - interval)
    elif stamp == "interval_start":
        end = np.append(result.time[1:], result.time[-1] + interval)
        dt = end - result.time
    else:
        end, dt = result.time[1:], np.diff(result.time)
    bridged = ~result.original
    if stamp == "instant":
        integrals = 0.5 * (result.rates[1:] + result.rates[:-1]) * dt[:, None]
        bridged = bridged[1:]
    else:
        integrals = result.rates * dt[:, None]
        if not is_rate:
            integrals[result.original] = samples
    return end, integrals[:, :3].copy(), integrals[:, 3:].copy(), dt, bridged, result.gaps


def sanity(delta_velocity: Array, dt: Array, notes: list[str]) -> None:
    """Notes on a specific force that no Earth-bound vehicle has for long: wrong unit, kind or axes."""
    force = delta_velocity / dt[:, None]
    size = float(np.median(np.linalg.norm(force, axis=1)))
    if not _MIN_FORCE < size < _MAX_FORCE:
        notes.append(
            f"imu: the median specific force is {size:.4g} m/s2, expected about 9.8: check accel_unit, accel_scale, kind"
        )
    elif float(np.median(force[:, 2])) > 0.5 * size:
        notes.append(
            "imu: the specific force points down (+z of FRD); a vehicle at rest has -9.8 there: check axes, accel_axes"
        )


def _position(
    name: str, section: GnssSection | ReferenceSection, table: TextTable, notes: list[str]
) -> tuple[Array, Array, Array, Array | None]:
    latitude, longitude = checked_position(name, section, table, notes)
    velocity = None
    if section.velocity is not None:
        velocity = columns3(table, section.velocity)
        if section.velocity_vertical == "up":
            velocity = velocity * np.array([1.0, 1.0, -1.0])
    return latitude, wrap(longitude), column(table, section.height) + section.height_offset_m, velocity


def _read_gnss(
    section: GnssSection,
    folder: Path,
    window: tuple[float | None, float | None],
    sources: list[Source],
    notes: list[str],
) -> GnssFixes:
    expected = None
    if section.format == "kf-gins":
        expected = (7,) if section.velocity is None else (13,)
    wanted = [section.latitude, section.longitude, section.height]
    wanted += [c for group in (section.position_sigma, section.velocity, section.velocity_sigma) if group for c in group]
    table, time = read_section(
        "gnss",
        section,
        wanted,
        folder,
        sources,
        notes,
        expected,
        more={13: KF_GINS_GNSS_VELOCITY} if expected == (7,) else None,
    )
    if expected == (7,) and table.fields == 13:
        section = section.model_copy(update=KF_GINS_GNSS_VELOCITY)
    time, table = within("gnss", time, table, window)
    latitude, longitude, height, velocity = _position("gnss", section, table, notes)
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
    sigma = columns3(table, names)
    bad = np.argwhere(sigma <= 0)
    if bad.size:
        row, axis = bad[0]
        raise InputError(
            f"{table.where(row)}, column {names[axis]!r}: standard deviation is {sigma[row, axis]:g} {unit}, "
            f"must be above 0"
            f" ({len(bad)} such values; keep_where leaves out fixes that are not valid)"
        )
    return sigma


def _read_reference(
    section: ReferenceSection,
    folder: Path,
    window: tuple[float | None, float | None],
    sources: list[Source],
    notes: list[str],
) -> Reference:
    wanted = [section.latitude, section.longitude, section.height, *(section.velocity or ())]
    attitude = [c for c in (section.roll, section.pitch, section.heading) if c is not None]
    expected = (11,) if section.format == "kf-gins" else None
    table, time = read_section("reference", section, (*wanted, *attitude), folder, sources, notes, expected)
    time, table = within("reference", time, table, window)
    latitude, longitude, height, velocity = _position("reference", section, table, notes)
    if not attitude or section.attitude_unit is None:
        return Reference(time, latitude, longitude, height, velocity)
    roll, pitch, heading = (column(table, c) * ANGLE_UNITS[section.attitude_unit] for c in attitude)
    steep = np.flatnonzero(np.abs(pitch) > math.pi / 2 + 1e-9)
    if steep.size:
        raise InputError(
            f"{table.where(steep[0])}, column {attitude[1]!r}: pitch is {math.degrees(pitch[steep[0]]):.6g} "
            f"deg,"
            " allowed -90 to 90; check attitude_unit and the order of roll, pitch, heading"
        )
    return Reference(time, latitude, longitude, height, velocity, wrap(roll), pitch, wrap(heading))
