"""The TOML file that describes a recorded log: its keys, units and limits (pydantic), read by
`read_description`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Strict, field_validator, model_validator

from insenv.logs import readers
from insenv.logs.fields import (
    AngleUnit,
    Column,
    Columns3,
    Files,
    Number,
    Parameter,
    Positive,
    Section,
    Sigma3,
    Vector3,
    key,
    with_format,
)
from insenv.logs.units import ACCEL_UNITS, GYRO_UNITS, Array, axes_matrix
from insenv.sensors import imu_grade


class _FileSection(Section):
    """Where the columns are and how the file is written."""

    file: Files = key(
        ...,
        "path (relative to this TOML file), or package:NAME/path for a file inside an installed Python "
        "package; "
        ".gz and one-file .zip are unpacked; a list of files joins their columns (same rows, same times)",
    )
    format: Literal["csv", "kf-gins"] = key(
        "csv",
        "csv: any text table, the columns named below; kf-gins: that program's text file, all keys but file set",
    )
    delimiter: Literal["auto", ",", ";", "tab", "space"] = key("auto", "what separates the fields; space: blanks and tabs")
    header_rows: Annotated[int, Strict()] | None = key(
        None,
        "lines before the first row, the last of them holding the column names; absent: found out",
        "lines",
        ge=0,
        le=1000,
    )
    comment: str = key("#", "a line that starts with this character is skipped", min_length=1, max_length=1)
    keep_where: dict[str, Number | list[Number]] = key(
        {}, "use only the rows in which this column has this value (or one of these values)"
    )
    skip_empty: bool = key(
        False,
        "skip rows in which one of the columns is empty (GNSS columns in an IMU-rate file)",
        strict=True,
    )
    time: Column = key(..., "column of the time stamp")
    time_unit: Literal["s", "ms", "us", "ns", "min", "h"] = key("s", "unit of the time column")
    time_scale: Positive = key(1.0, "further factor on the time, for a clock known to run fast or slow")
    time_offset_s: Number = key(0.0, "added to the time after unit and scale; all tables must share one clock", "s")


class ImuSection(_FileSection):
    """The inertial sensor."""

    gyro: Columns3 = key(..., "columns of the gyro's x, y, z")
    accel: Columns3 = key(
        ...,
        "columns of the accelerometer's x, y, z (specific force: about -9.8 on a level down axis at rest)",
    )
    kind: Literal["rate", "increment"] = key(
        ..., "rate: angular rate and specific force; increment: their integrals over the sample"
    )
    stamp: Literal["interval_end", "interval_start", "instant"] = key(
        ...,
        "what the time stamp marks: the end or the start of the interval that the sample covers (a mean rate "
        "or an increment), "
        "or the instant of an instantaneous rate (integrated by the trapezoid)",
    )
    gyro_unit: Literal["rad/s", "deg/s", "rad/h", "deg/h", "rad", "deg"] = key(
        ..., "unit of the gyro columns; rad and deg for increments"
    )
    accel_unit: Literal["m/s2", "g", "mg", "m/s"] = key(
        ..., "unit of the accelerometer columns; m/s for increments; g = 9.80665 m/s2"
    )
    gyro_scale: Positive = key(1.0, "further factor on the gyro columns (unit per count, for raw counts)")
    accel_scale: Positive = key(1.0, "further factor on the accelerometer columns")
    axes: Any = key(
        ...,
        'sensor axes: "FRD", "FLU", "RFU"... (where x, y, z point), "+x-y-z" (body forward, right, down), or 3x3 C_bs',
    )
    accel_axes: Any = key(
        None,
        "the same for the accelerometer where it differs; may be a reflection (a unit that reports minus the force)",
    )
    rate_hz: Positive | None = key(None, "nominal sample rate; absent: from the median step of the time stamps", "Hz", le=1e5)
    grade: str = key(
        "",
        "grade of the catalogue (docs/sensors.md) that estimators are tuned for and state their accuracy by; "
        "[estimator.ID] sets single figures on top",
    )
    max_gap_s: Number = key(
        1.0,
        "a longer hole in the samples ends with an error; shorter ones are bridged and counted",
        "s",
        ge=0,
        le=60,
    )

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        fixed = {
            "kind": "increment",
            "stamp": "interval_end",
            "gyro_unit": "rad",
            "accel_unit": "m/s",
            "axes": "FRD",
        }
        return with_format(data, {**readers.KF_GINS_IMU, **fixed})

    @field_validator("grade")
    @classmethod
    def _grade(cls, value: str) -> str:
        if value:
            imu_grade(value)
        return value

    @field_validator("axes", "accel_axes")
    @classmethod
    def _axes(cls, value: Any, info: Any) -> Any:
        if value is not None:
            axes_matrix(value, reflection_allowed=info.field_name == "accel_axes")
        return value

    @model_validator(mode="after")
    def _units_fit_kind(self) -> ImuSection:
        for name, unit, allowed in (
            ("gyro_unit", self.gyro_unit, GYRO_UNITS[self.kind]),
            ("accel_unit", self.accel_unit, ACCEL_UNITS[self.kind]),
        ):
            if unit not in allowed:
                raise ValueError(f"{name} = {unit!r} does not go with kind = {self.kind!r}: allowed {', '.join(allowed)}")
        if self.kind == "increment" and self.stamp == "instant":
            raise ValueError("stamp = 'instant' does not go with kind = 'increment': allowed interval_end, interval_start")
        return self

    def gyro_matrix(self) -> Array:
        """(3, 3): gyro columns to SI in body FRD."""
        return axes_matrix(self.axes) * (GYRO_UNITS[self.kind][self.gyro_unit] * self.gyro_scale)

    def accel_matrix(self) -> Array:
        """(3, 3): accelerometer columns to SI in body FRD."""
        axes = self.axes if self.accel_axes is None else self.accel_axes
        matrix: Array = axes_matrix(axes, reflection_allowed=True)
        return np.asarray(matrix * (ACCEL_UNITS[self.kind][self.accel_unit] * self.accel_scale))


class _PositionSection(_FileSection):
    latitude: Column = key(..., "column of the geodetic latitude (WGS-84)")
    longitude: Column = key(..., "column of the longitude, east positive")
    height: Column = key(..., "column of the height above the ellipsoid [m], up positive")
    position_unit: AngleUnit = key(..., "unit of latitude and longitude")
    height_offset_m: Number = key(
        0.0, "added to the height: the geoid undulation where the log has heights above sea level", "m"
    )
    velocity: Columns3 | None = key(None, "columns of the velocity north, east, down [m/s]")
    velocity_vertical: Literal["down", "up"] = key("down", "sign of the third velocity column")


class GnssSection(_PositionSection):
    """Position fixes of the antenna, each at its time of validity."""

    position_sigma: Columns3 | None = key(None, "columns of the standard deviations north, east, down [m]")
    position_sigma_m: Sigma3 | None = key(None, "constant standard deviations N, E, D, where the log has none", "m")
    velocity_sigma: Columns3 | None = key(None, "columns of the velocity's standard deviations N, E, D [m/s]")
    velocity_sigma_mps: Sigma3 | None = key(None, "constant velocity standard deviations N, E, D", "m/s")
    lever_arm_m: Vector3 = key(..., "from the IMU to the antenna: forward, right, down", "m")

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        return with_format(data, {**readers.KF_GINS_GNSS, "position_unit": "deg"}, ("position_sigma", "position_sigma_m"))

    @model_validator(mode="after")
    def _sigmas(self) -> GnssSection:
        if (self.position_sigma is None) == (self.position_sigma_m is None):
            raise ValueError("give either position_sigma (three columns) or position_sigma_m (three numbers [m])")
        pair = (self.velocity_sigma is not None) + (self.velocity_sigma_mps is not None)
        if self.velocity is not None and pair != 1:
            raise ValueError("velocity needs either velocity_sigma (three columns) or velocity_sigma_mps (three numbers [m/s])")
        if self.velocity is None and pair and self.format == "csv":
            raise ValueError("velocity_sigma is given without velocity")
        return self


class ReferenceSection(_PositionSection):
    """A reference solution at the IMU, to compare with (and to start from where asked)."""

    roll: Column | None = key(None, "column of the roll (right side down positive)")
    pitch: Column | None = key(None, "column of the pitch (nose up positive)")
    heading: Column | None = key(None, "column of the heading (clockwise from north)")
    attitude_unit: AngleUnit | None = key(None, "unit of roll, pitch, heading")

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        return with_format(data, {**readers.KF_GINS_NAV, "position_unit": "deg", "attitude_unit": "deg"})

    @model_validator(mode="after")
    def _all_three(self) -> ReferenceSection:
        given = [name for name in ("roll", "pitch", "heading", "attitude_unit") if getattr(self, name) is not None]
        if given and len(given) != 4:
            raise ValueError(f"roll, pitch, heading and attitude_unit go together; only {', '.join(given)} given")
        return self


class InitialSection(Section):
    """What is known at the start."""

    start_s: Number | None = key(None, "time at which navigation starts", "s")
    static_from_s: Number | None = key(None, "the vehicle stands still from here (absent: from the first sample)", "s")
    static_until_s: Number | None = key(None, "the vehicle stands still until here", "s")
    latitude_deg: Number | None = key(None, "latitude at the start", "deg", ge=-90, le=90)
    longitude_deg: Number | None = key(None, "longitude at the start", "deg", ge=-360, le=360)
    height_m: Number | None = key(None, "height above the ellipsoid at the start", "m")
    velocity_mps: Vector3 | None = key(None, "velocity north, east, down at the start", "m/s")
    roll_deg: Number | None = key(None, "roll at the start", "deg", ge=-180, le=180)
    pitch_deg: Number | None = key(None, "pitch at the start", "deg", ge=-90, le=90)
    heading_deg: Number | None = key(None, "heading at the start, clockwise from north", "deg", ge=-360, le=360)


class PublishedSection(Section):
    """A published figure to print beside ours."""

    name: str = key(..., "who got it and how")
    rms: dict[str, Number] = key(..., "RMS by output name (north_m, roll_deg, ...), units in the names")


class EvaluationSection(Section):
    """Over which part of the log errors against the reference are taken."""

    from_s: Number | None = key(None, "from this time on", "s")
    to_s: Number | None = key(None, "until this time", "s")
    published: tuple[PublishedSection, ...] = key((), "published figures for the same log")


class LogDescription(Section):
    """A recorded log."""

    title: str = key(..., "one line for tables and figures", min_length=1)
    source: str = key("", "where the log comes from")
    licence: str = key("", "its licence, or that none is stated")
    start_s: Number | None = key(None, "use the log from this time on (its own clock)", "s")
    stop_s: Number | None = key(None, "use the log until this time", "s")
    imu: ImuSection = key(..., "the inertial sensor")
    gnss: GnssSection | None = key(None, "GNSS fixes")
    reference: ReferenceSection | None = key(None, "reference solution")
    initial: InitialSection = key(InitialSection(), "what is known at the start")
    evaluation: EvaluationSection = key(EvaluationSection(), "where errors are taken")
    estimator: dict[str, dict[str, Parameter]] = key(
        {},
        'parameters by estimator id, e.g. [estimator."loosely-coupled"] arw_deg_sqrt_h = 0.3; checked by the estimator',
    )

    @model_validator(mode="after")
    def _window(self) -> LogDescription:
        if self.start_s is not None and self.stop_s is not None and self.stop_s <= self.start_s:
            raise ValueError(f"stop_s = {self.stop_s} s must be after start_s = {self.start_s} s")
        return self
