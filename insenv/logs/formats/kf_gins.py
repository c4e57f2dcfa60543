"""Text files of KF-GINS, as keys of a log description.

imu: time [s], delta angle x y z [rad], delta velocity x y z [m/s], body FRD, increments over the interval that ends at the
time. gnss: time [s], latitude, longitude [deg], height [m], standard deviations N E D [m]; the variant of 13 columns adds
velocity N E D and its standard deviations [m/s]. nav (reference): GNSS week, time of week [s], latitude, longitude [deg],
height [m], velocity N E D [m/s], roll, pitch, yaw [deg].
"""

from __future__ import annotations

from insenv.logs.formats.contract import Format, SectionKeys

_IMU: SectionKeys = {
    "time": 0,
    "gyro": [1, 2, 3],
    "accel": [4, 5, 6],
    "kind": "increment",
    "stamp": "interval_end",
    "gyro_unit": "rad",
    "accel_unit": "m/s",
    "axes": "FRD",
}
_GNSS: SectionKeys = {
    "time": 0,
    "latitude": 1,
    "longitude": 2,
    "height": 3,
    "position_sigma": [4, 5, 6],
    "position_unit": "deg",
}
_GNSS_VELOCITY: SectionKeys = {"velocity": [7, 8, 9], "velocity_sigma": [10, 11, 12]}
_REFERENCE: SectionKeys = {
    "time": 1,
    "latitude": 2,
    "longitude": 3,
    "height": 4,
    "velocity": [5, 6, 7],
    "roll": 8,
    "pitch": 9,
    "heading": 10,
    "position_unit": "deg",
    "attitude_unit": "deg",
}

FORMAT = Format(
    name="kf-gins",
    keys={"imu": _IMU, "gnss": _GNSS, "reference": _REFERENCE},
    further_keys={"gnss": (_GNSS_VELOCITY,)},
)
