"""A recorded log in the conventions of insenv: SI, radians, body axes FRD, navigation axes NED."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from insenv.estimators import SensorNotes
from insenv.logs.assumed_unit import AssumedUnit, assumed_unit
from insenv.logs.description import LogDescription
from insenv.logs.inertial import InertialSamples
from insenv.logs.units import Array
from insenv.scenario.sensor_notes import sensor_notes
from insenv.sensors import ImuGrade, imu_grade


@dataclass(frozen=True)
class Source:
    """A file that was read: section that it serves, name, rows read, rows used (after keep_where), SHA-256 of its text."""

    section: str
    file: str
    rows_read: int
    rows_used: int
    sha256: str


@dataclass(frozen=True)
class Positions:
    """time (m,) s, on the IMU's clock; latitude, longitude (m,) rad; height (m,) m above the ellipsoid."""

    time: Array
    latitude: Array
    longitude: Array
    height: Array


@dataclass(frozen=True)
class GnssFixes(Positions):
    """Fixes of the antenna at their times of validity.

    position_sigma (m, 3) m, N E D; velocity_n (m, 3) m/s and velocity_sigma (m, 3) m/s, or None.
    """

    position_sigma: Array
    velocity_n: Array | None = None
    velocity_sigma: Array | None = None


@dataclass(frozen=True)
class Reference(Positions):
    """Reference solution at the IMU.

    velocity_n (m, 3) m/s or None; roll, pitch, heading (m,) rad or None, heading in [-pi, pi) clockwise from north.
    """

    velocity_n: Array | None = None
    roll: Array | None = None
    pitch: Array | None = None
    heading: Array | None = None


@dataclass(frozen=True)
class RecordedLog(InertialSamples):
    """A recorded log: its inertial samples and

    gnss, reference: None where the log has none; lever_arm_b (3,) m FRD: from IMU to antenna; sources: the files read;
    notes: remarks for the user; description: of the log, from its TOML file or made for a flight log.
    """

    gnss: GnssFixes | None
    lever_arm_b: Array
    reference: Reference | None
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

    @cached_property
    def assumed(self) -> AssumedUnit | None:
        """What is assumed of the inertial unit; None if the description gives its grade."""
        if self.description.imu.grade:
            return None
        initial, rest = self.description.initial, None
        if initial.static_until_s is not None:
            begin = self.imu_time[0] if initial.static_from_s is None else initial.static_from_s
            rest = (float(begin), initial.static_until_s)
        return assumed_unit(self, rest)

    def sensors(self, in_place: bool) -> SensorNotes:
        """What estimators are tuned by: the grade of the description, or what is assumed of an unknown unit."""
        return sensor_notes(self._grade.parameters(), in_place)

    def motion_errors(self) -> dict[str, Any]:
        """Scale factor and misalignment of the unit, 1 sigma, as the fields of `Knowledge` of that name."""
        rows = self._grade.parameters()
        gyro, accel = (
            float(np.hypot(rows[f"{triad}_scale_factor_sigma"], rows[f"{triad}_misalignment_sigma"]))
            for triad in ("gyro", "accel")
        )
        return {"rotation_error": gyro, "thrust_error": accel}

    @property
    def _grade(self) -> ImuGrade:
        return imu_grade(self.description.imu.grade) if self.assumed is None else self.assumed.grade
