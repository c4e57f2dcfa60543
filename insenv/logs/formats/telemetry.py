"""MAVLink telemetry logs (.tlog): records of a time (microseconds, 64 bits, big-endian) and a frame.

Broken bytes between records are skipped and counted. Only the messages of the system that sent the most inertial samples are
used. Units are those of the message definitions: degE7, mm, cm/s, milli-g.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
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
from insenv.logs.recorded import NO_INFORMATION, Readings, course_velocity
from insenv.logs.units import Array

# Records of a MAVLink telemetry log: a time (microseconds, 64 bits, big-endian) and a frame; broken bytes are skipped.

V1, V2, SIGNED = 0xFE, 0xFD, 0x01
STAMP = 8
_MAGIC = re.compile(b"[\xfd\xfe]")


@dataclass(frozen=True)
class Record:
    """A record: time (us of Unix time), sender, number of the message, payload."""

    time_us: int
    system: int
    component: int
    number: int
    payload: bytes


@lru_cache(maxsize=1)
def messages() -> Any:
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega.mavlink_map


class TelemetryLog:
    """The records of a log, in order.

    records: number of records; skipped: bytes that belong to none; wrong: frames with a wrong checksum; unknown: frames of
    unknown messages, whose checksum cannot be verified.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.records = self.skipped = self.wrong = self.unknown = 0

    def __iter__(self) -> Iterator[Record]:
        from fastcrc import crc16

        data, end, at = self.data, len(self.data), 0
        extras = {number: kind.crc_extra for number, kind in messages().items()}
        while at + STAMP < end:
            magic = data[at + STAMP]
            head = 10 if magic == V2 else 6
            begin = at + STAMP
            if magic not in (V1, V2) or begin + head > end:
                at = self._resynchronised(at)
                continue
            if magic == V2:
                system, component = data[begin + 5], data[begin + 6]
                number = int.from_bytes(data[begin + 7 : begin + 10], "little")
                signature = 13 if data[begin + 2] & SIGNED else 0
            else:
                system, component, number, signature = data[begin + 3], data[begin + 4], data[begin + 5], 0
            body = begin + head + data[begin + 1]
            follows = body + 2 + signature
            if follows > end:
                at = self._resynchronised(at)
                continue
            extra = extras.get(number)
            if extra is None:
                if follows + STAMP < end and data[follows + STAMP] not in (V1, V2):
                    at = self._resynchronised(at)
                    continue
                self.unknown += 1
            elif crc16.mcrf4xx(data[begin + 1 : body] + bytes((extra,))) != int.from_bytes(data[body : body + 2], "little"):
                self.wrong += 1
                at = self._resynchronised(at)
                continue
            else:
                self.records += 1
                yield Record(int.from_bytes(data[at:begin], "big"), system, component, number, data[begin + head : body])
            at = follows
        self.skipped += max(end - at, 0)

    def _resynchronised(self, at: int) -> int:
        """Offset at which the next record may begin: eight bytes before the next magic byte."""
        found = _MAGIC.search(self.data, at + STAMP + 1)
        after = len(self.data) if found is None else found.start() - STAMP
        self.skipped += after - at
        return after


_DEG_E7 = np.pi / 180.0 * 1e-7
_DEG_E5 = np.pi / 180.0 * 1e-5
_UNKNOWN = 65535
_MAGNETOMETER, _PRESSURE_HEIGHT = 0b111 << 6, 1 << 11
"""Bits of fields_updated."""
_REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""


def read(label: str, data: bytes) -> Flight:
    """The series of a telemetry log. Raises InputError: not a telemetry log."""
    log = TelemetryLog(data)
    by_sender: dict[tuple[int, int], dict[int, list[tuple[int, bytes]]]] = defaultdict(lambda: defaultdict(list))
    for record in log:
        by_sender[record.system, record.component][record.number].append((record.time_us, record.payload))
    if not log.records:
        raise InputError(f"{label}: not a MAVLink telemetry log: it holds no frame after a time stamp")
    tables = {sender: _Tables(found) for sender, found in by_sender.items()}
    sender = max(tables, key=lambda s: tables[s].inertial_samples())
    notes = []
    if len(tables) > 1:
        others = ", ".join(f"{s}/{c}" for s, c in sorted(tables) if (s, c) != sender)
        notes.append(f"messages of system {sender[0]}, component {sender[1]}; also in the log: {others}")
    if log.wrong or log.skipped:
        notes.append(f"{log.wrong} frames with a wrong checksum, {log.skipped} bytes that belong to no record: skipped")
    return tables[sender].flight(notes, log.records)


class _Tables:
    """The messages of one sender, by name, as columns."""

    def __init__(self, found: dict[int, list[tuple[int, bytes]]]) -> None:
        self._found = {messages()[number].msgname: rows for number, rows in found.items()}
        self._kinds = {messages()[number].msgname: messages()[number] for number in found}
        self.base_us = 0

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def inertial_samples(self) -> int:
        return sum(len(self._found.get(name, ())) for name in ("HIL_SENSOR", "HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"))

    def received_us(self, name: str) -> np.ndarray:
        return np.array([time for time, _ in self._found[name]], dtype=np.int64)

    def columns(self, name: str) -> np.ndarray:
        """The payloads as a structured array; trailing bytes that MAVLink truncates are zero."""
        kind = self._kinds[name]
        # native_format: one letter of struct per field, in wire order; array_lengths: 0 for scalars
        letters = bytes(kind.native_format).decode("ascii").lstrip("<>=")
        fields: list[Any] = [
            (field, f"S{max(length, 1)}") if letter == "c" else (field, f"<{letter}", (length,) if length else ())
            for field, letter, length in zip(kind.ordered_fieldnames, letters, kind.array_lengths, strict=True)
        ]
        dtype = np.dtype(fields)
        size = dtype.itemsize
        return np.frombuffer(b"".join(payload.ljust(size, b"\0")[:size] for _, payload in self._found[name]), dtype)

    def seconds(self, rows: np.ndarray) -> Array:
        """Column time_usec (n,) as seconds since `base_us`."""
        return np.asarray((rows["time_usec"].astype(np.int64) - self.base_us) * 1e-6, dtype=np.float64)

    # --- series ----------------------------------------------------------------------------------

    def flight(self, notes: list[str], records: int) -> Flight:
        for name in ("HIL_SENSOR", "HIGHRES_IMU"):
            if name in self and not self.base_us and (first := int(self.columns(name)["time_usec"][0])) > UNIX_US:
                # double precision of seconds since 1970 is too coarse for the steps between samples
                self.base_us = first
                notes.append("the vehicle's time stamps are Unix time: times are counted from the first inertial sample")
        imus = self._imus()
        undulation = self._undulation()
        clock = max(imus, key=lambda imu: imu.rate_hz).time if imus else np.zeros(0)
        return Flight(
            imus=imus,
            fixes=[self._hil_gps(undulation, notes), self._gps_raw_int(undulation, clock, notes)],
            solutions=[self._truth(), self._estimate()],
            notes=notes,
            rows=records,
            others=["RAW_IMU (counts of no stated unit)"] if "RAW_IMU" in self else [],
            parameters=self._parameters(),
            place=self._home(undulation),
            readings=list(self._readings()),
        )

    def _imus(self) -> list[ImuSeries]:
        imus = []
        for name, stamp in (("HIL_SENSOR", "interval_end"), ("HIGHRES_IMU", "instant")):
            if name not in self:
                continue
            rows = self.columns(name)
            rows = rows[(rows["fields_updated"].astype(np.uint32) & 0b111111) == 0b111111]
            rows = rows[rows["id"] == 0] if "id" in (rows.dtype.names or ()) else rows
            if len(rows):
                imus.append(
                    ImuSeries(name, self.seconds(rows), _three(rows, "gyro"), _three(rows, "acc"), stamp)  # type: ignore[arg-type]
                )
        for name in ("SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"):
            if name in self:
                rows = self.columns(name)
                time = rows["time_boot_ms"] * 1e-3
                imus.append(
                    ImuSeries(name, time, _three(rows, "gyro") * 1e-3, _three(rows, "acc") * 1e-3 * STANDARD_GRAVITY, "instant")
                )
        return imus

    def _readings(self) -> Iterator[Readings | None]:
        """Magnetometer and barometer of the unit's messages, where they are new, and the heading of the receiver."""
        name = next((name for name in ("HIL_SENSOR", "HIGHRES_IMU") if name in self), None)
        if name is not None:
            rows = self.columns(name)
            rows = rows[rows["id"] == 0] if "id" in (rows.dtype.names or ()) else rows
            bits = rows["fields_updated"].astype(np.uint32)
            field, air = rows[bits & _MAGNETOMETER == _MAGNETOMETER], rows[bits & _PRESSURE_HEIGHT == _PRESSURE_HEIGHT]
            if len(field):
                yield reading("magnetometer", name, self.seconds(field), _three(field, "mag") * GAUSS)
            if len(air):
                yield reading("barometer", name, self.seconds(air), air["pressure_alt"].astype(np.float64))
        if "GPS_RAW_INT" in self:
            rows = _each_once(self.columns("GPS_RAW_INT"))
            rows = rows[(rows["yaw"] > 0) & (rows["yaw"] <= 36000)]  # 0: no such receiver, 65535: no heading now
            if len(rows):
                stated = rows["hdg_acc"] * _DEG_E5
                azimuth = np.radians(rows["yaw"] * 1e-2)
                sigma = np.where(stated > 0, stated, AZIMUTH_SIGMA)
                wrapped = np.arctan2(np.sin(azimuth), np.cos(azimuth))
                yield reading("heading", "GPS_RAW_INT", self.seconds(rows), np.stack([wrapped, sigma], axis=1))

    def _undulation(self) -> float | None:
        if "GPS_RAW_INT" not in self:
            return None
        rows = self.columns("GPS_RAW_INT")
        rows = rows[(rows["fix_type"] >= FIX_3D) & (rows["alt_ellipsoid"] != 0)]
        return float(np.median((rows["alt_ellipsoid"] - rows["alt"].astype(np.int64)) * 1e-3)) if len(rows) else None

    def _parameters(self) -> dict[str, float]:
        """PARAM_VALUE by name, the last value of each; integers, which clients encode in two ways, are left out."""
        if "PARAM_VALUE" not in self:
            return {}
        rows = self.columns("PARAM_VALUE")
        real = rows[rows["param_type"] == _REAL32]
        return {
            bytes(name).split(b"\0")[0].decode("ascii", "replace"): float(value)
            for name, value in zip(real["param_id"], real["param_value"], strict=True)
        }

    def _home(self, undulation: float | None) -> Place | None:
        if "HOME_POSITION" not in self:
            return None
        row = self.columns("HOME_POSITION")[-1]
        height = float(row["altitude"]) * 1e-3 + (undulation or 0.0)
        return Place(
            "HOME_POSITION", float(row["latitude"] * _DEG_E7), float(row["longitude"] * _DEG_E7), height, undulation is None
        )

    def _hil_gps(self, undulation: float | None, notes: list[str]) -> FixSeries | None:
        if "HIL_GPS" not in self:
            return None
        rows = _each_once(self.columns("HIL_GPS"))
        rows = rows[rows["fix_type"] >= FIX_3D]
        if not len(rows):
            return None
        # a simulator sends zeros for a velocity that the receiver does not have, and an unknown speed
        known = rows["vel"] < _UNKNOWN
        velocity = np.stack([rows["vn"], rows["ve"], rows["vd"]], axis=1) * 1e-2
        stated = self._accuracies(rows["time_usec"])
        if stated is None:
            horizontal, vertical = (np.where(rows[name] < _UNKNOWN, rows[name], 0) * 1e-2 for name in ("eph", "epv"))
            speed_sigma = None
            if (horizontal > 0).all():
                notes.append("HIL_GPS: eph and epv are taken as accuracies in cm, as PX4 does; MAVLink defines dilutions")
        else:
            horizontal, vertical, moving = stated
            speed_sigma = np.where(known & (moving > 0), moving, NO_INFORMATION) if (known & (moving > 0)).any() else None
        return FixSeries(
            name="HIL_GPS",
            time=self.seconds(rows),
            **_place(rows),
            undulation=undulation,
            position_sigma=three_sigmas(horizontal, vertical),
            velocity_n=velocity if known.any() else None,
            velocity_sigma=None if speed_sigma is None or not known.any() else np.stack([speed_sigma] * 3, axis=1),
        )

    def _accuracies(self, time_usec: np.ndarray) -> tuple[Array, Array, Array] | None:
        """Accuracies of position, horizontal and vertical (m), and of velocity (m/s) by the nearest GPS_RAW_INT; None if
        it states none.

        Unlike the eph and epv of HIL_GPS their unit is not in dispute.
        """
        if "GPS_RAW_INT" not in self:
            return None
        rows = _each_once(self.columns("GPS_RAW_INT"))
        rows = rows[(rows["fix_type"] >= FIX_3D) & (rows["h_acc"] > 0) & (rows["v_acc"] > 0)]
        if not len(rows):
            return None
        near = nearest_rows(rows["time_usec"].astype(np.float64), time_usec.astype(np.float64))
        horizontal, vertical, speed = (rows[name][near] * 1e-3 for name in ("h_acc", "v_acc", "vel_acc"))
        return horizontal, vertical, speed

    def _gps_raw_int(self, undulation: float | None, clock: Array, notes: list[str]) -> FixSeries | None:
        if "GPS_RAW_INT" not in self:
            return None
        rows, received = self.columns("GPS_RAW_INT"), self.received_us("GPS_RAW_INT")
        _, first = np.unique(rows["time_usec"], return_index=True)
        first = np.sort(first)
        rows, received = rows[first], received[first]
        good = rows["fix_type"] >= FIX_3D
        rows, received = rows[good], received[good]
        if not len(rows):
            return None
        time = self.seconds(rows)
        if clock.size and (time[-1] < clock[0] or time[0] > clock[-1]):
            offset = self._clock_offset()
            time = received * 1e-6 - offset
            notes.append("GPS_RAW_INT: stamped by a different clock than the inertial unit: times of arrival are used")
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
        for name in ("HIL_SENSOR", "HIGHRES_IMU"):
            if name in self:
                return (
                    float(np.min(self.received_us(name) - self.columns(name)["time_usec"].astype(np.int64) + self.base_us))
                    * 1e-6
                )
        return 0.0

    def _truth(self) -> SolutionSeries | None:
        if "HIL_STATE_QUATERNION" not in self:
            return None
        rows = _each_once(self.columns("HIL_STATE_QUATERNION"))
        roll, pitch, heading = attitude.numeric.to_euler(_unit(rows["attitude_quaternion"]))
        return SolutionSeries(
            name="HIL_STATE_QUATERNION",
            time=self.seconds(rows),
            **_place(rows),
            velocity_n=np.stack([rows["vx"], rows["vy"], rows["vz"]], axis=1) * 1e-2,
            roll=roll,
            pitch=pitch,
            heading=heading,
            true=True,
        )

    def _estimate(self) -> SolutionSeries | None:
        if not ("ATTITUDE" in self or "ATTITUDE_QUATERNION" in self):
            return None
        name = "ATTITUDE_QUATERNION" if "ATTITUDE_QUATERNION" in self else "ATTITUDE"
        rows = _each_once(self.columns(name), "time_boot_ms")
        if name == "ATTITUDE":
            angles = [rows["roll"], rows["pitch"], rows["yaw"]]
        else:
            angles = list(attitude.numeric.to_euler(_unit(np.stack([rows[q] for q in ("q1", "q2", "q3", "q4")], axis=1))))
        roll, pitch, heading = (angle.astype(np.float64) for angle in angles)
        alone = SolutionSeries(name=name, time=rows["time_boot_ms"] * 1e-3, roll=roll, pitch=pitch, heading=heading)
        if "GLOBAL_POSITION_INT" not in self:
            return alone
        places = _each_once(self.columns("GLOBAL_POSITION_INT"), "time_boot_ms")
        velocity = np.stack([places["vx"], places["vy"], places["vz"]], axis=1) * 1e-2
        return with_places(
            alone, f"{name}, GLOBAL_POSITION_INT", places["time_boot_ms"] * 1e-3, **_place(places), velocity_n=velocity
        )


def _place(rows: np.ndarray) -> dict[str, Any]:
    """Latitude, longitude (rad) and height above mean sea level (m) of a message."""
    latitude, longitude = rows["lat"] * _DEG_E7, rows["lon"] * _DEG_E7
    return {"latitude": latitude, "longitude": longitude, "height": rows["alt"] * 1e-3, "height_sea": True}


def _three(rows: np.ndarray, what: str) -> Array:
    return np.stack([rows[f"{axis}{what}"].astype(np.float64) for axis in "xyz"], axis=1)


def _each_once(rows: np.ndarray, column: str = "time_usec") -> np.ndarray:
    """The first row of each time, in order of time."""
    _, first = np.unique(rows[column], return_index=True)
    return rows[first]


def _unit(q: np.ndarray) -> Array:
    q = q.astype(np.float64)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


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
