"""ROS 2 bags (a folder, .db3, .mcap), by rosbags: messages of sensors, truth and estimates.  ROS 1 bags (.bag) are read.

Axes are those of REP 103: body forward, left, up; ``map`` is east, north, up (REP 105).

Reading: a message counts at the stamp of its header; Imu messages are instants.  A twist with a covariance in ``map``, ``enu``,
``world`` or ``earth``, beside a NavSatFix in the same namespace with the same stamps, is the velocity of that fix.  An Odometry
counts as solution only beside such a NavSatFix: without it neither its place nor the meaning of its heading is known.

Writing: the origin of ``map`` is the first place of the truth.  An Imu message holds the mean rates of a sample and is stamped
with the middle of its interval; it is recorded at the end, which is the stamp of a Temperature too.  A NavSatFix is stamped
with its time of validity and recorded when it arrived.  Time 0 is `EPOCH`.  Topics: /imu/data, /imu/temperature (deg C),
/magnetometer, /gnss/fix, /gnss/velocity; for the truth and each estimate /NAME/odometry and /NAME/fix.
"""

from __future__ import annotations

import io
import re
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import floor
from pathlib import Path
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.formats.contract import EPOCH, Drive, Files, Format, NamedTrack
from insenv.logs.formats.series import FixSeries, Flight, ImuSeries, SolutionSeries, reading
from insenv.logs.recorded import GnssFixes, RecordedLog
from insenv.logs.units import LOCAL_AXES
from insenv.sensors.units import ZERO_CELSIUS

SIGNS = np.array([1.0, -1.0, -1.0])
"""Signs from forward, left, up to forward, right, down, and back."""
FLU = np.diag(SIGNS)
ENU = LOCAL_AXES["ENU"]
"""From east, north, up to north, east, down, and back."""
MAPS = frozenset(("map", "enu", "world", "earth"))
"""Frames whose axes point east, north, up."""
IMU, FIX, ODOMETRY = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
MAGNETIC, TEMPERATURE = "sensor_msgs/msg/MagneticField", "sensor_msgs/msg/Temperature"
_SAME_S = 1e-6
"""Stamps that differ by less belong together."""


def read(label: str, data: bytes) -> Flight:
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
        raise InputError(f"{label}: the ROS bag has no {', '.join(kind.partition('/')[2][4:] for kind in _VALUES)}")
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


_AXES = declared("axes-by-rep", "axes by REP 103 (body forward, left, up); times are counted from the first inertial sample")
_UNPLACED = declared(
    "odometry-unplaced", "{topic}: not used: without a NavSatFix of the same stamps its place and its north are not known"
)
_VELOCITY_OF = declared("velocity-of", "{topic}: velocity of {other}")


@dataclass
class _Topic:
    """The messages of a topic: name, kind, frame of the first; stamps (ns) and the values of each, as lists and as arrays."""

    name: str
    kind: str
    frame: str
    stamps: list[int] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    time: Array = field(default_factory=lambda: np.zeros(0))
    values: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def space(self) -> str:
        """The namespace."""
        return self.name.rpartition("/")[0]

    def beside(self, name: str, time: Array) -> bool:
        """Whether its messages have the stamps `time` (n,) s of the topic `name`, in the same namespace."""
        same = self.space == name.rpartition("/")[0] and self.time.shape == time.shape
        return same and bool(np.all(np.abs(self.time - time) < _SAME_S))


def _topics(bag: Any) -> tuple[list[_Topic], int]:
    """The topics with messages of known kinds, and the number of these messages."""
    topics: dict[str, _Topic] = {}
    count = 0
    for connection, _, raw in bag.messages(connections=[c for c in bag.connections if c.msgtype in _VALUES]):
        message = bag.deserialize(raw, connection.msgtype)
        name, frame = connection.topic, message.header.frame_id.strip("/").lower()
        topic = topics.setdefault(name, _Topic(name, connection.msgtype, frame))
        if topic.kind == connection.msgtype:
            topic.stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            topic.rows.append(_VALUES[topic.kind](message))
            count += 1
    return list(topics.values()), count


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


def _flight(topics: list[_Topic], count: int) -> Flight:
    # times from the first inertial sample: those of Unix time leave 0.2 us of a float
    first = min((t.stamps[0] for t in topics if t.kind == IMU), default=min(t.stamps[0] for t in topics))
    for topic in topics:
        topic.time = np.asarray((np.array(topic.stamps, dtype=np.int64) - first) * 1e-9, dtype=np.float64)
        topic.values = np.array(topic.rows, dtype=np.float64)
    of = {kind: [topic for topic in topics if topic.kind == kind] for kind in _VALUES}
    notes = [_AXES]
    imus = [
        ImuSeries(each.name, each.time, each.values[:, :3] * SIGNS, each.values[:, 3:] * SIGNS, "instant") for each in of[IMU]
    ]
    solutions, places = [], set()
    for topic in of[ODOMETRY]:
        partner = next((fix for fix in of[FIX] if fix.beside(topic.name, topic.time)), None)
        if partner is None:
            notes.append(_UNPLACED.filled(topic=topic.name))
        elif topic.frame in MAPS:
            places.add(partner.name)
            solutions.append(_solution(topic, partner.values))
    fixes = [fix for each in of[FIX] if each.name not in places and (fix := _fixes(each, of[TWIST], notes)) is not None]
    readings = [reading("magnetometer", each.name, each.time, each.values * SIGNS) for each in of[MAGNETIC][:1]]
    return Flight(imus=imus, fixes=fixes, solutions=solutions, notes=notes, rows=count, readings=readings)


def _fixes(topic: _Topic, twists: list[_Topic], notes: list[Remark]) -> FixSeries | None:
    """The fixes, with the velocities of a twist beside them."""
    good = (topic.values[:, 0] >= 0) & np.isfinite(topic.values[:, 1:4]).all(axis=1)
    rows, time = topic.values[good], topic.time[good]
    if not len(rows):
        return None
    variance = rows[:, [6, 5, 7]]
    stated = (rows[:, 4] > 0).all() and (variance > 0.0).all()
    velocity = velocity_sigma = None
    twist = next((each for each in twists if each.frame in MAPS and each.beside(topic.name, time)), None)
    if twist is not None:
        scatter = twist.values[:, [4, 3, 5]]
        velocity, velocity_sigma = twist.values[:, :3] @ ENU.T, np.sqrt(scatter) if (scatter > 0.0).all() else None
        notes.append(_VELOCITY_OF.filled(topic=topic.name, other=twist.name))
    return FixSeries(
        name=topic.name,
        time=time,
        latitude=np.radians(rows[:, 1]),
        longitude=np.radians(rows[:, 2]),
        height=rows[:, 3],
        position_sigma=np.sqrt(variance) if stated else np.full((len(rows), 3), np.nan),
        velocity_n=velocity,
        velocity_sigma=velocity_sigma,
    )


def _solution(topic: _Topic, fix: Array) -> SolutionSeries:
    """A solution in NED and FRD; the map is the level plane at its origin, where the first position places it."""
    rows, latitude, longitude, height = topic.values, np.radians(fix[:, 1]), np.radians(fix[:, 2]), fix[:, 3]
    offset = -(ENU @ rows[0, 7:10])
    origin = geodesy.numeric.geodetic_from_ned_offset(offset, latitude[0], longitude[0], height[0])
    turn = geodesy.numeric.C_en(latitude, longitude).transpose(0, 2, 1) @ geodesy.numeric.C_en(*origin[:2])
    C_map_body = attitude.numeric.to_dcm(rows[:, :4] / np.linalg.norm(rows[:, :4], axis=1)[:, None])
    C_nb = turn @ ENU @ C_map_body * SIGNS
    roll, pitch, heading = attitude.numeric.to_euler(attitude.numeric.from_dcm(C_nb))
    return SolutionSeries(
        name=topic.name,
        time=topic.time,
        latitude=latitude,
        longitude=longitude,
        height=height,
        velocity_n=np.einsum("kij,kj->ki", C_nb, rows[:, 4:7] * SIGNS),
        roll=roll,
        pitch=pitch,
        heading=heading,
        true=topic.name.strip("/").startswith("truth"),
    )


# Writing.

_KNOWN_DIAGONAL = 2  # NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
_SECOND = 10**9
_EPOCH_NS = round(EPOCH.timestamp()) * _SECOND


@dataclass(frozen=True)
class Stamped:
    """A message: when it is recorded (ns), topic, type and content."""

    at: int
    topic: str
    kind: str
    message: Any


def nanoseconds(time: float) -> int:
    """Unix time (ns) of a time (s) of the drive."""
    whole = floor(time)
    return _EPOCH_NS + whole * _SECOND + round((time - whole) * _SECOND)


def _write_bag(drive: Drive) -> Files:
    """The files of a bag in the folder NAME-bag."""
    return _written(drive, "SQLITE3", lambda folder: {f"{folder.name}/{path.name}": path for path in sorted(folder.iterdir())})


def _write_mcap(drive: Drive) -> Files:
    """NAME.mcap."""
    return _written(drive, "MCAP", lambda folder: {f"{drive.name}.mcap": folder / f"{folder.name}.mcap"})


def _written(drive: Drive, plugin: str, chosen: Callable[[Path], dict[str, Path]]) -> Files:
    """The chosen files of a bag.  plugin: name of its storage."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = sorted(_messages(_Maker(store.types), drive), key=lambda each: each.at)
    if not messages:
        raise InputError("there are neither sensors nor tracks to write")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / f"{drive.name}-bag"
        with Writer(folder, version=8, storage_plugin=StoragePlugin[plugin]) as writer:
            topics: dict[str, Any] = {}
            for each in messages:
                if each.topic not in topics:
                    topics[each.topic] = writer.add_connection(each.topic, each.kind, typestore=store)
                writer.write(topics[each.topic], each.at, store.serialize_cdr(each.message, each.kind))
        return {name: path.read_bytes() for name, path in chosen(folder).items()}


class _Maker:
    """Messages from NumPy values.  types: classes by name of the message."""

    def __init__(self, types: Any) -> None:
        self.types = types

    def stamped(self, topic: str, kind: str, frame: str, time: float, arrived: float, *content: Any) -> Stamped:
        """A message with a header; time: its stamp, arrived: when it is recorded (s)."""
        seconds, rest = divmod(nanoseconds(time), _SECOND)
        header = self.types["std_msgs/msg/Header"](self.types["builtin_interfaces/msg/Time"](seconds, rest), frame)
        return Stamped(nanoseconds(arrived), topic, kind, self.types[kind](header, *content))

    def part(self, name: str, *values: Any) -> Any:
        """A part of the geometry of a message; arrays give their elements."""
        flat = [each for value in values for each in (value.tolist() if isinstance(value, np.ndarray) else (value,))]
        return self.types[f"geometry_msgs/msg/{name}"](*flat)

    def vector(self, values: Array) -> Any:
        return self.part("Vector3", values)

    def fix(self, topic: str, frame: str, time: float, arrived: float, place: Array, variance: Array) -> Stamped:
        """place: latitude, longitude (deg), height; variance: east, north, up."""
        status = self.types["sensor_msgs/msg/NavSatStatus"](0, 1)
        content = (status, *place.tolist(), np.diag(variance).ravel(), _KNOWN_DIAGONAL)
        return self.stamped(topic, FIX, frame, time, arrived, *content)

    def twist(self, velocity: Array, covariance: Array) -> Any:
        """covariance (3, 3): of the velocity; the rest is 0."""
        whole = np.zeros((6, 6))
        whole[:3, :3] = covariance
        twist = self.part("Twist", self.vector(velocity), self.vector(np.zeros(3)))
        return self.types["geometry_msgs/msg/TwistWithCovariance"](twist, whole.ravel())

    def quaternion(self, q: Array) -> Any:
        """q: scalar first."""
        return self.part("Quaternion", q[[1, 2, 3, 0]])


def _messages(make: _Maker, drive: Drive) -> Iterator[Stamped]:
    if drive.log is not None:
        yield from _sensor_messages(make, drive.log)
    tracks = drive.tracks_or_reference()
    origin = next(((float(p[0][0]), float(p[1][0]), float(p[2][0])) for t in tracks if (p := t.place) is not None), None)
    for track in tracks:
        yield from _track_messages(make, track, origin)


def _sensor_messages(make: _Maker, log: RecordedLog) -> Iterator[Stamped]:
    sampled = ~log.bridged
    end, dt = log.imu_time[sampled], log.dt[sampled]
    sheet = log.sensors(in_place=False)
    rates, forces = log.delta_angle[sampled] @ FLU / dt[:, None], log.delta_velocity[sampled] @ FLU / dt[:, None]
    noise = sheet.angle_random_walk**2, sheet.velocity_random_walk**2
    unknown = np.zeros(9)
    unknown[0] = -1.0  # no orientation
    level = make.quaternion(np.array([1.0, 0.0, 0.0, 0.0]))
    for time, length, rate, force in zip(end, dt, rates, forces, strict=True):
        of_rate, of_force = (np.eye(3).ravel() * (density / length) for density in noise)
        content = (level, unknown, make.vector(rate), of_rate, make.vector(force), of_force)
        yield make.stamped("/imu/data", IMU, "base_link", time - 0.5 * length, time, *content)
    if log.temperature is not None:
        for time, celsius in zip(end, log.temperature[sampled] - ZERO_CELSIUS, strict=True):  # 0: of unknown variance
            yield make.stamped("/imu/temperature", TEMPERATURE, "base_link", time, time, float(celsius), 0.0)
    if log.gnss is not None:
        yield from _fix_messages(make, log.gnss)
    for each in log.instruments:
        if each.id == "magnetometer":
            arrival = each.time if each.arrival is None else each.arrival
            for time, arrived, flux in zip(each.time, arrival, each.values @ FLU, strict=True):
                yield make.stamped("/magnetometer", MAGNETIC, "base_link", time, arrived, make.vector(flux), np.zeros(9))


def _fix_messages(make: _Maker, gnss: GnssFixes) -> Iterator[Stamped]:
    arrival = gnss.time if gnss.arrival is None else gnss.arrival
    place = _degrees((gnss.latitude, gnss.longitude, gnss.height))
    for row, (time, arrived) in enumerate(zip(gnss.time, arrival, strict=True)):
        yield make.fix("/gnss/fix", "gnss_link", time, arrived, place[row], gnss.position_sigma[row, [1, 0, 2]] ** 2)
        if gnss.velocity_n is not None and gnss.velocity_sigma is not None:
            twist = make.twist(ENU @ gnss.velocity_n[row], np.diag(gnss.velocity_sigma[row, [1, 0, 2]] ** 2))
            yield make.stamped("/gnss/velocity", TWIST, "map", time, arrived, twist)


def _track_messages(make: _Maker, track: NamedTrack, origin: tuple[float, float, float] | None) -> Iterator[Stamped]:
    """/NAME/odometry where there is an attitude, /NAME/fix where there are positions."""
    count, name = len(track.time), re.sub(r"[^a-z0-9_]+", "_", track.name.lower())

    def variance(sigma: Array | None) -> Array:
        return np.zeros((count, 3)) if sigma is None else sigma**2

    position, speeds = variance(track.position_sigma)[:, [1, 0, 2]], variance(track.velocity_sigma)
    angles = np.radians(1.0) ** 2 * variance(track.attitude_sigma_deg)
    offset, turn = np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
    if track.place is not None and origin is not None:
        offset = geodesy.numeric.ned_offset(*track.place, *origin) @ ENU.T
        turn = geodesy.numeric.C_en(*origin[:2]).T @ geodesy.numeric.C_en(track.latitude, track.longitude)
        place = _degrees(track.place)
        for row, time in enumerate(track.time):
            yield make.fix(f"/{name}/fix", "base_link", time, time, place[row], position[row])
    if track.q_nb is None:
        return
    C_nb = attitude.numeric.to_dcm(track.q_nb)
    q = attitude.numeric.from_dcm(ENU @ turn @ C_nb @ FLU)
    velocity = np.zeros((count, 3))
    if track.velocity_n is not None:
        velocity = np.einsum("kji,kj->ki", C_nb, track.velocity_n) @ FLU
    for row, time in enumerate(track.time):
        pose = make.part("Pose", make.part("Point", offset[row]), make.quaternion(q[row]))
        covariance = np.diag([*position[row], *angles[row]]).ravel()
        placed = make.types["geometry_msgs/msg/PoseWithCovariance"](pose, covariance)
        moving = make.twist(velocity[row], FLU @ C_nb[row].T @ np.diag(speeds[row]) @ C_nb[row] @ FLU)
        yield make.stamped(f"/{name}/odometry", ODOMETRY, "map", time, time, "base_link", placed, moving)


def _degrees(place: tuple[Array, Array, Array]) -> Array:
    """Latitude, longitude (deg) and height (n, 3)."""
    return np.column_stack([np.degrees(place[0]), np.degrees(place[1]), place[2]])


FORMAT = Format(
    name="bag",
    kind="ROS bag",
    suffixes=(".mcap", ".db3", ".bag"),
    read_flight=read,
    hint="a bag with sensor_msgs/Imu at its full rate has them",
    write=_write_bag,
    needs_log=True,
    module="rosbags",
    extra="view",
)
MCAP = replace(FORMAT, name="mcap", suffixes=(), read_flight=None, write=_write_mcap)
