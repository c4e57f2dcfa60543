"""The section [vehicle] of a recorded track."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from insenv.base.errors import InputError
from insenv.base.remarks import Remark
from insenv.base.toml import Number, Positive, key
from insenv.geodesy import POLAR_RADIUS
from insenv.scenario.tracks.readers import Column, Columns, fingerprint, formats, points_of
from insenv.scenario.tracks.shape import Points, Shape, checked, shaped, start_of
from insenv.vehicles.section import MARGIN_MPS, StartSection, VehicleSection
from insenv.vehicles.track import DEGREE, SIZES, track
from insenv.vehicles.truth import Vehicle

MIN_KNOT_S = 0.05
MAX_GAP_KNOTS = 200
"""Knots between two points: with more, rounding decides what the smoothest spline between them is."""
MAX_ROTATION = 0.25
"""Largest rotation in a sample, rad, that the truth of a vehicle allows."""
_MAX_KNOTS = SIZES[-1] - DEGREE - 1


class TrackSection(VehicleSection):
    """Keys of every kind of track."""

    bank: Literal["coordinated", "level"] = key("coordinated", "roll where the file has none: that of coordinated turns, or 0")
    smoothing_m: Number | None = key(
        None, "noise of the positions to smooth away, standard deviation; absent: found by cross-validation", "m", ge=0, le=1e4
    )
    knot_s: Positive | None = key(None, "time between the knots of the splines; absent: that between points", "s", le=3600)

    @property
    def shape(self) -> Shape:
        """The splines, made once for the same values.  Raises `InputError` for what cannot be a track."""
        return _shape(type(self), self.model_dump_json())

    def make_shape(self) -> Shape:
        """The splines from the file or the plan."""
        raise NotImplementedError

    @property
    def in_place(self) -> bool:
        """A track leads somewhere."""
        return False

    @property
    def lasts_s(self) -> float | None:
        """Duration of the track, s."""
        return self.shape.duration_s

    @property
    def fastest_mps(self) -> float:
        """A speed towards a pole that it does not exceed: a derivative of a spline is a mean of differences of its points."""
        steps = np.abs(np.diff(self.shape.points[:, 0]))
        return float(steps.max(initial=0.0)) / self.shape.interval * POLAR_RADIUS + MARGIN_MPS

    @property
    def notes(self) -> tuple[Remark, ...]:
        """Sentences on what was chosen in the file of the track."""
        return self.shape.notes

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        return track(_size(len(self.shape.points)))

    def check_interval(self, sample_interval: float) -> None:
        """Raise `InputError` for knots closer than samples, and for large rotations per sample."""
        shape = self.shape
        if shape.interval < sample_interval * (1.0 - 1e-9):
            raise InputError(
                f"vehicle: knots every {shape.interval:g} s with samples every {sample_interval:g} s: allowed is a knot_s of a "
                "sample or more, or a higher rate_hz"
            )
        times = np.linspace(0.0, shape.duration_s, 2 * len(shape.points))
        turned = float(np.abs(shape.spline.at(times, 1)[:, 3:]).max()) * sample_interval
        if turned > MAX_ROTATION:
            raise InputError(
                f"vehicle: rotation of {turned:.2g} rad in a sample: allowed is {MAX_ROTATION} rad; use a higher rate_hz"
            )

    def start_values(self) -> dict[str, float]:
        """The keys of [start]."""
        latitude, longitude, height = start_of(self.shape)
        heading = float(self.shape.spline.at(np.zeros(1))[0, 5])
        turned = float(np.degrees(np.arctan2(np.sin(heading), np.cos(heading))))
        place = {"latitude_deg": float(np.degrees(latitude)), "longitude_deg": float(np.degrees(longitude)), "height_m": height}
        return {**place, "heading_deg": turned}

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a [start] that is not that of the track."""
        shape = self.shape
        for name, value in self.start_values().items():
            if abs(getattr(start, name) - value) > 1e-6:
                raise InputError(
                    f"start.{name} = {getattr(start, name):g}: the track begins at {value:.10g}; leave [start] out"
                )
        size, count = _size(len(shape.points)), len(shape.points)
        padded = np.vstack([shape.points, np.repeat(shape.points[-1:], size - count, axis=0)])
        latitude, longitude, height = start_of(shape)
        return {
            "track_points": padded,
            "track_interval": shape.interval,
            "track_latitude": shape.origin[0],
            "track_height": shape.origin[2],
            "start_latitude": latitude,
            "start_longitude": longitude,
            "start_height": height,
            "start_heading": 0.0,
            "mean_roll": 0.0,
            "mean_pitch": 0.0,
        }


@lru_cache(maxsize=32)
def _shape(kind: type[TrackSection], text: str) -> Shape:
    return kind.model_validate_json(text).make_shape()


def _size(count: int) -> int:
    return next((size for size in SIZES if size > count), SIZES[-1])


class RecordedFile(TrackSection):
    """The fingerprint of the file that a track comes from."""

    sha256: str = key(
        "",
        "SHA-256 of the file, with the files that a .toml names: they must not change; filled in when the scenario is loaded",
        max_length=64,
    )

    @model_validator(mode="before")
    @classmethod
    def _fingerprint(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or not isinstance(data.get("file"), str):
            return data
        path = Path(data["file"])
        now = fingerprint(path)
        if data.get("sha256") not in ("", None, now):
            raise ValueError(f"{path}: the file has changed since this scenario was loaded")
        return {**data, "sha256": now}


class RecordedSection(RecordedFile):
    """A vehicle on a recorded track: CSV, GPX, NMEA, KML, a flight log, a log or the result of a run."""

    kind: Literal["recorded"] = key(..., "kind of vehicle")
    file: str = key(..., f"the file, relative to this TOML file: {formats()}", min_length=1)
    columns: Columns = key(Columns(), "columns of a CSV file")
    track: Column | None = key(
        None, "the track of a GPX or KML file with several, by name or by number, counted from 0; absent: the first"
    )
    height_offset_m: Number = key(0.0, "added to the heights, as that of the geoid above the ellipsoid", "m", ge=-1e4, le=1e4)
    max_gap_s: Positive = key(10.0, "a longer gap between points is an error", "s", le=3600)
    max_acceleration_mps2: Positive = key(20.0, "a larger acceleration over one second is a jump, an error", "m/s2", le=1e4)

    def make_shape(self) -> Shape:
        read = points_of(Path(self.file), self.columns, self.height_offset_m, self.track)
        points = checked(read, self.max_gap_s, self.max_acceleration_mps2)
        return shaped(points, knot_interval(self.knot_s, spacing(points), points), self.smoothing_m, self.bank)


def spacing(points: Points) -> float:
    """Usual time between points, s, at least `MIN_KNOT_S`."""
    return max(float(np.median(np.diff(points.time))), MIN_KNOT_S)


def knot_interval(stated: float | None, usual: float, points: Points) -> float:
    """Time between knots, s: as stated, or the usual one, longer for a long track.

    Raises `InputError` for too many knots, in all or in a gap, and for too few.
    """
    lasts = float(points.time[-1])
    interval = stated or max(usual, lasts / (_MAX_KNOTS - 1))
    if interval > lasts:
        raise InputError(f"knot_s = {interval:g} s: allowed is at most the duration of the track, {lasts:.6g} s")
    if lasts / interval > _MAX_KNOTS:
        raise InputError(f"knot_s = {interval:g} s: {lasts / interval:.0f} knots: allowed is at most {_MAX_KNOTS}")
    gap = float(np.diff(points.time).max())
    if gap > MAX_GAP_KNOTS * interval:
        raise InputError(
            f"{points.label}: a gap of {gap:.6g} s with knots every {interval:g} s: allowed are {MAX_GAP_KNOTS} knots in a "
            f"gap, with a knot_s of {gap / MAX_GAP_KNOTS:.6g} s or more"
        )
    return float(interval)
