"""The fields of a VectorNav's binary outputs, from the streamed vehicle's sensors and its estimator's state.

An output is a set of fields, chosen by a mask per group of fields; `FIELDS` holds those that the simulation can fill.  Units
are those of the manual: deg, m, m/s, rad/s, m/s^2, gauss, kPa, deg C, ns.  Axes of the body are forward, right, down, those of
navigation north, east, down; heights are ellipsoidal.

Source: VectorNav, "VN-300 User Manual" (UM005) and "VN-100 User Manual" (UM001), sections "Binary Output Messages" and
"INS Status"; the driver of ArduPilot, `AP_ExternalAHRS_VectorNav.cpp`, reads these layouts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Any

import numpy as np

from insenv.core.tables import Vector
from insenv.logs.units import gps_of_unix
from insenv.mavlink.messages.sensor import KELVIN, TESLA_TO_GAUSS, means
from insenv.mavlink.messages.view import View

NO_FIX, FIX_3D = 0, 3
SATELLITES, DILUTION, NO_DILUTION = 12, 1.0, 99.99
"""Number of satellites and dilutions of precision of a fix, which are not simulated, and the dilution without a fix."""
REFUSED = 2
"""Fixes refused one after another from which the estimator counts as without GNSS: one may be an outlier."""

NOT_TRACKING, ALIGNING, TRACKING, GNSS_LOST = range(4)
_GNSS_FIX, _IMU_ERROR, _GNSS_ERROR, _GNSS_HEADING = 1 << 2, 1 << 5, 1 << 7, 3 << 9
_ROLL, _PITCH, _HEADING = 15, 18, 20
"""Places of the variances of roll, pitch and heading in the upper triangle of `pose_covariance`."""


class Reading:
    """What one output holds at the present sample.  name: of the output; its rates and forces are means since it was sent."""

    def __init__(self, view: View, name: str) -> None:
        self.view, self._name = view, name

    @cached_property
    def means(self) -> tuple[Vector, Vector]:
        """Angular rate (3, rad/s) and specific force (3, m/s^2) as measured."""
        rates, forces, _ = means(self.view, self._name)
        return rates, forces

    def without_bias(self, place: int) -> Vector:
        """The same minus the estimated bias: place 0 for the angular rate, 1 for the specific force."""
        return np.asarray(self.means[place] - self.view.estimate.get(("gyro_bias", "accel_bias")[place], 0.0))

    @cached_property
    def fix(self) -> Sequence[Any]:
        """Latest fix of the antenna: latitude, longitude (deg), height (m); velocity (m/s); sigmas (m; m/s).  0 before."""
        fix = self.view.simulation.fix
        if fix is None:
            return np.zeros(3), np.zeros(3), np.zeros(3), 0.0
        velocity = fix.velocity_n if fix.velocity_valid else np.full(3, nan)
        place = np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height
        return place, velocity, fix.position_sigma, _rms(fix.velocity_sigma) if fix.velocity_valid else nan


def _rms(sigma: Vector | None) -> float:
    """Root mean square of the sigmas of three axes; NaN if none are stated."""
    return nan if sigma is None else float(np.sqrt(np.mean(np.square(sigma))))


def ins_status(view: View) -> int:
    """InsStatus.  Bits 0 and 1, the mode: 0 not tracking, 1 aligning, 2 tracking, 3 GNSS lost; 2 fix; 5 no inertial samples;
    7 the receiver does not answer; 9 and 10 the heading of two antennas is used.

    Aligning lasts until the vehicle is aligned (`View.aligned`).  GNSS is lost when there is no fix (2.5 fix intervals after
    the latest), or when the gate of the estimator has refused the latest `REFUSED`, and the attitude is still good.
    """
    simulation, health = view.simulation, view.simulation.health
    refused = health is not None and health.refused_in_a_row >= REFUSED
    if simulation.diverged or not simulation.samples:
        mode = NOT_TRACKING
    elif simulation.fixes and (view.in_outage or refused) and view.states_alignment:
        mode = GNSS_LOST
    else:
        mode = TRACKING if view.aligned else ALIGNING
    status = mode | (_GNSS_FIX if view.has_lock else 0) | (_IMU_ERROR if view.imu_lost else 0)
    if simulation.has_gnss and not simulation.gnss_on:
        status |= _GNSS_ERROR
    return status | (_GNSS_HEADING if "heading_new" in simulation.estimator.model.inputs else 0)


def _gps_ns(view: View) -> int:
    """Nanoseconds of GPS time since its beginning."""
    ahead = float(gps_of_unix(np.array([view.start_unix]))[0]) - view.start_unix
    return view.unix_us * 1000 + round(ahead) * 10**9


def _quaternion(view: View) -> Vector:
    """Scalar last."""
    return np.roll(view.estimate["q_nb"], -1)


def _place(view: View) -> tuple[float, float, float]:
    latitude, longitude = np.degrees(view.estimated("latitude")), np.degrees(view.values["longitude_wrapped"])
    return float(latitude), float(longitude), view.estimated("height")


def _ypr_sigmas(view: View) -> Vector:
    return np.degrees(np.sqrt(view.values["pose_covariance"].ravel()[[_HEADING, _PITCH, _ROLL]]))


@dataclass(frozen=True)
class Field:
    """One field.  form: NumPy type of its elements; count: their number; values: what it holds.

    navigation: whether a unit that states attitude alone (VN-100) lacks it.
    """

    name: str
    form: str
    count: int
    values: Callable[[Reading], Any]
    navigation: bool = False

    @property
    def size(self) -> int:
        """Bytes."""
        return np.dtype(self.form).itemsize * self.count

    def packed(self, reading: Reading) -> bytes:
        """Its bytes; a value beyond the range of a float32 is infinite."""
        with np.errstate(over="ignore"):
            return np.asarray(self.values(reading), dtype=self.form).tobytes()


_STARTUP = Field("TimeStartup", "<u8", 1, lambda r: r.view.time_us * 1000)
_GPS_TIME = Field("TimeGps", "<u8", 1, lambda r: _gps_ns(r.view), True)
_YPR = Field("Ypr", "<f4", 3, lambda r: np.degrees(r.view.values["euler"].ravel()[::-1]))
_QUATERNION = Field("Quaternion", "<f4", 4, lambda r: _quaternion(r.view))
_RATE = Field("AngularRate", "<f4", 3, lambda r: r.without_bias(0))
_FORCE = Field("Accel", "<f4", 3, lambda r: r.without_bias(1))
_RAW_RATE = Field("UncompGyro", "<f4", 3, lambda r: r.means[0])
_RAW_FORCE = Field("UncompAccel", "<f4", 3, lambda r: r.means[1])
_MAG = Field("Mag", "<f4", 3, lambda r: r.view.air.magnetic_b * TESLA_TO_GAUSS)
_TEMPERATURE = Field("Temperature", "<f4", 1, lambda r: r.view.air.temperature - KELVIN)
_PRESSURE = Field("Pressure", "<f4", 1, lambda r: r.view.air.pressure * 1e-3)
_PLACE = Field("PosLla", "<f8", 3, lambda r: _place(r.view), True)
_VELOCITY = Field("VelNed", "<f4", 3, lambda r: r.view.estimated_velocity_n, True)
_STATUS = Field("InsStatus", "<u2", 1, lambda r: ins_status(r.view), True)
_FIELDS_OF: dict[int, dict[int, tuple[Field, ...]]] = {
    1: {
        0: (_STARTUP,), 1: (_GPS_TIME,), 3: (_YPR,), 4: (_QUATERNION,), 5: (_RATE,), 6: (_PLACE,), 7: (_VELOCITY,),
        8: (_FORCE,), 9: (_RAW_FORCE, _RAW_RATE), 10: (_MAG, _TEMPERATURE, _PRESSURE), 12: (_STATUS,),
    },
    2: {0: (_STARTUP,), 1: (_GPS_TIME,)},
    3: {
        1: (_MAG,), 2: (_RAW_FORCE,), 3: (_RAW_RATE,), 4: (_TEMPERATURE,), 5: (_PRESSURE,), 8: (_MAG,), 9: (_FORCE,),
        10: (_RATE,),
    },
    4: {
        3: (Field("NumSats", "u1", 1, lambda r: SATELLITES if r.view.has_lock else 0, True),),
        4: (Field("GnssFix", "u1", 1, lambda r: FIX_3D if r.view.has_lock else NO_FIX, True),),
        5: (Field("GnssPosLla", "<f8", 3, lambda r: r.fix[0], True),),
        7: (Field("GnssVelNed", "<f4", 3, lambda r: r.fix[1], True),),
        9: (Field("GnssPosU", "<f4", 3, lambda r: r.fix[2], True),),
        10: (Field("GnssVelU", "<f4", 1, lambda r: r.fix[3], True),),
        13: (Field("GnssDop", "<f4", 7, lambda r: np.full(7, DILUTION if r.view.has_lock else NO_DILUTION), True),),
    },
    5: {1: (_YPR,), 2: (_QUATERNION,), 8: (Field("YprU", "<f4", 3, lambda r: _ypr_sigmas(r.view)),)},
    6: {
        0: (_STATUS,), 1: (_PLACE,), 4: (_VELOCITY,),
        3: (Field("VelBody", "<f4", 3, lambda r: r.view.values["velocity_b"], True),),
        9: (Field("PosU", "<f4", 1, lambda r: _rms(r.view.position_sigma), True),),
        10: (Field("VelU", "<f4", 1, lambda r: _rms(r.view.estimate.get("velocity_sigma")), True),),
    },
}  # fmt: skip
FIELDS = {**_FIELDS_OF, 7: {bit: _FIELDS_OF[4][bit] for bit in (3, 4)}}
"""By group (1 common, 2 time, 3 IMU, 4 GNSS 1, 5 attitude, 6 INS, 7 GNSS 2) and bit of its mask.

There is one receiver: GNSS 2 repeats the fix of GNSS 1, without which ArduPilot does not arm.
"""
