"""MAVLink telemetry logs (.tlog), whose records `insenv.logs.formats.tlog` reads and writes, as series.

Broken bytes between records are skipped and counted. Only the messages of the system that sent the most inertial samples are
used. Units are those of the message definitions: degE7, mm, cm/s, milli-g.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY
from insenv.logs.formats.contract import Format
from insenv.logs.formats.series import (
    AZIMUTH_SIGMA,
    FIX_3D,
    GAUSS,
    UNIX_US,
    FixSeries,
    Flight,
    ImuSeries,
    Place,
    SolutionSeries,
    nearest_rows,
    reading,
    three_sigmas,
    with_places,
)
from insenv.logs.formats.tlog import TelemetryLog, messages
from insenv.logs.recorded import NO_INFORMATION, Readings, course_velocity
from insenv.logs.units import ANGLE_UNITS

_DEG_E7 = ANGLE_UNITS["1e-7 deg"]
_DEG_E5 = np.pi / 180.0 * 1e-5
_UNKNOWN = 65535
_MAGNETOMETER, _PRESSURE_HEIGHT = 0b111 << 6, 1 << 11
"""Bits of fields_updated."""
_REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""
_UNITS: Mapping[str, Literal["interval_end", "instant"]] = {"HIL_SENSOR": "interval_end", "HIGHRES_IMU": "instant"}
"""Messages of the inertial unit in SI, and their stamps."""
_SCALED = ("SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")
_NAMES = {
    *_UNITS, *_SCALED, "RAW_IMU", "HIL_GPS", "GPS_RAW_INT", "PARAM_VALUE", "HOME_POSITION", "HIL_STATE_QUATERNION", "ATTITUDE",
    "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT",
}  # fmt: skip
_ONE_SENDER = declared("one-sender", "messages of system {system}, component {component}; also in the log: {others}")
_SKIPPED = declared("frames-skipped", "{wrong} frames with a wrong checksum, {skipped} bytes that belong to no record: skipped")
_UNIX_TIME = declared(
    "vehicle-unix-time",
    "the vehicle's time stamps are Unix time: times are counted from the first inertial sample",
)
_ACCURACIES = declared(
    "accuracies-in-cm", "HIL_GPS: eph and epv are taken as accuracies in cm, as PX4 does; MAVLink defines dilutions"
)
_ARRIVAL = declared(
    "times-of-arrival", "GPS_RAW_INT: stamped by a different clock than the inertial unit: times of arrival are used"
)


def read(label: str, data: bytes) -> Flight:
    """The series of a telemetry log. Raises InputError: not a telemetry log."""
    log = TelemetryLog(data)
    names = {number: kind.msgname for number, kind in messages().items() if kind.msgname in _NAMES}
    by_sender: dict[tuple[int, int], dict[str, list[tuple[int, bytes]]]] = defaultdict(lambda: defaultdict(list))
    for record in log:
        by_sender[record.system, record.component][names.get(record.number, "")].append((record.time_us, record.payload))
    if not log.records:
        raise InputError(f"{label}: not a MAVLink telemetry log: it holds no frame after a time stamp")
    tables = {sender: _Tables(rows) for sender, rows in by_sender.items()}
    sender = max(tables, key=lambda s: tables[s].inertial_samples())
    notes: list[Remark] = []
    if len(tables) > 1:
        others = ", ".join(f"{s}/{c}" for s, c in sorted(tables) if (s, c) != sender)
        notes.append(_ONE_SENDER.filled(system=sender[0], component=sender[1], others=others))
    if log.wrong or log.skipped:
        notes.append(_SKIPPED.filled(wrong=log.wrong, skipped=log.skipped))
    return tables[sender].flight(notes, log.records)


class _Tables:
    """The messages of one sender as columns.  rows: times of arrival (us) and payloads by name of the message."""

    def __init__(self, rows: Mapping[str, list[tuple[int, bytes]]]) -> None:
        self._rows = rows
        self.base_us = 0

    def inertial_samples(self) -> int:
        return sum(len(self._rows.get(name, ())) for name in (*_UNITS, "SCALED_IMU", "RAW_IMU"))

    def columns(self, name: str) -> np.ndarray:
        """The messages of a name as a structured array, with the column received_us; trailing bytes that MAVLink truncates are
        zero.
        """
        kind = next(kind for kind in messages().values() if kind.msgname == name)
        # native_format: one letter of struct per field, in wire order; array_lengths: 0 for scalars
        letters = bytes(kind.native_format).decode("ascii").lstrip("<>=")
        fields: list[Any] = [
            (field, f"S{max(length, 1)}") if letter == "c" else (field, f"<{letter}", (length,) if length else ())
            for field, letter, length in zip(kind.ordered_fieldnames, letters, kind.array_lengths, strict=True)
        ]
        size = np.dtype(fields).itemsize
        rows = (payload.ljust(size, b"\0")[:size] + time.to_bytes(8, "little") for time, payload in self._rows.get(name, ()))
        return np.frombuffer(b"".join(rows), np.dtype([*fields, ("received_us", "<u8")]))

    def each_once(self, name: str, column: str = "time_usec") -> np.ndarray:
        """The first message of each time, in order of time."""
        rows = self.columns(name)
        return rows[np.unique(rows[column], return_index=True)[1]]

    def seconds(self, rows: np.ndarray) -> Array:
        """Column time_usec (n,) as seconds since `base_us`."""
        return np.asarray((rows["time_usec"].astype(np.int64) - self.base_us) * 1e-6, dtype=np.float64)

    # Series.

    def flight(self, notes: list[Remark], records: int) -> Flight:
        first = [int(rows["time_usec"][0]) for name in _UNITS if (rows := self.columns(name)).size]
        self.base_us = next((time for time in first if time > UNIX_US), 0)
        if self.base_us:  # double precision of seconds since 1970 is too coarse for the steps between samples
            notes.append(_UNIX_TIME)
        imus = list(self._imus())
        undulation = self._undulation()
        clock = max(imus, key=lambda imu: imu.rate_hz).time if imus else np.zeros(0)
        return Flight(
            imus=imus,
            fixes=[self._hil_gps(undulation, notes), self._gps_raw_int(undulation, clock, notes)],
            solutions=[self._truth(), self._estimate()],
            notes=notes,
            rows=records,
            others=["RAW_IMU (counts of no stated unit)"] if "RAW_IMU" in self._rows else [],
            parameters=self._parameters(),
            place=self._home(undulation),
            readings=list(self._readings()),
            unix=self.base_us * 1e-6 or None,
        )

    def _unit(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The messages of the first unit, and the bits of their fields_updated."""
        rows = self.columns(name)
        rows = rows[rows["id"] == 0] if "id" in (rows.dtype.names or ()) else rows
        return rows, rows["fields_updated"].astype(np.uint32)

    def _imus(self) -> Iterator[ImuSeries]:
        for name, stamp in _UNITS.items():
            rows, bits = self._unit(name)
            rows = rows[bits & 0b111111 == 0b111111]
            if len(rows):
                yield ImuSeries(name, self.seconds(rows), _three(rows, "gyro"), _three(rows, "acc"), stamp)
        for name in _SCALED:
            rows = self.columns(name)
            if len(rows):
                rate, force = _three(rows, "gyro") * 1e-3, _three(rows, "acc") * 1e-3 * STANDARD_GRAVITY
                yield ImuSeries(name, rows["time_boot_ms"] * 1e-3, rate, force, "instant")

    def _readings(self) -> Iterator[Readings | None]:
        """Magnetometer and barometer of the unit's messages, where they are new, and the heading of the receiver."""
        name = next((name for name in _UNITS if name in self._rows), None)
        if name is not None:
            rows, bits = self._unit(name)
            field, air = rows[bits & _MAGNETOMETER == _MAGNETOMETER], rows[bits & _PRESSURE_HEIGHT == _PRESSURE_HEIGHT]
            if len(field):
                yield reading("magnetometer", name, self.seconds(field), _three(field, "mag") * GAUSS)
            if len(air):
                yield reading("barometer", name, self.seconds(air), air["pressure_alt"].astype(np.float64))
        rows = self.each_once("GPS_RAW_INT")
        rows = rows[(rows["yaw"] > 0) & (rows["yaw"] <= 36000)]  # 0: no such receiver, 65535: no heading now
        if len(rows):
            stated, azimuth = rows["hdg_acc"] * _DEG_E5, np.radians(rows["yaw"] * 1e-2)
            sigma = np.where(stated > 0, stated, AZIMUTH_SIGMA)
            wrapped = np.arctan2(np.sin(azimuth), np.cos(azimuth))
            yield reading("heading", "GPS_RAW_INT", self.seconds(rows), np.stack([wrapped, sigma], axis=1))

    def _undulation(self) -> float | None:
        rows = self.columns("GPS_RAW_INT")
        rows = rows[(rows["fix_type"] >= FIX_3D) & (rows["alt_ellipsoid"] != 0)]
        return float(np.median((rows["alt_ellipsoid"] - rows["alt"].astype(np.int64)) * 1e-3)) if len(rows) else None

    def _parameters(self) -> dict[str, float]:
        """PARAM_VALUE by name, the last value of each; integers, which clients encode in two ways, are left out."""
        rows = self.columns("PARAM_VALUE")
        real = rows[rows["param_type"] == _REAL32]
        return {
            bytes(name).split(b"\0")[0].decode("ascii", "replace"): float(value)
            for name, value in zip(real["param_id"], real["param_value"], strict=True)
        }

    def _home(self, undulation: float | None) -> Place | None:
        rows = self.columns("HOME_POSITION")
        if not len(rows):
            return None
        latitude, longitude = (float(rows[-1][angle] * _DEG_E7) for angle in ("latitude", "longitude"))
        height = float(rows[-1]["altitude"]) * 1e-3 + (undulation or 0.0)
        return Place("HOME_POSITION", latitude, longitude, height, undulation is None)

    def _hil_gps(self, undulation: float | None, notes: list[Remark]) -> FixSeries | None:
        rows = self.each_once("HIL_GPS")
        rows = rows[rows["fix_type"] >= FIX_3D]
        if not len(rows):
            return None
        # a simulator sends zeros for a velocity that the receiver does not have, and an unknown speed
        known = rows["vel"] < _UNKNOWN
        speed_sigma = None
        stated = self._accuracies(rows["time_usec"])
        if stated is None:
            horizontal, vertical = (np.where(rows[name] < _UNKNOWN, rows[name], 0) * 1e-2 for name in ("eph", "epv"))
            if (horizontal > 0).all():
                notes.append(_ACCURACIES)
        else:
            horizontal, vertical, moving = stated
            if (known & (moving > 0)).any():
                speed_sigma = np.stack([np.where(known & (moving > 0), moving, NO_INFORMATION)] * 3, axis=1)
        return FixSeries(
            name="HIL_GPS",
            time=self.seconds(rows),
            **_place(rows),
            undulation=undulation,
            position_sigma=three_sigmas(horizontal, vertical),
            velocity_n=_velocity(rows, "vn", "ve", "vd") if known.any() else None,
            velocity_sigma=speed_sigma,
        )

    def _accuracies(self, time_usec: np.ndarray) -> tuple[Array, Array, Array] | None:
        """Accuracies of position, horizontal and vertical (m), and of velocity (m/s) by the nearest GPS_RAW_INT; None if
        it states none.

        Unlike the eph and epv of HIL_GPS their unit is not in dispute.
        """
        rows = self.each_once("GPS_RAW_INT")
        rows = rows[(rows["fix_type"] >= FIX_3D) & (rows["h_acc"] > 0) & (rows["v_acc"] > 0)]
        if not len(rows):
            return None
        near = nearest_rows(rows["time_usec"].astype(np.float64), time_usec.astype(np.float64))
        horizontal, vertical, speed = (rows[name][near] * 1e-3 for name in ("h_acc", "v_acc", "vel_acc"))
        return horizontal, vertical, speed

    def _gps_raw_int(self, undulation: float | None, clock: Array, notes: list[Remark]) -> FixSeries | None:
        rows = self.columns("GPS_RAW_INT")
        rows = rows[np.sort(np.unique(rows["time_usec"], return_index=True)[1])]  # in order of arrival
        rows = rows[rows["fix_type"] >= FIX_3D]
        if not len(rows):
            return None
        time = self.seconds(rows)
        if clock.size and (time[-1] < clock[0] or time[0] > clock[-1]):
            time = np.asarray(rows["received_us"].astype(np.int64) * 1e-6 - self._clock_offset(), dtype=np.float64)
            notes.append(_ARRIVAL)
        velocity, velocity_sigma = _from_course(rows["vel"], rows["cog"], rows["vel_acc"])
        return FixSeries(
            name="GPS_RAW_INT",
            time=time,
            **_place(rows),
            undulation=undulation,
            position_sigma=three_sigmas(rows["h_acc"] * 1e-3, rows["v_acc"] * 1e-3),
            velocity_n=velocity,
            velocity_sigma=velocity_sigma,
        )

    def _clock_offset(self) -> float:
        """Time of arrival minus the vehicle's time, s: the smallest among the inertial messages."""
        rows = next((rows for name in _UNITS if (rows := self.columns(name)).size), None)
        if rows is None:
            return 0.0
        return float(np.min(rows["received_us"].astype(np.int64) - rows["time_usec"].astype(np.int64) + self.base_us)) * 1e-6

    def _truth(self) -> SolutionSeries | None:
        rows = self.each_once("HIL_STATE_QUATERNION")
        if not len(rows):
            return None
        roll, pitch, heading = _euler(rows["attitude_quaternion"])
        return SolutionSeries(
            name="HIL_STATE_QUATERNION",
            time=self.seconds(rows),
            **_place(rows),
            velocity_n=_velocity(rows, "vx", "vy", "vz"),
            roll=roll,
            pitch=pitch,
            heading=heading,
            true=True,
        )

    def _estimate(self) -> SolutionSeries | None:
        name = next((name for name in ("ATTITUDE_QUATERNION", "ATTITUDE") if name in self._rows), None)
        if name is None:
            return None
        rows = self.each_once(name, "time_boot_ms")
        if name == "ATTITUDE":
            roll, pitch, heading = (rows[angle].astype(np.float64) for angle in ("roll", "pitch", "yaw"))
        else:
            roll, pitch, heading = _euler(np.stack([rows[q] for q in ("q1", "q2", "q3", "q4")], axis=1))
        turned = SolutionSeries(name=name, time=rows["time_boot_ms"] * 1e-3, roll=roll, pitch=pitch, heading=heading)
        rows = self.each_once("GLOBAL_POSITION_INT", "time_boot_ms")
        placed = {**_place(rows), "velocity_n": _velocity(rows, "vx", "vy", "vz")}
        return with_places(turned, f"{name}, GLOBAL_POSITION_INT", rows["time_boot_ms"] * 1e-3, **placed)


def _place(rows: np.ndarray) -> dict[str, Any]:
    """Latitude, longitude (rad) and height above mean sea level (m) of a message."""
    latitude, longitude = rows["lat"] * _DEG_E7, rows["lon"] * _DEG_E7
    return {"latitude": latitude, "longitude": longitude, "height": rows["alt"] * 1e-3, "height_sea": True}


def _three(rows: np.ndarray, what: str) -> Array:
    return np.stack([rows[f"{axis}{what}"].astype(np.float64) for axis in "xyz"], axis=1)


def _velocity(rows: np.ndarray, *columns: str) -> Array:
    """Columns in cm/s as (n, 3) m/s."""
    return np.asarray(np.stack([rows[column] for column in columns], axis=1) * 1e-2)


def _euler(q: np.ndarray) -> tuple[Array, Array, Array]:
    """Roll, pitch, heading (rad) of quaternions (n, 4) of any length, scalar first."""
    double = q.astype(np.float64)
    roll, pitch, heading = attitude.numeric.to_euler(double / np.linalg.norm(double, axis=1, keepdims=True))
    return roll, pitch, heading


def _from_course(speed_cm: np.ndarray, course_cdeg: np.ndarray, accuracy_mm: np.ndarray) -> tuple[Array | None, Array | None]:
    """Velocity and its standard deviations (n, 3) m/s from speed over ground and course.

    The vertical component, and unknown ones, have a standard deviation of `NO_INFORMATION`.
    """
    speed = np.where(speed_cm < _UNKNOWN, speed_cm, 0) * 1e-2
    course = np.radians(np.where(course_cdeg < _UNKNOWN, course_cdeg, 0) * 1e-2)
    known = (speed_cm < _UNKNOWN) & ((course_cdeg < _UNKNOWN) | (speed_cm == 0))
    if not known.any() or not (accuracy_mm > 0).any():
        return None, None
    sigma = np.where(accuracy_mm > 0, accuracy_mm, np.median(accuracy_mm[accuracy_mm > 0])) * 1e-3
    sigma = np.where(known, sigma, NO_INFORMATION)
    velocity = course_velocity(speed, course, np.zeros(len(speed)))
    return velocity, np.stack([sigma, sigma, np.full(len(speed), NO_INFORMATION)], axis=1)


FORMAT = Format(
    name="telemetry",
    kind="MAVLink telemetry log",
    suffixes=(".tlog",),
    read_flight=read,
    hint="request HIGHRES_IMU from the vehicle (SET_MESSAGE_INTERVAL), or use the log on its own card",
)
