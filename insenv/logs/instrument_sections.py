"""The sections of the aiding instruments in the description of a log: columns, places, and the errors of the instrument."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ValidationInfo, field_validator

from insenv.base.toml import Number, Positive, Vector3, key
from insenv.logs.columns import AngleUnit, Column, Columns3, MeasurementSection
from insenv.logs.units import axes_matrix
from insenv.sensors import barometer, dvl, heading, magnetometer, odometer


def _check_axes(value: Any) -> Any:
    axes_matrix(value)
    return value


Axes = Annotated[Any, AfterValidator(_check_axes)]
_AXES = 'axes of the columns: "FRD", "FLU", ... (where x, y, z point), "+x-y-z" (body forward, right, down), or 3x3 C_bs'


class BarometerSection(MeasurementSection, barometer.BarometerFigures):
    """The barometer: heights, and its errors."""

    height: Column = key(..., "column of the height by the air pressure [m], up positive")
    height_offset_m: Number = key(0.0, "added to the height: the geoid undulation for heights above mean sea level", "m")


class MagnetometerSection(MeasurementSection, magnetometer.MagnetometerFigures):
    """The magnetometer: the field in three axes, its errors, and the field of the Earth."""

    field: Columns3 = key(..., "columns of the field's x, y, z")
    field_unit: Literal["T", "uT", "nT", "G", "mG"] = key(..., "unit of these columns")
    axes: Axes = key(..., _AXES)
    year: Number = key(2026.0, "decimal year at which the World Magnetic Model is evaluated", "year")
    field_nt: Vector3 | None = key(
        None, "field of the Earth north, east, down, the same everywhere; that of the World Magnetic Model if absent", "nT"
    )


class OdometerSection(MeasurementSection, odometer.OdometerFigures):
    """The odometer: speeds, and its errors."""

    speed: Column = key(..., "column of the speed, forward positive")
    speed_unit: Literal["m/s", "km/h", "kn"] = key("m/s", "unit of the speed")
    lever_arm_m: Vector3 = key(..., "from the IMU to the wheel: forward, right, down", "m")
    mounting_deg: Vector3 = key((0.0, 0.0, 0.0), "nominal rotation from body to odometer axes, as a rotation vector", "deg")


class DvlSection(MeasurementSection, dvl.DvlFigures):
    """The Doppler velocity log: velocities in three axes, and its errors."""

    velocity: Columns3 = key(..., "columns of the velocity's x, y, z [m/s]")
    axes: Axes = key(..., _AXES)
    lever_arm_m: Vector3 = key(..., "from the IMU to the log: forward, right, down", "m")
    water_track: bool = key(False, "whether the velocity is that through the water", strict=True)


class HeadingSection(MeasurementSection, heading.HeadingFigures):
    """The two-antenna heading: azimuths of the baseline, and its errors."""

    azimuth: Column = key(..., "column of the azimuth of the baseline, clockwise from north")
    azimuth_unit: AngleUnit = key("deg", "unit of the azimuth and of its standard deviation")
    azimuth_sigma: Column | None = key(None, "column of the standard deviation of the azimuth")
    azimuth_sigma_deg: Positive | None = key(
        None, "constant standard deviation, where the log has none", "deg", validate_default=True
    )
    baseline: Columns3 | None = key(None, "columns of the measured baseline north, east, down [m]; absent: the azimuth alone")
    baseline_m: Vector3 = key(..., "from the first to the second antenna: forward, right, down", "m")

    @field_validator("baseline_m")
    @classmethod
    def _baseline(cls, value: Any) -> Any:
        if not any(value):
            raise ValueError("[0, 0, 0] m: allowed is a baseline with a length")
        return value

    @field_validator("azimuth_sigma_deg")
    @classmethod
    def _one_sigma(cls, value: Any, info: ValidationInfo) -> Any:
        if "azimuth_sigma" in info.data and (info.data["azimuth_sigma"] is None) == (value is None):
            raise ValueError("give either azimuth_sigma (a column) or azimuth_sigma_deg (a number [deg])")
        return value


SECTIONS: dict[str, type[MeasurementSection]] = {
    "barometer": BarometerSection,
    "magnetometer": MagnetometerSection,
    "odometer": OdometerSection,
    "dvl": DvlSection,
    "heading": HeadingSection,
}
"""The sections by id of the instrument."""
