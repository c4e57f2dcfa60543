"""The TOML file for a flight log, with what the log itself does not hold: lever arm, initial conditions, tuning."""

from __future__ import annotations

from insenv.files.toml import Number, Vector3, key
from insenv.logs.description import AnyLog, Grade, Sigma3
from insenv.logs.flight.formats import SUFFIXES


class FlightDescription(AnyLog):
    """A flight log and additional information about it."""

    flight: str = key(
        ..., f"the log: {SUFFIXES}, relative to this TOML file; .gz and .zip with one file are unpacked", min_length=1
    )
    imu: str = key("", 'the inertial unit, if not the default: "HIGHRES_IMU", "IMU[1]", "sensor_combined"')
    gnss: str = key("", 'the receiver, likewise: "GPS_RAW_INT", "GPS[1]"; "none": without GNSS')
    reference: str = key("", 'the solution for comparison, likewise: "ATTITUDE"; "none": none')
    grade: Grade = key("", "grade of the catalogue (docs/sensors.md) for which estimators are tuned")
    max_gap_s: Number = key(
        1.0, "a longer gap in the samples ends the segment; shorter ones are interpolated and counted", "s", ge=0, le=60
    )
    lever_arm_m: Vector3 = key((0.0, 0.0, 0.0), "from the IMU to the antenna: forward, right, down", "m")
    gnss_delay_s: Number = key(0.0, "delay of the fixes' stamps after their time of validity; subtracted", "s", ge=-5, le=5)
    position_sigma_m: Sigma3 | None = key(None, "standard deviations N, E, D of the fixes, instead of those in the log", "m")
    velocity_sigma_mps: Sigma3 | None = key(None, "standard deviations N, E, D of their velocities, likewise", "m/s")
    undulation_m: Number | None = key(
        None, "height of the geoid above the ellipsoid, where the log has heights above mean sea level", "m"
    )
