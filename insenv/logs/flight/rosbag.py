"""ROS bags, by rosbags: a ROS 2 bag (its folder, .db3, .mcap) or a ROS 1 bag (.bag) with Imu and NavSatFix messages.

Axes are those of REP 103: body forward, left, up.  A message counts at the stamp of its header.  Imu messages are instants.

A twist with a covariance in ``map``, ``enu``, ``world`` or ``earth`` (east, north, up), beside a NavSatFix in the same
namespace with the same stamps, is the velocity of that fix.  An Odometry counts as solution only beside such a NavSatFix:
without it neither its place nor the meaning of its heading is known.
"""

from __future__ import annotations

import io
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.logs.flight.series import (
    FixSeries,
    Flight,
    FlightFormat,
    ImuSeries,
    SolutionSeries,
    reading,
)
from insenv.logs.recorded import Readings
from insenv.logs.units import Array

FLU = np.array([1.0, -1.0, -1.0])
"""Signs from forward, left, up to forward, right, down, and back."""
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From east, north, up to north, east, down, and back."""
MAPS = frozenset(("map", "enu", "world", "earth"))
"""Frames whose axes point east, north, up."""
IMU, FIX, ODOMETRY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry"
TWIST, MAGNETIC = "geometry_msgs/msg/TwistWithCovarianceStamped", "sensor_msgs/msg/MagneticField"
_KINDS = (IMU, FIX, ODOMETRY, TWIST, MAGNETIC)
_HINT = "a bag with sensor_msgs/Imu at its full rate has them"
_SAME_S = 1e-6
"""Stamps that differ by less belong together."""


def read_bag(label: str, data: bytes) -> Flight:
    """The series of a bag.  data: of the file, or a tar archive of the folder.  Raises `InputError`: not readable as a bag."""
    need(f"{label}: a ROS bag", "rosbags")
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with tempfile.TemporaryDirectory() as scratch:
        path = _placed(label, data, Path(scratch))
        try:
            with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
                topics, count = _topics(bag)
        except InputError:
            raise
        except Exception as error:  # a damaged file can raise any exception
            raise InputError(f"{label}: not readable as a ROS bag: {error or type(error).__name__}") from None
    if not topics:
        raise InputError(f"{label}: the ROS bag has no {', '.join(kind.partition('/')[2][4:] for kind in _KINDS)}")
    return _flight(topics, count)


def _placed(label: str, data: bytes, scratch: Path) -> Path:
    """The bag as a file or a folder."""
    if data[257:262] == b"ustar":
        with tarfile.open(fileobj=io.BytesIO(data)) as archive:
            for member in archive.getmembers():
                content = archive.extractfile(member)
                if content is not None:
                    (scratch / Path(member.name).name).write_bytes(content.read())
        return scratch
    name = Path(label).name.lower()
    suffix = next((s for s in (".mcap", ".db3", ".bag") if s in name), ".mcap")
    path = scratch / f"bag{suffix}"
    path.write_bytes(data)
    return path


class _Topic:
    """The messages of a topic: kind, frame of the first, stamps (ns) and the values of each."""

    def __init__(self, kind: str, frame: str) -> None:
        self.kind, self.frame = kind, frame
        self.stamps: list[int] = []
        self.rows: list[tuple[float, ...]] = []


def _topics(bag: Any) -> tuple[dict[str, _Topic], int]:
    """The topics with messages of known kinds, and the number of these messages."""
    topics: dict[str, _Topic] = {}
    count = 0
    for connection, _, raw in bag.messages(connections=[c for c in bag.connections if c.msgtype in _KINDS]):
        message = bag.deserialize(raw, connection.msgtype)
        topic = topics.setdefault(connection.topic, _Topic(connection.msgtype, message.header.frame_id.strip("/").lower()))
        if topic.kind == connection.msgtype:
            topic.stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            topic.rows.append(_VALUES[topic.kind](message))
            count += 1
    return topics, count


def _three(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _odometry(message: Any) -> tuple[float, ...]:
    q, twist = message.pose.pose.orientation, message.twist.twist.linear
    return (q.w, q.x, q.y, q.z, *_three(twist), *_three(message.pose.pose.position))


_VALUES: Mapping[str, Any] = {
    IMU: lambda m: (*_three(m.angular_velocity), *_three(m.linear_acceleration)),
    FIX: lambda m: (
        m.status.status, m.latitude, m.longitude, m.altitude, m.position_covariance_type, *m.position_covariance[[0, 4, 8]],
    ),
    ODOMETRY: _odometry,
    TWIST: lambda m: (*_three(m.twist.twist.linear), *m.twist.covariance[[0, 7, 14]]),
    MAGNETIC: lambda m: _three(m.magnetic_field),
}  # fmt: skip
"""What is read of a message, by its kind."""


def _flight(topics: dict[str, _Topic], count: int) -> Flight:
    # times from the first inertial sample: those of Unix time leave 0.2 us of a float
    first = min((t.stamps[0] for t in topics.values() if t.kind == IMU), default=min(t.stamps[0] for t in topics.values()))
    times: dict[str, Array] = {
        name: np.asarray((np.array(topic.stamps, dtype=np.int64) - first) * 1e-9, dtype=np.float64)
        for name, topic in topics.items()
    }
    values = {name: np.array(topic.rows, dtype=np.float64) for name, topic in topics.items()}
    of = {kind: [name for name, topic in topics.items() if topic.kind == kind] for kind in _KINDS}
    notes = ["axes by REP 103 (body forward, left, up); times are counted from the first inertial sample"]
    imus = tuple(
        ImuSeries(name, times[name], values[name][:, :3] * FLU, values[name][:, 3:] * FLU, "instant") for name in of[IMU]
    )
    solutions, places = [], set()
    for name in of[ODOMETRY]:
        partner = next((fix for fix in of[FIX] if _space(fix) == _space(name) and _same(times[fix], times[name])), None)
        if partner is None:
            notes.append(f"{name}: not used: without a NavSatFix of the same stamps its place and its north are not known")
        elif topics[name].frame in MAPS:
            places.add(partner)
            solutions.append(_solution(name, times[name], values[name], values[partner]))
    fixes = [_fixes(name, times[name], values[name]) for name in of[FIX] if name not in places]
    found = tuple(
        _with_velocity(fix, topics, times, values, of[TWIST], notes) for fix in fixes if fix is not None and len(fix.time)
    )
    readings = tuple(_readings(times, values, of[MAGNETIC]))
    return Flight(
        tuple(sorted(imus, key=lambda imu: -imu.rate_hz)), found, tuple(solutions), tuple(notes), count, readings=readings
    )


def _space(topic: str) -> str:
    return topic.rpartition("/")[0]


def _same(times: Array, others: Array) -> bool:
    return times.shape == others.shape and bool(np.all(np.abs(times - others) < _SAME_S))


def _fixes(name: str, time: Array, rows: Array) -> FixSeries | None:
    good = (rows[:, 0] >= 0) & np.isfinite(rows[:, 1:4]).all(axis=1)
    rows, time = rows[good], time[good]
    if not len(rows):
        return None
    variance = rows[:, [6, 5, 7]]
    stated = (rows[:, 4] > 0).all() and (variance > 0.0).all()
    sigma = np.sqrt(variance) if stated else np.full((len(rows), 3), np.nan)
    return FixSeries(
        name=name,
        time=time,
        latitude=np.radians(rows[:, 1]),
        longitude=np.radians(rows[:, 2]),
        height=rows[:, 3],
        position_sigma=sigma,
    )


def _with_velocity(
    fix: FixSeries,
    topics: dict[str, _Topic],
    times: dict[str, Array],
    values: dict[str, Array],
    twists: list[str],
    notes: list[str],
) -> FixSeries:
    """The fixes with the velocities of a twist beside them."""
    for name in twists:
        if _space(name) == _space(fix.name) and topics[name].frame in MAPS and _same(times[name], fix.time):
            variance = values[name][:, [4, 3, 5]]
            sigma = np.sqrt(variance) if (variance > 0.0).all() else None
            notes.append(f"{fix.name}: velocity of {name}")
            return replace(fix, velocity_n=values[name][:, :3] @ ENU.T, velocity_sigma=sigma)
    return fix


def _solution(name: str, time: Array, rows: Array, fix: Array) -> SolutionSeries:
    """A solution in NED and FRD; the map is the level plane at its origin, where the first position places it."""
    latitude, longitude, height = np.radians(fix[:, 1]), np.radians(fix[:, 2]), fix[:, 3]
    offset = -(ENU @ rows[0, 7:10])
    origin = geodesy.numeric.geodetic_from_ned_offset(offset, latitude[0], longitude[0], height[0])
    turn = geodesy.numeric.C_en(latitude, longitude).transpose(0, 2, 1) @ geodesy.numeric.C_en(*origin[:2])
    C_map_body = attitude.numeric.to_dcm(rows[:, :4] / np.linalg.norm(rows[:, :4], axis=1)[:, None])
    C_nb = turn @ ENU @ C_map_body * FLU
    roll, pitch, heading = attitude.numeric.to_euler(attitude.numeric.from_dcm(C_nb))
    velocity_n = np.einsum("kij,kj->ki", C_nb, rows[:, 4:7] * FLU)
    return SolutionSeries(
        name=name,
        time=time,
        latitude=latitude,
        longitude=longitude,
        height=height,
        velocity_n=velocity_n,
        roll=roll,
        pitch=pitch,
        heading=heading,
        true=name.strip("/").startswith("truth"),
    )


def _readings(times: dict[str, Array], values: dict[str, Array], names: list[str]) -> Iterator[Readings]:
    """The first magnetometer."""
    for name in names[:1]:
        found = reading("magnetometer", name, times[name], values[name] * FLU)
        if found is not None:
            yield found


FORMATS = tuple(FlightFormat(suffix, "ROS bag", _HINT, read_bag) for suffix in (".mcap", ".db3", ".bag"))
