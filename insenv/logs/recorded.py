"""A recorded log in the conventions of insenv: SI, radians, body axes FRD, navigation axes NED."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from insenv.base.remarks import Remark
from insenv.core.tables import Array
from insenv.estimators import ImuDataSheet
from insenv.logs.description import LogDescription
from insenv.logs.inertial import InertialSamples
from insenv.logs.noise import AssumedUnit, assumed_unit, densities_in_motion, in_motion
from insenv.sensors import registry
from insenv.sensors.data_sheet import imu_data_sheet, motion_errors
from insenv.sensors.gnss import GnssFixes as GnssFixes
from insenv.sensors.grade_file import grade_of
from insenv.vehicles.registry import traits_of

# Measurements of an aiding instrument in a recorded log.


@dataclass(frozen=True)
class Readings:
    """Measurements of one instrument: its id, the name of the series, time of validity (m,) s, and values (m, k).

    The columns of `values` are the measured rows `rows` of the instrument, one after the other; other rows keep their
    start value.  arrival, age (m,) s: when each measurement arrived, and its age then; None: at its time of validity.
    """

    id: str
    name: str
    time: Array
    values: Array
    rows: tuple[str, ...]
    arrival: Array | None = None
    age: Array | None = None

    def at(self, which: np.ndarray) -> Readings:
        """Those of the measurements that `which` (m,), booleans, selects."""
        arrival, age = (None if each is None else each[which] for each in (self.arrival, self.age))
        return replace(self, time=self.time[which], values=self.values[which], arrival=arrival, age=age)

    def columns(self) -> dict[str, Array]:
        """The values by row, (m, ...)."""
        table, columns, begin = registry.instruments()[self.id].measurement, {}, 0
        for row in self.rows:
            size, shape = table[row].size, table[row].shape
            columns[row] = self.values[:, begin : begin + size].reshape(-1, *shape)
            begin += size
        return columns


def delivered(
    time: Array, arrival: Array | None, age: Array | None, end: Array, dt: Array
) -> tuple[np.ndarray, np.ndarray, Array]:
    """Which measurements the samples that end at `end` (n,) s and are `dt` (n,) s long get: rows, samples, ages on these.

    A measurement belongs to the first sample that ends at or after its arrival, and of several in one sample the last counts.
    time (m,) s: of validity; arrival, age: as of `Readings`.
    """
    arrived = time if arrival is None else arrival
    inside = np.flatnonzero((arrived > end[0] - dt[0]) & (arrived <= end[-1]))
    sample = np.searchsorted(end, arrived[inside], side="left")
    last = np.append(np.diff(sample) > 0, True)[: len(inside)]
    rows, sample = inside[last], sample[last]
    waited = end[sample] - arrived[rows]
    return rows, sample, waited if age is None else waited + age[rows]


@dataclass(frozen=True)
class Source:
    """A file that was read: section that it serves, name, rows read, rows used (after keep_where), SHA-256 of its text."""

    section: str
    file: str
    rows_read: int
    rows_used: int
    sha256: str


@dataclass(frozen=True)
class Reference:
    """Reference solution: time (m,) s, on the IMU's clock, and what the reference has; the rest is None.

    latitude, longitude (m,) rad and height (m,) m above the ellipsoid; velocity_n (m, 3) m/s; roll, pitch, heading (m,)
    rad, heading in [-pi, pi) clockwise from north.  lever_arm_b (3,) m FRD: from the IMU to the point whose position and
    velocity these are; None: they are those of the IMU.  attitude_sigma (3,) rad: standard deviations of the errors of roll,
    pitch and heading; None: it has none.
    """

    time: Array
    latitude: Array | None = None
    longitude: Array | None = None
    height: Array | None = None
    velocity_n: Array | None = None
    roll: Array | None = None
    pitch: Array | None = None
    heading: Array | None = None
    lever_arm_b: Array | None = None
    attitude_sigma: Array | None = None


@dataclass(frozen=True)
class RecordedLog(InertialSamples):
    """A recorded log: its inertial samples and

    gnss, reference: None where the log has none; lever_arm_b (3,) m FRD: from IMU to antenna; sources: the files read;
    notes: remarks for the user; description: of the log, from its TOML file or made for a flight log; unit: parameter rows
    (SI) of the inertial unit, if the log states them; instruments: readings of the aiding instruments; stated_errors: of
    these, by row (`sensors.registry.stated_rows`); settings: parameter rows (SI) by estimator id that the log states, which
    those of the description replace.
    """

    gnss: GnssFixes | None
    lever_arm_b: Array
    reference: Reference | None
    sources: tuple[Source, ...]
    notes: tuple[Remark, ...]
    description: LogDescription
    unit: Mapping[str, Any] | None = None
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    instruments: tuple[Readings, ...] = ()
    stated_errors: Mapping[str, Any] = field(default_factory=dict)

    @property
    def told(self) -> Mapping[str, Any]:
        """The former name of `stated_errors`."""
        warnings.warn("RecordedLog.told is now stated_errors", FutureWarning, stacklevel=2)
        return self.stated_errors

    @property
    def rate_hz(self) -> float:
        """Mean sample rate [Hz]."""
        return float(self.dt.size / self.dt.sum())

    @property
    def duration_s(self) -> float:
        """Time covered by the IMU samples [s]."""
        return float(self.imu_time[-1] - self.imu_time[0] + self.dt[0])

    @property
    def rest(self) -> tuple[float, float] | None:
        """Begin and end of the time at rest [s], as the description states it or the log shows it; None if there is none."""
        initial = self.description.initial
        if initial.static_until_s is None:
            return None
        return float(self.imu_time[0]) if initial.static_from_s is None else initial.static_from_s, initial.static_until_s

    @property
    def is_flight(self) -> bool:
        """Whether it is the log of an autopilot, whose format has its units."""
        return any(source.section == "flight" for source in self.sources)

    @property
    def states_unit(self) -> bool:
        """Whether the description gives the grade of the inertial unit, or the log its parameters."""
        return bool(self.description.imu.grade) or self.unit is not None

    @cached_property
    def assumed(self) -> AssumedUnit | None:
        """What is assumed of the inertial unit; None if the description gives its grade, or the log its parameters."""
        if self.states_unit:
            return None
        return assumed_unit(self, self.rest)

    def sensors(self, in_place: bool) -> ImuDataSheet:
        """What estimators are tuned by: the grade of the description, the unit's own rows, or what is assumed of it.

        On the move the white noise is that of the log in motion, where it exceeds what these say.
        """
        sheet, raised = imu_data_sheet(self._unit_rows, in_place), self.raised_noise
        if in_place or not raised:
            return sheet
        standing = {f"standing_{row}": getattr(sheet, row) for row in raised}
        return replace(imu_data_sheet({**self._unit_rows, **raised}, in_place), **standing)

    @cached_property
    def raised_noise(self) -> dict[str, Any]:
        """Densities of white noise of the log in motion (SI), by row, that exceed those of the unit.

        Empty where the log states the parameters of its unit itself, or its description says that it has no such noise.
        """
        if self.unit is not None or not self.description.imu.noise_in_motion:
            return {}
        gnss, rows = self.gnss, self._unit_rows
        time, speed = np.zeros(0), np.zeros(0)
        if gnss is not None and gnss.velocity_n is not None and gnss.velocity_sigma is not None:
            shown = gnss.velocity_sigma[:, :2].max(axis=1) < NO_INFORMATION
            time, speed = gnss.time[shown], np.hypot(*gnss.velocity_n[shown, :2].T)
        flies = traits_of(self.description.vehicle_kind).flies or (self.is_flight and not self.description.vehicle_kind)
        measured = densities_in_motion(self, in_motion(self, time, speed), flies)
        return {row: np.maximum(rows[row], value) for row, value in measured.items() if value > np.max(rows[row])}

    def motion_errors(self) -> dict[str, Any]:
        """Scale factor and misalignment of the unit, 1 sigma, as the fields of `Knowledge` of that name."""
        return motion_errors(vars(self.sensors(in_place=True)))

    @property
    def _unit_rows(self) -> dict[str, Any]:
        """Parameter rows (SI) of the inertial unit."""
        if self.assumed is not None:
            return self.assumed.grade.parameters()
        if self.unit is not None:
            return dict(self.unit)
        return grade_of(self.description.imu.grade).parameters()


# Velocity from speed over ground and course, which is what receivers report that give no vector.

NO_INFORMATION = 100.0
"""Standard deviation (m/s) of a velocity component that a log does not hold."""
SLOW = 0.5
"""Speed over ground (m/s) below which receivers may leave the course out."""


def course_velocity(speed: Array, course: Array, down: Array) -> Array:
    """Velocity (n, 3) m/s, NED, from speed over ground (m/s), course (rad) and downward velocity (m/s)."""
    return np.stack([speed * np.cos(course), speed * np.sin(course), down], axis=1)


def fixes_from_course(speed: Array, course: Array, sigma: Array) -> tuple[Array, Array]:
    """Velocity (n, 3) m/s, NED, and its standard deviation (n, 3) m/s, from columns of a log.

    speed (n,) m/s; course (n,) rad, NaN where it is missing; sigma (n,) m/s, of each horizontal component. The vertical
    component is unknown. Without a course a speed below `SLOW` is an error of a vehicle at rest, a higher one says nothing.
    """
    known = np.isfinite(course)
    velocity = course_velocity(np.where(known, speed, 0.0), np.where(known, course, 0.0), np.zeros(len(speed)))
    horizontal = np.where(known, sigma, np.where(speed <= SLOW, np.hypot(sigma, speed), NO_INFORMATION))
    return velocity, np.stack([horizontal, horizontal, np.full(len(speed), NO_INFORMATION)], axis=1)
