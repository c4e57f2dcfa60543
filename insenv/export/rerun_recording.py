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
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.evaluation.errors import Track
from insenv.export.ros import FLU, track_of_reference
from insenv.export.tracks import NamedTrack, tracks_of
from insenv.logs import RecordedLog
from insenv.logs.flight.rosbag import ENU
from insenv.report.run_data import RunData
from insenv.sensors.units import ZERO_CELSIUS

Array = NDArray[np.float64]


def recording(report: RunData | None, log: RecordedLog | None, name: str) -> dict[str, bytes]:
    """The file NAME.rrd."""
    import rerun

    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / f"{name}.rrd"
        stream = rerun.RecordingStream("insenv", recording_id=name)
        stream.save(str(path))
        series = _Series(rerun, stream)
        named = tracks_of(report) if report is not None else []
        if log is not None:
            _sensors(series, log)
            if not named and log.reference is not None:
                named = [NamedTrack("truth", track_of_reference(log.reference))]
        _tracks(series, named)
        for result in report.results if report is not None else ():
            for kind, values in (("error", result.errors), ("sigma", result.sigma), ("limit", result.limit_sigma)):
                for channel, column in values.items():
                    series.scalars(f"{kind}/{result.estimator}/{channel}", result.time, column)
        stream.flush()
        stream.disconnect()
        return {f"{name}.rrd": path.read_bytes()}


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
    own = ~log.bridged
    dt = log.dt[own, None]
    series.scalars("imu/gyro", log.imu_time[own], log.delta_angle[own] / dt)
    series.scalars("imu/accel", log.imu_time[own], log.delta_velocity[own] / dt)
    if log.temperature is not None:
        series.scalars("imu/temperature", log.imu_time[own], log.temperature[own] - ZERO_CELSIUS)
    if log.gnss is not None:
        series.places("gnss", log.gnss.time, log.gnss.latitude, log.gnss.longitude)
        series.scalars("gnss/height", log.gnss.time, log.gnss.height)
    for each in log.instruments:
        series.scalars(each.id, each.time, each.values)


def _tracks(series: _Series, named: list[NamedTrack]) -> None:
    origin: tuple[float, float, float] | None = None
    for each in named:
        track = each.track
        place = (track.latitude, track.longitude, track.height)
        if track.latitude is not None and track.longitude is not None and track.height is not None:
            series.places(f"map/{each.name}", track.time, track.latitude, track.longitude)
            origin = origin or (float(track.latitude[0]), float(track.longitude[0]), float(track.height[0]))
        columns: dict[str, Array] = {}
        if origin is not None and track.latitude is not None:
            columns["translation"] = geodesy.numeric.ned_offset(*place, *origin) @ ENU.T
        if track.q_nb is not None:
            columns["quaternion"] = _turns(track, origin)[:, [1, 2, 3, 0]]
        if columns:
            series.send(f"world/{each.name}", track.time, series.rerun.Transform3D.columns(**columns))


def _turns(track: Track, origin: tuple[float, float, float] | None) -> Array:
    """Attitudes (n, 4, scalar first) from forward, left, up to east, north, up at the origin."""
    turn: Array = np.eye(3)
    if origin is not None and track.latitude is not None:
        turn = geodesy.numeric.C_en(*origin[:2]).T @ geodesy.numeric.C_en(track.latitude, track.longitude)
    return np.asarray(attitude.numeric.from_dcm(ENU @ turn @ attitude.numeric.to_dcm(track.q_nb) @ FLU))
