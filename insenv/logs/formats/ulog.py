"""PX4 ULog files (.ulg), by pyulog: sensor_combined or vehicle_imu, vehicle_gps_position or sensor_gps, and PX4's solution.

Inertial samples are means over the integration time that ends at their time stamp, in body FRD, calibrated by PX4.
https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.formats.contract import Format
from insenv.logs.formats.series import (
    AZIMUTH_SIGMA,
    FIX_3D,
    GAUSS,
    UNIX_US,
    FixSeries,
    Flight,
    ImuSeries,
    SolutionSeries,
    instance_name,
    reading,
    three_sigmas,
    with_places,
)
from insenv.logs.recorded import Readings
from insenv.logs.units import ANGLE_UNITS

MAGIC = b"ULog\x01\x12\x35"
_HEADER_BYTES = 16
_APPENDED = slice(_HEADER_BYTES + 3 + 16, _HEADER_BYTES + 3 + 40)
"""Where the flag bits, the first message, give the offsets of appended data."""
_MESSAGES = frozenset(b"ABCDFILMOPQRS")
"""Kinds of messages, by the letter after the size."""
_SYNC = ord("S")
_SYNC_BYTES = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))
_MAX_READS = 300_000
"""Allowed reads without progress: two for each byte of the longest message, after which pyulog searches byte by byte."""
_E7 = ANGLE_UNITS["1e-7 deg"]
_RECEIVERS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = [
    "sensor_combined",
    "vehicle_imu",
    *_RECEIVERS,
    "vehicle_attitude",
    "vehicle_local_position",
    "vehicle_global_position",
    "vehicle_magnetometer",
    "vehicle_air_data",
]
_DROPOUTS = declared("logger-dropouts", "{count} dropouts of the logger, {lost:.3g} s in total")
_DAMAGED = declared("file-damaged", "the file is damaged: its readable part is used")
_CUT_OFF = declared(
    "file-cut-off", "the file is cut off within its last message, of which {size} bytes are there; later data are missing"
)
_SKIPPED = declared("bytes-skipped", "the file is damaged: {lost} bytes at {places} are not messages and are skipped")
_UNIX_TIME = declared("unix-time", "time stamps are Unix time: times are counted from the first inertial sample")

Columns = dict[str, Any]


def read(label: str, data: bytes) -> Flight:
    """The series of a ULog file. Raises InputError: not such a file, or not readable by pyulog."""
    if not data.startswith(MAGIC):
        raise InputError(f"{label}: not a PX4 ULog file: it must begin with 'ULog'")
    need(f"{label}: a ULog file", "pyulog")
    from pyulog import ULog

    whole, damage = whole_messages(data)
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # pyulog prints what it skips
            log = ULog(_Advancing(whole), _TOPICS)
    except Exception as error:  # a damaged file can raise any exception
        raise InputError(f"{label}: not readable as a PX4 ULog file: {error or type(error).__name__}") from None
    topics = {(d.name, d.multi_id): d.data for d in log.data_list if len(d.data["timestamp"])}
    notes = _rebased(topics)
    fixes = [
        _fixes(instance_name(name, instance or None), table)
        for (name, instance), table in sorted(topics.items(), key=lambda item: (item[0][0] == "sensor_gps", item[0]))
        if name in _RECEIVERS
    ]
    undulation = next((each.undulation for each in fixes if each is not None and each.undulation is not None), None)
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts) * 1e-3
        notes.append(_DROPOUTS.filled(count=len(log.dropouts), lost=lost))
    notes += damage
    if log.file_corruption and not damage:
        notes.append(_DAMAGED)
    return Flight(
        imus=_imus(topics),
        fixes=fixes,
        solutions=[_solution(topics, undulation or 0.0)],
        notes=notes,
        rows=sum(len(table["timestamp"]) for table in topics.values()),
        parameters={str(name): float(value) for name, value in log.initial_parameters.items()},
        readings=list(_readings(topics)),
        unix=_date(topics),
    )


def _date(topics: dict[tuple[str, int], Columns]) -> float | None:
    """Unix time (s) of the first fix that has one."""
    times = [table["time_utc_usec"] for (name, _), table in topics.items() if name in _RECEIVERS and "time_utc_usec" in table]
    known = [float(each[each > 0][0]) * 1e-6 for each in times if (each > 0).any()]
    return known[0] if known else None


def whole_messages(data: bytes) -> tuple[bytes, list[Remark]]:
    """The file with its whole messages only, and notes on what it lacks: its end, or bytes that are no message.

    pyulog stops at some bytes that are no message. A ULog file has no checksums: values that are wrong within whole messages
    cannot be found.
    """
    notes: list[Remark] = []
    pieces, begin, at, lost, places, end = [], 0, _HEADER_BYTES, 0, 0, len(data)
    while at + 3 <= end:
        size, kind = int.from_bytes(data[at : at + 2], "little"), data[at + 2]
        if kind not in _MESSAGES or (kind == _SYNC and data[at + 3 : at + 11] != _SYNC_BYTES):
            resumed = _resumed(data, at + 1)
            pieces.append(data[begin:at])
            lost, places, at, begin = lost + resumed - at, places + 1, resumed, resumed
        elif at + 3 + size > end:
            break
        else:
            at += 3 + size
    if at < end:
        notes.append(_CUT_OFF.filled(size=end - at))
    if lost:
        notes.append(_SKIPPED.filled(lost=lost, places=f"{places} place{'s' if places > 1 else ''}"))
    if not lost or any(data[_APPENDED]):  # the places of appended data are offsets into the file
        return data, notes
    return b"".join([*pieces, data[begin:at]]), notes


def _resumed(data: bytes, at: int) -> int:
    """Offset from `at` where three messages follow one another; the end of the data if there is none."""
    end = len(data)
    while at + 3 <= end:
        next_at, count = at, 0
        while count < 3 and next_at + 3 <= end and data[next_at + 2] in _MESSAGES:
            next_at += 3 + int.from_bytes(data[next_at : next_at + 2], "little")
            count += 1
        if (count == 3 and next_at <= end) or (count and next_at == end):
            return at
        at += 1
    return end


class _Advancing(io.BytesIO):
    """A file that raises an error when it is read without progress: some broken messages send pyulog into an endless loop."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._furthest = self._since = 0

    def read(self, size: int | None = -1, /) -> bytes:
        piece = super().read(size)
        self._since += 1
        if self.tell() > self._furthest:
            self._furthest, self._since = self.tell(), 0
        elif self._since > _MAX_READS:
            raise _EndlessError("a broken message")
        return piece


class _EndlessError(Exception):
    """Not one of the errors that pyulog catches at a broken message."""


def _rebased(topics: dict[tuple[str, int], Columns]) -> list[Remark]:
    """Count times from the first inertial sample if they are Unix time, as in logs of a simulated PX4."""
    first = min(
        (int(t["timestamp"][0]) for (name, _), t in topics.items() if name in ("sensor_combined", "vehicle_imu")), default=0
    )
    if first < UNIX_US:
        return []
    for table in topics.values():
        for column in ("timestamp", "timestamp_sample"):
            if column in table:
                stamps = np.asarray(table[column]).astype(np.int64)
                table[column] = np.where(stamps > 0, stamps - first, 0)
    return [_UNIX_TIME]


def _imus(topics: dict[tuple[str, int], Columns]) -> list[ImuSeries]:
    imus = []
    for (name, instance), table in topics.items():
        if name == "sensor_combined":
            time, rate, force = table["timestamp"], _three(table, "gyro_rad"), _three(table, "accelerometer_m_s2")
        elif name == "vehicle_imu":
            time = table.get("timestamp_sample", table["timestamp"])
            rate = _three(table, "delta_angle") / _seconds(table["delta_angle_dt"])[:, None]
            force = _three(table, "delta_velocity") / _seconds(table["delta_velocity_dt"])[:, None]
        else:
            continue
        imus.append(ImuSeries(instance_name(name, instance or None), _seconds(time), rate, force, "interval_end"))
    return sorted(imus, key=lambda imu: imu.name)


def _fixes(name: str, table: Columns) -> FixSeries | None:
    good = np.asarray(table["fix_type"]) >= FIX_3D
    if not good.any():
        return None
    table = {column: np.asarray(values)[good] for column, values in table.items()}
    if "latitude_deg" in table:
        latitude, longitude = np.radians(table["latitude_deg"]), np.radians(table["longitude_deg"])
        sea, height = table["altitude_msl_m"].astype(np.float64), table["altitude_ellipsoid_m"].astype(np.float64)
    else:
        latitude, longitude = table["lat"] * _E7, table["lon"] * _E7
        sea, height = table["alt"] * 1e-3, table["alt_ellipsoid"] * 1e-3
    ellipsoidal = bool(np.any(height != 0.0))  # a receiver without heights above the ellipsoid leaves them at zero
    velocity = velocity_sigma = None
    if (table["vel_ned_valid"] != 0).all():
        velocity = np.stack([table["vel_n_m_s"], table["vel_e_m_s"], table["vel_d_m_s"]], axis=1).astype(np.float64)
        accuracy = table["s_variance_m_s"].astype(np.float64)  # a standard deviation, despite its name
        if (accuracy > 0).all():
            velocity_sigma = np.stack([accuracy] * 3, axis=1)
    return FixSeries(
        name=name,
        time=_sampled_at(table),
        latitude=np.asarray(latitude, dtype=np.float64),
        longitude=np.asarray(longitude, dtype=np.float64),
        height=height if ellipsoidal else sea,
        height_sea=not ellipsoidal,
        undulation=float(np.median(height - sea)) if ellipsoidal else None,
        position_sigma=three_sigmas(table["eph"].astype(np.float64), table["epv"].astype(np.float64)),
        velocity_n=velocity,
        velocity_sigma=velocity_sigma,
    )


def _readings(topics: dict[tuple[str, int], Columns]) -> Iterator[Readings | None]:
    """Magnetometer and barometer that PX4 selects, calibrated by it, and the heading of a receiver with two antennas.

    PX4's heading is that of the body: its driver has removed the mounting of the antennas.
    """
    magnetometer, air = topics.get(("vehicle_magnetometer", 0)), topics.get(("vehicle_air_data", 0))
    if magnetometer is not None and "magnetometer_ga[0]" in magnetometer:
        field = _three(magnetometer, "magnetometer_ga") * GAUSS
        yield reading("magnetometer", "vehicle_magnetometer", _sampled_at(magnetometer), field)
    if air is not None and "baro_alt_meter" in air:
        yield reading("barometer", "vehicle_air_data", _sampled_at(air), np.asarray(air["baro_alt_meter"], dtype=np.float64))
    for name in _RECEIVERS:
        table = topics.get((name, 0))
        if table is not None and "heading" in table and np.isfinite(table["heading"]).any():
            azimuth = np.asarray(table["heading"], dtype=np.float64)
            stated = np.asarray(table.get("heading_accuracy", np.full(azimuth.shape, np.nan)), dtype=np.float64)
            sigma = np.where(stated > 0.0, stated, AZIMUTH_SIGMA)
            yield reading("heading", name, _seconds(table["timestamp"]), np.stack([azimuth, sigma], axis=1))
            return


def _sampled_at(table: Columns) -> Array:
    """Time of validity (s): that of the sample where it is stated."""
    stamp = table.get("timestamp_sample")
    return _seconds(table["timestamp"] if stamp is None or not np.all(np.asarray(stamp) > 0) else stamp)


def _solution(topics: dict[tuple[str, int], Columns], undulation: float) -> SolutionSeries | None:
    """PX4's solution: attitude of vehicle_attitude, the rest of vehicle_local_position where its origin is known."""
    turned, place = topics.get(("vehicle_attitude", 0)), topics.get(("vehicle_local_position", 0))
    if turned is None:
        return None
    q = _columns(turned, [f"q[{i}]" for i in range(4)])
    length = np.linalg.norm(q, axis=1)
    good = np.isfinite(length) & (length > 0.5)  # zeros before PX4's filter has started
    if np.count_nonzero(good) < 2:
        return None
    roll, pitch, heading = attitude.numeric.to_euler(q[good] / length[good, None])
    time = _seconds(turned["timestamp"])[good]
    alone = SolutionSeries(name="vehicle_attitude", time=time, roll=roll, pitch=pitch, heading=heading)
    if place is None:
        return alone
    known = (np.asarray(place["xy_global"]) != 0) & (np.asarray(place["z_global"]) != 0)
    place = {column: np.asarray(values)[known] for column, values in place.items()}
    origin = (np.radians(place["ref_lat"]), np.radians(place["ref_lon"]), place["ref_alt"] + undulation)
    latitude, longitude, height = _placed(_columns(place, ["x", "y", "z"]), origin)
    return with_places(
        alone,
        "vehicle_attitude, vehicle_local_position",
        _seconds(place["timestamp"]),
        latitude=latitude,
        longitude=longitude,
        height=height,
        velocity_n=_columns(place, ["vx", "vy", "vz"]),
    )


def _placed(offset: Array, origin: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """Latitude, longitude (rad) and height (m) of offsets from origins."""
    places = np.array([geodesy.numeric.geodetic_from_ned_offset(o, *place) for o, *place in zip(offset, *origin, strict=True)])
    latitude, longitude, height = places.reshape(-1, 3).T
    return latitude, longitude, height


def _three(table: Columns, name: str) -> Array:
    return _columns(table, [f"{name}[{i}]" for i in range(3)])


def _columns(table: Columns, names: list[str]) -> Array:
    return np.stack([np.asarray(table[name], dtype=np.float64) for name in names], axis=1)


def _seconds(microseconds: Any) -> Array:
    return np.asarray(microseconds, dtype=np.float64) * 1e-6


FORMAT = Format(
    name="ulog",
    kind="PX4 ULog file",
    suffixes=(".ulg",),
    read_flight=read,
    hint="SDLOG_PROFILE selects what is logged: the default includes sensor_combined",
)
