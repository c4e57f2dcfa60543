"""The TOML file for a flight log, with what the log itself does not hold: lever arm, initial conditions, tuning."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import model_validator

from insenv.base.toml import Number, Vector3, key
from insenv.logs.description import AnyLog, Grade, Sigma3
from insenv.logs.flight import dataflash, rosbag, telemetry, ulog
from insenv.logs.flight.series import FlightFormat

# The formats of flight logs. To add one: a file beside this one with its `FlightFormat`, and a line in `FORMATS`.

FORMATS = (
    telemetry.FORMAT,
    dataflash.FORMAT,
    ulog.FORMAT,
    *rosbag.FORMATS,
)
SUFFIXES = " or ".join((", ".join(f.suffix for f in FORMATS[:-1]), FORMATS[-1].suffix))
"""The ends of their names, for messages."""


def format_of(name: str | Path) -> FlightFormat | None:
    """The format of a flight log by its name, of which .gz or .zip is ignored; None if it is not a flight log."""
    path = Path(str(name).lower())
    suffix = Path(path.stem).suffix if path.suffix in (".gz", ".zip") else path.suffix
    return next((found for found in FORMATS if found.suffix.lower() == suffix), None)


def is_flight_log(name: str | Path) -> bool:
    """Whether a path is that of a flight log: by its name, or a folder that holds a ROS 2 bag."""
    return format_of(name) is not None or is_bag_folder(Path(name))


def is_bag_folder(path: Path) -> bool:
    """Whether a folder holds a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


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
