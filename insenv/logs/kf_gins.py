"""Text files of KF-GINS, as keys of a log description.

imu: time [s], delta angle x y z [rad], delta velocity x y z [m/s], body FRD, increments over the interval that ends at the
time. gnss: time [s], latitude, longitude [deg], height [m], standard deviations N E D [m]; the variant of 13 columns adds
velocity N E D and its standard deviations [m/s]. nav (reference): GNSS week, time of week [s], latitude, longitude [deg],
height [m], velocity N E D [m/s], roll, pitch, yaw [deg].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

IMU = {
    "time": 0,
    "gyro": (1, 2, 3),
    "accel": (4, 5, 6),
    "kind": "increment",
    "stamp": "interval_end",
    "gyro_unit": "rad",
    "accel_unit": "m/s",
    "axes": "FRD",
}
_POSITION = {"latitude": 1, "longitude": 2, "height": 3}
GNSS = {"time": 0, **_POSITION, "position_sigma": (4, 5, 6), "position_unit": "deg"}
GNSS_VELOCITY = {"velocity": (7, 8, 9), "velocity_sigma": (10, 11, 12)}
"""Further columns of the variant with 13 columns."""
REFERENCE = {
    "time": 1,
    **{name: column + 1 for name, column in _POSITION.items()},
    "velocity": (5, 6, 7),
    "roll": 8,
    "pitch": 9,
    "heading": 10,
    "position_unit": "deg",
    "attitude_unit": "deg",
}
VELOCITY_FIELDS = 13
"""Numbers of fields on a line of the variant of a GNSS file with velocity."""
FIELDS = {"imu": (7,), "gnss": (7, VELOCITY_FIELDS), "reference": (11,)}
"""Allowed numbers of fields on a line, by section."""


def allowed_fields(name: str, section: Any) -> tuple[int, ...] | None:
    """Numbers of fields on a line of the file of a section; None: any."""
    if section.format != "kf-gins":
        return None
    return (VELOCITY_FIELDS,) if name == "gnss" and section.velocity is not None else FIELDS.get(name)


def has_velocity(name: str, section: Any, fields: int) -> bool:
    """Whether a file with so many fields on a line is a GNSS file with velocity columns that its section does not name."""
    return section.format == "kf-gins" and name == "gnss" and fields == VELOCITY_FIELDS and section.velocity is None


def filled(data: Any, fixed: Mapping[str, Any]) -> Any:
    """The section `data` with the keys that the format fixes, if its format is kf-gins; keys in the file win.

    A constant position_sigma_m replaces the columns.
    """
    if not isinstance(data, dict) or data.get("format") != "kf-gins":
        return data
    return {**{name: value for name, value in fixed.items() if f"{name}_m" not in data}, **data}
