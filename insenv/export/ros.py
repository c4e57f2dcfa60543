"""ROS 2 messages of a drive, as a bag (SQLite) or an MCAP recording, by rosbags.

Axes are those of REP 103: body forward, left, up; ``map`` is east, north, up at the first place of the truth (REP 105).  An Imu
message holds the mean rates of a sample and is stamped with the middle of its interval; it is recorded at the end, which is
the stamp of a Temperature too.  A NavSatFix is stamped with its time of validity and recorded when it arrived.  Time 0 is
`insenv.export.tracks.EPOCH`.

Topics: /imu/data, /imu/temperature (deg C), /magnetometer, /gnss/fix, /gnss/velocity; for the truth and each estimate
/NAME/odometry and /NAME/fix.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from math import floor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY, Track
from insenv.export.tracks import EPOCH, NamedTrack, tracks_of
from insenv.logs import GnssFixes, RecordedLog, Reference
from insenv.logs.flight.rosbag import ENU
from insenv.logs.flight.rosbag import FLU as SIGNS
from insenv.report.run_data import RunData
from insenv.sensors.units import ZERO_CELSIUS

Array = NDArray[np.float64]

FLU = np.diag(SIGNS)
"""From forward, right, down to forward, left, up, and back."""
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


def bag(report: RunData | None, log: RecordedLog | None, name: str, mcap: bool) -> dict[str, bytes]:
    """The files of a bag (folder NAME-bag), or of an MCAP recording (NAME.mcap).

    Raises `InputError` if there is nothing to write.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    messages = sorted(_messages(store.types, report, log), key=lambda each: each.at)
    if not messages:
        raise InputError("there are neither sensors nor tracks to write")
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / f"{name}-bag"
        with Writer(folder, version=8, storage_plugin=plugin) as writer:
            topics: dict[str, Any] = {}
            for each in messages:
                if each.topic not in topics:
                    topics[each.topic] = writer.add_connection(each.topic, each.kind, typestore=store)
                writer.write(topics[each.topic], each.at, store.serialize_cdr(each.message, each.kind))
        if mcap:
            return {f"{name}.mcap": next(folder.glob("*.mcap")).read_bytes()}
        return {f"{folder.name}/{path.name}": path.read_bytes() for path in sorted(folder.iterdir())}


def _messages(types: Any, report: RunData | None, log: RecordedLog | None) -> Iterator[Stamped]:
    make = _Maker(types)
    named = tracks_of(report) if report is not None else []
    if log is not None:
        yield from _imu(make, log)
        if log.gnss is not None:
            yield from _fixes(make, log.gnss)
        for each in log.instruments:
            if each.id == "magnetometer":
                arrival = each.time if each.arrival is None else each.arrival
                for time, arrived, field in zip(each.time, arrival, each.values @ FLU, strict=True):
                    yield make.magnetic(time, arrived, field)
        if not named and log.reference is not None:
            named = [NamedTrack("truth", track_of_reference(log.reference))]
    origin = next(((t.track.latitude[0], t.track.longitude[0], t.track.height[0]) for t in named if _placed(t.track)), None)  # type: ignore[index]
    for each_track in named:
        yield from _odometry(make, each_track, origin)


def track_of_reference(reference: Reference) -> Track:
    """The reference of a log as a track."""
    angles = (reference.roll, reference.pitch, reference.heading)
    q_nb = None if any(a is None for a in angles) else attitude.numeric.from_euler(*angles)
    place = (reference.latitude, reference.longitude, reference.height)
    return Track(reference.time, q_nb, reference.velocity_n, *place)


def _placed(track: Track) -> bool:
    return track.latitude is not None and len(track.time) > 0


class _Maker:
    """Messages from NumPy values.  types: classes by name of the message."""

    def __init__(self, types: Any) -> None:
        self.types = types

    def header(self, time: float, frame: str) -> Any:
        seconds, rest = divmod(nanoseconds(time), _SECOND)
        return self.types["std_msgs/msg/Header"](self.types["builtin_interfaces/msg/Time"](seconds, rest), frame)

    def vector(self, values: Array) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](*values.tolist())

    def quaternion(self, q: Array) -> Any:
        w, x, y, z = q.tolist()
        return self.types["geometry_msgs/msg/Quaternion"](x, y, z, w)

    def imu(self, time: float, arrived: float, rate: Array, force: Array, variances: tuple[float, float]) -> Stamped:
        unknown = np.zeros(9)
        unknown[0] = -1.0  # no orientation
        rates, forces = (np.eye(3).ravel() * variance for variance in variances)
        level = np.array([1.0, 0.0, 0.0, 0.0])
        message = self.types["sensor_msgs/msg/Imu"](
            self.header(time, "base_link"),
            self.quaternion(level),
            unknown,
            self.vector(rate),
            rates,
            self.vector(force),
            forces,
        )
        return Stamped(nanoseconds(arrived), "/imu/data", "sensor_msgs/msg/Imu", message)

    def temperature(self, time: float, celsius: float) -> Stamped:
        kind = "sensor_msgs/msg/Temperature"
        message = self.types[kind](self.header(time, "base_link"), celsius, 0.0)  # 0: of unknown variance
        return Stamped(nanoseconds(time), "/imu/temperature", kind, message)

    def fix(self, topic: str, time: float, arrived: float, place: tuple[float, ...], variance: Array, frame: str) -> Stamped:
        status = self.types["sensor_msgs/msg/NavSatStatus"](0, 1)
        message = self.types["sensor_msgs/msg/NavSatFix"](
            self.header(time, frame), status, *place, np.diag(variance).ravel(), _KNOWN_DIAGONAL
        )
        return Stamped(nanoseconds(arrived), topic, "sensor_msgs/msg/NavSatFix", message)

    def velocity(self, time: float, arrived: float, velocity: Array, variance: Array) -> Stamped:
        covariance = np.zeros((6, 6))
        covariance[[0, 1, 2], [0, 1, 2]] = variance
        twist = self.types["geometry_msgs/msg/Twist"](self.vector(velocity), self.vector(np.zeros(3)))
        both = self.types["geometry_msgs/msg/TwistWithCovariance"](twist, covariance.ravel())
        kind = "geometry_msgs/msg/TwistWithCovarianceStamped"
        return Stamped(nanoseconds(arrived), "/gnss/velocity", kind, self.types[kind](self.header(time, "map"), both))

    def magnetic(self, time: float, arrived: float, field: Array) -> Stamped:
        kind = "sensor_msgs/msg/MagneticField"
        message = self.types[kind](self.header(time, "base_link"), self.vector(field), np.zeros(9))
        return Stamped(nanoseconds(arrived), "/magnetometer", kind, message)

    def odometry(self, topic: str, time: float, place: Array, q: Array, velocity: Array, P: Array, V: Array) -> Stamped:
        point = self.types["geometry_msgs/msg/Point"](*place.tolist())
        pose = self.types["geometry_msgs/msg/Pose"](point, self.quaternion(q))
        twist = self.types["geometry_msgs/msg/Twist"](self.vector(velocity), self.vector(np.zeros(3)))
        kind = "nav_msgs/msg/Odometry"
        message = self.types[kind](
            self.header(time, "map"),
            "base_link",
            self.types["geometry_msgs/msg/PoseWithCovariance"](pose, P.ravel()),
            self.types["geometry_msgs/msg/TwistWithCovariance"](twist, V.ravel()),
        )
        return Stamped(nanoseconds(time), topic, kind, message)


def _imu(make: _Maker, log: RecordedLog) -> Iterator[Stamped]:
    own = ~log.bridged
    dt = log.dt[own]
    notes = log.sensors(in_place=False)
    rates, forces = log.delta_angle[own] @ FLU / dt[:, None], log.delta_velocity[own] @ FLU / dt[:, None]
    noise = notes.angle_random_walk**2, notes.velocity_random_walk**2
    for end, length, rate, force in zip(log.imu_time[own], dt, rates, forces, strict=True):
        yield make.imu(end - 0.5 * length, end, rate, force, (noise[0] / length, noise[1] / length))
    if log.temperature is not None:
        for end, celsius in zip(log.imu_time[own], log.temperature[own] - ZERO_CELSIUS, strict=True):
            yield make.temperature(end, float(celsius))


def _fixes(make: _Maker, gnss: GnssFixes) -> Iterator[Stamped]:
    arrival = gnss.time if gnss.arrival is None else gnss.arrival
    place = np.degrees(gnss.latitude), np.degrees(gnss.longitude), gnss.height
    for row, (time, arrived) in enumerate(zip(gnss.time, arrival, strict=True)):
        where = tuple(float(each[row]) for each in place)
        yield make.fix("/gnss/fix", time, arrived, where, gnss.position_sigma[row, [1, 0, 2]] ** 2, "gnss_link")
        if gnss.velocity_n is not None and gnss.velocity_sigma is not None:
            yield make.velocity(time, arrived, ENU @ gnss.velocity_n[row], gnss.velocity_sigma[row, [1, 0, 2]] ** 2)


def _odometry(make: _Maker, named: NamedTrack, origin: tuple[float, float, float] | None) -> Iterator[Stamped]:
    """/NAME/odometry where there is an attitude, /NAME/fix where there are positions."""
    track, name = named.track, re.sub(r"[^a-z0-9_]+", "_", named.name.lower())
    count = len(track.time)
    variance = {channel: sigma**2 for channel, sigma in named.sigma.items()}

    def of(channels: tuple[str, ...]) -> Array:
        return np.stack([variance.get(channel, np.zeros(count)) for channel in channels], axis=1)

    offset, turn = np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
    if _placed(track) and origin is not None:
        offset = geodesy.numeric.ned_offset(track.latitude, track.longitude, track.height, *origin) @ ENU.T
        turn = geodesy.numeric.C_en(*origin[:2]).T @ geodesy.numeric.C_en(track.latitude, track.longitude)
        place = np.degrees(track.latitude), np.degrees(track.longitude), track.height  # type: ignore[arg-type]
        for row, time in enumerate(track.time):
            where = tuple(float(each[row]) for each in place)  # type: ignore[index]
            yield make.fix(f"/{name}/fix", time, time, where, of(POSITION)[row, [1, 0, 2]], "base_link")
    if track.q_nb is None:
        return
    C_nb = attitude.numeric.to_dcm(track.q_nb)
    q = attitude.numeric.from_dcm(ENU @ turn @ C_nb @ FLU)
    velocity = np.zeros((count, 3))
    if track.velocity_n is not None:
        velocity = np.einsum("kji,kj->ki", C_nb, track.velocity_n) @ FLU
    position, angles, speeds = of(POSITION)[:, [1, 0, 2]], np.radians(1.0) ** 2 * of(ATTITUDE), of(VELOCITY)
    for row, time in enumerate(track.time):
        P, V = np.zeros((6, 6)), np.zeros((6, 6))
        P[range(6), range(6)] = [*position[row], *angles[row]]
        V[:3, :3] = FLU @ C_nb[row].T @ np.diag(speeds[row]) @ C_nb[row] @ FLU
        yield make.odometry(f"/{name}/odometry", time, offset[row], q[row], velocity[row], P, V)
