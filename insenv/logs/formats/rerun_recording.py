"""A recording for the Rerun viewer (https://rerun.io): tracks on a map and in space, errors with sigma and limit, sensors.

Entities: ``map/NAME`` (latitude, longitude), ``world/NAME`` (east, north, up from the first place of the truth, and attitude),
``error/ID/CHANNEL``, ``sigma/...`` and ``limit/...`` beside it, ``imu/gyro`` (rad/s) and ``imu/accel`` (m/s^2), b,
``imu/temperature`` (deg C), ``gnss`` and the other instruments.  The timeline ``time`` counts seconds from the start.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.core.tables import Array
from insenv.logs.formats.contract import Drive, Files, Format, NamedTrack
from insenv.logs.formats.rosbag import ENU, FLU
from insenv.logs.recorded import RecordedLog
from insenv.sensors.units import ZERO_CELSIUS

_KINDS = ("error", "sigma", "limit")
"""Series of an estimator that are recorded, by the begin of the names of their columns."""


def write(drive: Drive) -> Files:
    """The file NAME.rrd."""
    import rerun

    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / f"{drive.name}.rrd"
        stream = rerun.RecordingStream("insenv", recording_id=drive.name)
        stream.save(str(path))
        series = _Series(rerun, stream)
        if drive.log is not None:
            _sensors(series, drive.log)
        _tracks(series, drive.tracks_or_reference())
        for estimator, columns in drive.results.items():
            for name, values in columns.items():
                kind, _, channel = name.partition("_")
                if kind in _KINDS:
                    series.scalars(f"{kind}/{estimator}/{channel}", columns["time_s"], values)
        stream.flush()
        stream.disconnect()
        return {path.name: path.read_bytes()}


class _Series:
    """Columns of a recording over its timeline."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        self.rerun, self._stream = rerun, stream

    def send(self, entity: str, time: Array, columns: Any) -> None:
        self._stream.send_columns(entity, [self.rerun.TimeColumn("time", duration=time)], columns)

    def scalars(self, entity: str, time: Array, values: Array) -> None:
        """One scalar (n,), or several beside one another (n, k)."""
        columns = self.rerun.Scalars.columns(scalars=values.reshape(-1))
        self.send(entity, time, columns.partition([values[0].size] * len(values)) if values.ndim > 1 else columns)

    def places(self, entity: str, time: Array, latitude: Array, longitude: Array) -> None:
        """Places on the map (n,) rad."""
        self.send(entity, time, self.rerun.GeoPoints.columns(positions=np.degrees(np.stack([latitude, longitude], axis=1))))


def _sensors(series: _Series, log: RecordedLog) -> None:
    sampled = ~log.bridged
    dt = log.dt[sampled, None]
    series.scalars("imu/gyro", log.imu_time[sampled], log.delta_angle[sampled] / dt)
    series.scalars("imu/accel", log.imu_time[sampled], log.delta_velocity[sampled] / dt)
    if log.temperature is not None:
        series.scalars("imu/temperature", log.imu_time[sampled], log.temperature[sampled] - ZERO_CELSIUS)
    if log.gnss is not None:
        series.places("gnss", log.gnss.time, log.gnss.latitude, log.gnss.longitude)
        series.scalars("gnss/height", log.gnss.time, log.gnss.height)
    for each in log.instruments:
        series.scalars(each.id, each.time, each.values)


def _tracks(series: _Series, tracks: tuple[NamedTrack, ...]) -> None:
    origin: tuple[float, float, float] | None = None
    for track in tracks:
        turn: Array = np.eye(3)
        columns: dict[str, Array] = {}
        if track.place is not None:
            latitude, longitude, height = track.place
            series.places(f"map/{track.name}", track.time, latitude, longitude)
            origin = origin or (float(latitude[0]), float(longitude[0]), float(height[0]))
            columns["translation"] = geodesy.numeric.ned_offset(*track.place, *origin) @ ENU.T
            turn = geodesy.numeric.C_en(*origin[:2]).T @ geodesy.numeric.C_en(latitude, longitude)
        if track.q_nb is not None:
            q = attitude.numeric.from_dcm(ENU @ turn @ attitude.numeric.to_dcm(track.q_nb) @ FLU)
            columns["quaternion"] = np.asarray(q)[:, [1, 2, 3, 0]]
        if columns:
            series.send(f"world/{track.name}", track.time, series.rerun.Transform3D.columns(**columns))


FORMAT = Format(name="rerun", write=write, needs_log=True, module="rerun", package="rerun-sdk", extra="view")
