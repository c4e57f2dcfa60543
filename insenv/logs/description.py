"""The TOML file that describes a recorded log: its sections, keys, units and limits (pydantic)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ValidationInfo, field_validator

from insenv import attitude
from insenv.base.errors import nearest
from insenv.base.keys import rows_of
from insenv.base.remarks import clock
from insenv.base.toml import NotNegative as PerAxis
from insenv.base.toml import Number, Parameter, Positive, Rotation, Section, Vector3, key, within
from insenv.base.toml import PerAxis as Signed
from insenv.core.tables import Array
from insenv.logs.columns import (
    AngleUnit,
    Axes,
    Column,
    Columns3,
    Columns4,
    FileSection,
    MeasurementSection,
    PositionUnit,
    Sigma3,
)
from insenv.logs.units import ACCEL_UNITS, GYRO_UNITS, axes_matrix
from insenv.sensors import ImuSection as UnitSection
from insenv.sensors.grade_file import grade_of
from insenv.sensors.units import UNITS
from insenv.vehicles import registry as vehicle_registry


def _check_grade(value: str) -> str:
    if value:
        grade_of(value)
    return value


Grade = Annotated[str, AfterValidator(_check_grade)]


def _up_to(unit: str) -> AfterValidator:
    return within(-UNITS[unit].largest, UNITS[unit].largest)


GyroSlope = Annotated[Signed, _up_to("deg/h/K")]
AccelSlope = Annotated[Signed, _up_to("ug/K")]
ScaleSlope = Annotated[Signed, _up_to("ppm/K")]
SLOPES = (
    "gyro_temperature_slope_deg_h_k", "gyro_scale_factor_slope_ppm_k",
    "accel_temperature_slope_ug_k", "accel_scale_factor_slope_ppm_k",
)  # fmt: skip
"""The calibrated thermal errors of a log's unit."""


class ImuSection(FileSection):
    """The inertial sensor."""

    gyro: Columns3 = key(..., "columns of the gyro's x, y, z")
    accel: Columns3 = key(
        ..., "columns of the accelerometer's x, y, z (specific force: about -9.8 m/s2 on a level down axis at rest)"
    )
    kind: Literal["rate", "increment"] = key(
        ..., "rate: angular rate and specific force; increment: their integrals over the sample"
    )
    stamp: Literal["interval_end", "interval_start", "instant"] = key(
        ...,
        "time of the stamp: end or start of the interval that the sample covers (a mean rate or an increment), or instant of "
        "an instantaneous rate (integrated by the trapezoidal rule)",
    )
    gyro_unit: Literal["rad/s", "deg/s", "rad/h", "deg/h", "rad", "deg"] = key(
        ..., "unit of the gyro columns; rad and deg for increments"
    )
    accel_unit: Literal["m/s2", "g", "mg", "m/s"] = key(
        ..., "unit of the accelerometer columns; m/s for increments; g = 9.80665 m/s2"
    )
    gyro_scale: Positive = key(1.0, "further factor on the gyro columns (unit per count, for raw counts)")
    accel_scale: Positive = key(1.0, "further factor on the accelerometer columns")
    axes: Axes = key(
        ...,
        'sensor axes: "FRD", "FLU", "RFU"... (where x, y, z point), "+x-y-z" (body forward, right, down), or 3x3 C_bs',
    )
    accel_axes: Axes | None = key(
        None, "axes of the accelerometer where they differ; may be a reflection (a unit that reports minus the force)"
    )
    mounting_angles_deg: Rotation = key(
        (0.0, 0.0, 0.0),
        "measured roll, pitch and heading of the unit in the vehicle: the axes that `axes` names are turned by them",
        "deg",
    )
    rate_hz: Positive | None = key(None, "nominal sample rate; absent: from the median step of the time stamps", "Hz", le=1e5)
    grade: Grade = key(
        "",
        "grade of the catalogue (docs/sensors.md), or a grade file (docs/allan.md), for which estimators are tuned and state "
        "their accuracy; [estimator.ID] overrides single parameters",
    )
    unit: UnitSection | None = key(
        None, "data sheet of the unit, with the keys of a scenario's [imu], for one that is not in the catalogue"
    )
    noise_in_motion: bool = key(
        True,
        "whether estimators of a moving vehicle take the white noise of the samples in motion where it exceeds that of the "
        "unit",
        strict=True,
    )
    interval: Column | None = key(
        None, "column of the length of the interval that each sample covers [s]; absent: from the time stamps"
    )
    gyro_temperature_slope_deg_h_k: GyroSlope = key(
        (0.0, 0.0, 0.0), "calibrated bias of the gyros per kelvin, x, y, z of the sensor: taken off the samples", "deg/h/K"
    )
    gyro_scale_factor_slope_ppm_k: ScaleSlope = key(
        (0.0, 0.0, 0.0), "calibrated scale factor of the gyros per kelvin: taken off the samples", "ppm/K"
    )
    accel_temperature_slope_ug_k: AccelSlope = key(
        (0.0, 0.0, 0.0), "calibrated bias of the accelerometers per kelvin: taken off the samples", "ug/K"
    )
    accel_scale_factor_slope_ppm_k: ScaleSlope = key(
        (0.0, 0.0, 0.0), "calibrated scale factor of the accelerometers per kelvin: taken off the samples", "ppm/K"
    )
    temperature_reference_degc: Number = key(20.0, "temperature at which these errors are 0", "deg C", ge=-100, le=200)
    temperature: Column | None = key(
        None, "column of the temperature of the unit [deg C]; the calibrated slopes need it", validate_default=True
    )
    max_gap_s: Number = key(
        1.0, "a longer gap in the samples is an error; shorter ones are interpolated and counted", "s", ge=0, le=60
    )

    # rules between keys are validators of the later key: pydantic checks a whole section only if each key is right

    @field_validator("gyro_unit", "accel_unit")
    @classmethod
    def _unit_fits_kind(cls, value: str, info: ValidationInfo) -> str:
        kind = info.data.get("kind")
        if kind is not None:
            allowed = (GYRO_UNITS if info.field_name == "gyro_unit" else ACCEL_UNITS)[kind]
            if value not in allowed:
                raise ValueError(f"does not go with kind = {kind!r}: allowed {', '.join(allowed)}")
        return value

    @field_validator("unit")
    @classmethod
    def _one_sheet(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and info.data.get("grade"):
            raise ValueError("give either grade (of [imu]) or the section imu.unit, which may have a grade itself")
        return value

    @field_validator("temperature")
    @classmethod
    def _slopes_with_temperature(cls, value: Any, info: ValidationInfo) -> Any:
        slopes = [name for name in SLOPES if np.any(info.data.get(name, 0.0))]
        if slopes and value is None:
            raise ValueError(f"must be given with {' and '.join(slopes)}: the column of the temperature [deg C]")
        return value

    @field_validator("interval")
    @classmethod
    def _mean_over_interval(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and info.data.get("stamp") == "instant":
            raise ValueError("does not go with stamp = 'instant': such a sample covers no interval")
        return value

    @field_validator("stamp")
    @classmethod
    def _stamp_fits_kind(cls, value: str, info: ValidationInfo) -> str:
        if info.data.get("kind") == "increment" and value == "instant":
            raise ValueError("does not go with kind = 'increment': allowed interval_end, interval_start")
        return value

    def gyro_axes(self) -> Array:
        """C_bs (3, 3) of the gyros."""
        return self._mounted(axes_matrix(self.axes))

    def force_axes(self) -> Array:
        """C_bs (3, 3) of the accelerometers; it may be a reflection."""
        axes = self.axes if self.accel_axes is None else self.accel_axes
        return self._mounted(axes_matrix(axes, reflection_allowed=True))

    def _mounted(self, matrix: Array) -> Array:
        if not any(self.mounting_angles_deg):
            return matrix
        angles = np.radians(self.mounting_angles_deg)
        return np.asarray(attitude.numeric.to_dcm(attitude.numeric.from_euler(*angles)) @ matrix)

    def gyro_matrix(self) -> Array:
        """(3, 3): from the gyro columns to SI in body FRD."""
        return self.gyro_axes() * (GYRO_UNITS[self.kind][self.gyro_unit] * self.gyro_scale)

    def accel_matrix(self) -> Array:
        """(3, 3): from the accelerometer columns to SI in body FRD."""
        return np.asarray(self.force_axes() * (ACCEL_UNITS[self.kind][self.accel_unit] * self.accel_scale))


class PositionSection(FileSection):
    """The columns of position and velocity."""

    latitude: Column | None = key(None, "column of the geodetic latitude (WGS-84)")
    longitude: Column | None = key(None, "column of the longitude, east positive")
    height: Column | None = key(None, "column of the height above the ellipsoid [m], up positive")
    position_unit: PositionUnit | None = key(None, "unit of latitude and longitude")
    height_offset_m: Number = key(
        0.0, "added to the height: the geoid undulation where the log has heights above mean sea level", "m"
    )
    velocity: Columns3 | None = key(None, "columns of the velocity north, east, down [m/s]")
    velocity_vertical: Literal["down", "up"] = key("down", "positive direction of the third velocity column")


class GnssSection(PositionSection, MeasurementSection):
    """Position fixes of the antenna, each at its time of validity."""

    latitude: Column = key(..., "column of the geodetic latitude (WGS-84)")
    longitude: Column = key(..., "column of the longitude, east positive")
    height: Column = key(..., "column of the height above the ellipsoid [m], up positive")
    position_unit: PositionUnit = key(..., "unit of latitude and longitude")
    position_sigma: Columns3 | None = key(
        None, "columns of the standard deviations north, east, down of the whole error of a fix, wander included [m]"
    )
    position_sigma_m: Sigma3 | None = key(
        None, "the same, constant, N, E, D, where the log has none", "m", validate_default=True
    )
    velocity_sigma: Columns3 | None = key(None, "columns of the velocity's standard deviations N, E, D [m/s]")
    velocity_sigma_mps: Sigma3 | None = key(None, "constant velocity standard deviations N, E, D", "m/s", validate_default=True)
    speed: Column | None = key(None, "column of the speed over ground, with course instead of velocity")
    speed_unit: Literal["m/s", "km/h", "kn"] = key("m/s", "unit of the speed")
    course: Column | None = key(
        None,
        "column of the course over ground, clockwise from north; may be empty at rest; the vertical velocity is unknown",
        validate_default=True,
    )
    course_unit: AngleUnit = key("deg", "unit of the course")
    speed_sigma: Column | None = key(None, "column of the standard deviation of the speed [m/s]")
    speed_sigma_mps: Positive | None = key(None, "constant standard deviation of the speed", "m/s", validate_default=True)
    lever_arm_m: Vector3 = key(..., "from the IMU to the antenna: forward, right, down", "m", row="antenna_lever_arm")
    lever_arm_sigma_m: PerAxis = key(
        (0.0, 0.0, 0.0), "error of that lever arm, 1 sigma of each axis", "m", row="antenna_lever_arm_sigma"
    )
    delay_sigma_s: Number | None = key(
        None,
        "error of the time of validity, 1 sigma; if absent 0.1 with gyros of 100 deg/h and more, of which the class assumed if "
        "there is no grade counts, and 0 with better ones",
        "s",
        row="gnss_delay_sigma",
        ge=0,
        le=3600,
    )
    wander_sigma_m: PerAxis | None = key(
        None,
        "part of position_sigma that changes slowly, 1 sigma, N, E, D; if absent the stated sigma has 0.95 of its median",
        "m",
        row="fix_wander_sigma",
    )
    wander_time_s: Positive = key(60.0, "correlation time of that part", "s", row="fix_wander_time", le=1e9)

    def stated_errors(self) -> dict[str, Any]:
        """What is stated of the receiver: rows of `sensors.gnss.GNSS_STATED`."""
        return {name: value for name, value in rows_of(self).items() if np.asarray(value).any()}

    @field_validator("position_sigma_m")
    @classmethod
    def _one_position_sigma(cls, value: Any, info: ValidationInfo) -> Any:
        if "position_sigma" in info.data and (info.data["position_sigma"] is None) == (value is None):
            raise ValueError("give either position_sigma (three columns) or position_sigma_m (three numbers [m])")
        return value

    @field_validator("course")
    @classmethod
    def _with_speed(cls, value: Any, info: ValidationInfo) -> Any:
        if "speed" in info.data and (info.data["speed"] is None) != (value is None):
            raise ValueError("speed and course go together")
        if value is not None and info.data.get("velocity") is not None:
            raise ValueError("give either velocity or speed and course")
        return value

    @field_validator("velocity_sigma_mps", "speed_sigma_mps")
    @classmethod
    def _sigma_of_motion(cls, value: Any, info: ValidationInfo) -> Any:
        quantity = "speed" if info.field_name == "speed_sigma_mps" else "velocity"
        if not {quantity, f"{quantity}_sigma"} <= set(info.data):
            return value
        number = (info.data[f"{quantity}_sigma"] is not None) + (value is not None)
        if info.data[quantity] is not None and number != 1:
            column, constant = ("a column", "a number") if quantity == "speed" else ("three columns", "three numbers")
            raise ValueError(f"{quantity} needs either {quantity}_sigma ({column}) or {quantity}_sigma_mps ({constant} [m/s])")
        if info.data[quantity] is None and number:
            raise ValueError(f"{quantity}_sigma is given without {quantity}")
        return value


_TOGETHER: tuple[tuple[str, ...], ...] = (
    ("latitude", "longitude", "height", "position_unit"),
    ("roll", "pitch", "heading", "attitude_unit"),
    ("quaternion", "quaternion_order", "quaternion_direction"),
    ("position_local", "origin_latitude_deg", "origin_longitude_deg", "origin_height_m"),
)
"""Keys of a reference of which all are present, or none."""
_ONE_OF: tuple[tuple[str, ...], ...] = (
    ("latitude", "position_ecef", "position_local"),
    ("velocity", "velocity_ecef"),
    ("roll", "quaternion"),
)
"""Keys of a reference of which at most one is present."""


class ReferenceSection(PositionSection):
    """A reference solution, for comparison and as an optional start: position, velocity and attitude, or some."""

    position_ecef: Columns3 | None = key(None, "columns of the position x, y, z in Earth-centred axes (WGS-84) [m]")
    velocity_ecef: Columns3 | None = key(None, "columns of the velocity in these axes [m/s]; with position_ecef")
    position_local: Columns3 | None = key(
        None,
        "columns of the position [m] along the navigation_axes at an origin; velocity and attitude are then along them too",
    )
    origin_latitude_deg: Number | None = key(None, "latitude of that origin", "deg", ge=-90, le=90)
    origin_longitude_deg: Number | None = key(None, "longitude of that origin", "deg", ge=-360, le=360)
    origin_height_m: Number | None = key(None, "its height above the ellipsoid", "m")
    navigation_axes: Literal["NED", "ENU", "NWU"] = key(
        "NED",
        "where x, y, z of the axes point along which velocity and position_local are given, and from which attitude counts",
    )
    axes: Axes = key(
        "FRD",
        'axes of the body whose attitude it is: "FRD", "FLU", ... (where x, y, z point), "+x-y-z" (body forward, right, down), '
        "or 3x3 C_bs",
    )
    quaternion: Columns4 | None = key(None, "columns of the attitude as a unit quaternion, instead of roll, pitch and heading")
    quaternion_order: Literal["wxyz", "xyzw"] | None = key(None, "order of its columns: the scalar w first or last")
    quaternion_direction: Literal["body-to-nav", "nav-to-body"] | None = key(
        None, "whether it takes components along axes to those along navigation_axes, or back"
    )
    lever_arm_m: Vector3 = key(
        (0.0, 0.0, 0.0),
        "from the IMU to the point whose position and velocity it has: forward, right, down; turned by its attitude, or by "
        "that of each estimate where it has none",
        "m",
    )
    roll: Column | None = key(
        None, "column of the roll, about x (right side down positive in FRD); with pitch, heading and attitude_unit"
    )
    pitch: Column | None = key(None, "column of the pitch, about y (nose up positive in FRD); with roll and heading")
    heading: Column | None = key(
        None,
        "column of the heading, about z from the first of the navigation_axes (NED: clockwise from north); with roll and pitch",
    )
    attitude_unit: AngleUnit | None = key(None, "unit of roll, pitch, heading", validate_default=True)
    attitude_sigma_deg: PerAxis = key(
        (0.0, 0.0, 0.0),
        "error of its roll, pitch and heading, 1 sigma, where it is another estimate: a difference is judged by this and the "
        "sigma of the estimate together",
        "deg",
    )

    @field_validator("attitude_unit")
    @classmethod
    def _all_of_each(cls, value: Any, info: ValidationInfo) -> Any:
        keys = {**info.data, "attitude_unit": value}
        present, faults = [name for name, each in keys.items() if each is not None], []
        for group in _TOGETHER:
            stated = [name for name in group if name in present]
            if stated and len(stated) != len(group) and set(group) <= set(keys):
                faults.append(f"{', '.join(group[:-1])} and {group[-1]} go together; only {', '.join(stated)} given")
        for group in _ONE_OF:
            stated = [name for name in group if name in present]
            if len(stated) > 1:
                faults.append(f"{' and '.join(stated)} exclude one another")
        if "velocity_ecef" in present and "position_ecef" not in present and "position_ecef" in keys:
            faults.append("velocity_ecef needs position_ecef")
        if keys.get("velocity_vertical") == "up" and keys.get("navigation_axes", "NED") != "NED":
            faults.append(f"velocity_vertical = 'up' goes with navigation_axes = 'NED', not {keys['navigation_axes']!r}")
        if keys.get("height_offset_m") and "height" not in present and "height" in keys:
            faults.append("height_offset_m goes with height")
        known = {name for group in _ONE_OF for name in group}
        if known <= set(keys) and not known & set(present):
            faults.append("give the columns of position, velocity or attitude")
        if faults:
            raise ValueError("; ".join(faults))
        return value


class InitialSection(Section):
    """Initial conditions, as far as they are known."""

    start_s: Number | None = key(None, "time at which navigation starts, and of the state that the other keys give", "s")
    static_from_s: Number | None = key(None, "start of the time at rest (absent: the first sample)", "s")
    static_until_s: Number | None = key(None, "end of the time at rest", "s")
    latitude_deg: Number | None = key(None, "initial latitude", "deg", row="latitude", ge=-90, le=90)
    longitude_deg: Number | None = key(None, "initial longitude", "deg", row="longitude", ge=-360, le=360)
    height_m: Number | None = key(None, "initial height above the ellipsoid", "m", row="height")
    velocity_mps: Vector3 | None = key(None, "initial velocity north, east, down", "m/s", row="velocity_n")
    roll_deg: Number | None = key(None, "initial roll", "deg", row="roll", ge=-360, le=360)
    pitch_deg: Number | None = key(None, "initial pitch", "deg", row="pitch", ge=-90, le=90)
    heading_deg: Number | None = key(None, "initial heading, clockwise from north", "deg", row="heading", ge=-360, le=360)
    position_sigma_m: Sigma3 | None = key(
        None, "standard deviations N, E, D of the initial position", "m", row="position_sigma"
    )
    velocity_sigma_mps: Sigma3 | None = key(
        None, "standard deviations N, E, D of the initial velocity", "m/s", row="velocity_sigma"
    )
    tilt_sigma_deg: Number | None = key(
        None, "standard deviation of initial roll and pitch", "deg", row="tilt_sigma", gt=0, le=180
    )
    heading_sigma_deg: Number | None = key(
        None, "standard deviation of the initial heading; 180: the heading is unknown", "deg", row="heading_sigma", gt=0, le=180
    )


class PublishedSection(Section):
    """A published result for the same log, printed for comparison."""

    name: str = key(..., "who obtained it and how")
    rms: dict[str, Number] = key(..., "RMS by output name (north_m, roll_deg, ...), units in the names")


def _after(begin: str) -> Any:
    """Validator of the end of a span of time, whose begin has this key."""

    def check(value: float | None, info: ValidationInfo) -> float | None:
        start = info.data.get(begin)
        if start is not None and value is not None and value <= start:
            raise ValueError(f"must be after {begin} = {clock(start)} s")
        return value

    return check


class EvaluationSection(Section):
    """The part of the log over which errors against the reference are evaluated."""

    from_s: Number | None = key(
        None, "start of the evaluation; absent: an alignment is judged over its last quarter, a navigation from its start", "s"
    )
    to_s: Number | None = key(None, "end of the evaluation", "s")
    published: tuple[PublishedSection, ...] = key((), "published results for the same log")

    _after_from = field_validator("to_s")(_after("from_s"))


class AnyLog(Section):
    """Keys that every log has, whatever its format."""

    title: str = key("", "one line for tables and figures; absent: the name of the log")
    source: str = key("", "origin of the log")
    licence: str = key("", "its licence, or that none is stated")
    start_s: Number | None = key(None, "use the log from this time on (its own clock)", "s")
    stop_s: Number | None = key(None, "use the log until this time", "s")
    vehicle_kind: str = key(
        "", 'kind of the vehicle, as in a scenario ("car", "ship"), by which estimators choose what aids them'
    )
    in_place: bool | None = key(
        None,
        "whether the vehicle stays where it is, within metres; `fusion` without GNSS, odometer or Doppler log then takes a car "
        "or an aircraft to be at rest; absent: unknown, unless the log shows travel",
        strict=True,
    )
    initial: InitialSection = key(InitialSection(), "initial conditions")
    evaluation: EvaluationSection = key(EvaluationSection(), "part of the log that is evaluated")
    estimator: dict[str, dict[str, Parameter]] = key(
        {},
        'parameters by estimator id, e.g. [estimator."loosely-coupled"] arw_deg_sqrt_h = 0.3; checked by the estimator',
    )

    @field_validator("vehicle_kind")
    @classmethod
    def _known_kind(cls, value: str) -> str:
        if value and value not in vehicle_registry.names():
            raise ValueError(f"unknown{nearest(value, vehicle_registry.names())}")
        return value

    _after_start = field_validator("stop_s")(_after("start_s"))


class LogDescription(AnyLog):
    """A recorded log in text files; the sections of its instruments stand beside these."""

    title: str = key(..., "one line for tables and figures", min_length=1)
    imu: ImuSection = key(..., "the inertial sensor")
    gnss: GnssSection | None = key(None, "GNSS fixes")
    reference: ReferenceSection | None = key(None, "reference solution")
