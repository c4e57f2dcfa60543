"""`kind = "waypoints"`: a planned track, from places, speeds and stops.

The vehicle goes straight from place to place.  It turns with at most `lateral_mps2`: a corner is an arc of the radius v^2 / a
that touches both lines, on which it goes at the lower of their speeds; its speed changes by at most `acceleration_mps2`. Points
every `STEP_S` along this way are smoothed to splines as those of a recorded track are, which rounds off the steps of the
acceleration.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import field_validator

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.base.toml import Number, Positive, key
from insenv.core.tables import Array
from insenv.scenario.tracks.section import TrackSection, knot_interval
from insenv.scenario.tracks.shape import Points, Shape, checked, shaped
from insenv.vehicles.section import MAX_DURATION_S, PlaceSection

STEP_S = 0.25
"""Time between the points of the plan, s."""
KNOT_S = 0.5
SPACING_M, MAX_POINTS = 1.0, 2_000_000
"""Distance of the points at which speeds are found; larger for a way of more points."""
MAX_TURN = 3.0
"""Largest turn on an arc, rad: a sharper one begins far before its place."""
MAX_CUT = 0.25
"""An arc that passes its place at more than this part of the shorter of its lines is noted."""
REST_S = 2.0
"""Time at rest at the first and at the last place, at least, s."""
SMOOTHING_M = 0.005
"""What the splines may leave of the plan, m: so much a corner of the acceleration is rounded off."""


class Waypoint(PlaceSection):
    """A place of the plan."""

    speed_mps: Number = key(..., "speed over ground from here on; that of the last place does not count", "m/s", gt=0, le=1e3)
    stop_s: Number = key(0.0, "time to stand here", "s", ge=0, le=MAX_DURATION_S)


_PASSES = declared(
    "waypoint-missed",
    "the arc at vehicle.waypoints[{number}] passes the waypoint at {distance:.0f} m: a stop_s, a lower speed or a larger "
    "lateral_mps2 brings it closer",
)


class WaypointsSection(TrackSection):
    """A vehicle on a planned track through places, with speeds and stops."""

    kind: Literal["waypoints"] = key(..., "kind of vehicle")
    waypoints: tuple[Waypoint, ...] = key(..., "the places, in order, two or more", max_length=1000)
    acceleration_mps2: Positive = key(1.0, "largest change of speed", "m/s2", le=50)
    lateral_mps2: Positive = key(2.0, "largest acceleration in a turn", "m/s2", le=50)

    @field_validator("waypoints")
    @classmethod
    def _two(cls, value: tuple[Waypoint, ...]) -> tuple[Waypoint, ...]:
        if len(value) < 2:
            raise ValueError("must have two places or more")
        return value

    def make_shape(self) -> Shape:
        time, place = planned(self)
        first = self.waypoints[0]
        origin = np.radians(first.latitude_deg), np.radians(first.longitude_deg), first.height_m
        latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(place, *origin)
        points = checked(Points("vehicle.waypoints", time, latitude, longitude, height), np.inf, np.inf)
        noise = SMOOTHING_M if self.smoothing_m is None else self.smoothing_m
        return shaped(points, knot_interval(self.knot_s, KNOT_S, points), noise, self.bank)

    @property
    def notes(self) -> tuple[Remark, ...]:
        """Places that the vehicle passes at a distance."""
        return tuple(_way(self, _offsets(self))[2])

    @property
    def lasts_s(self) -> float | None:
        """Duration of the plan, s, which needs no splines."""
        return float(planned(self)[0][-1])


def planned(section: WaypointsSection) -> tuple[Array, Array]:
    """Times (n,) s and offsets (n, 3) north, east, down from the first place, m."""
    line, limits, _ = _way(section, _offsets(section))
    return _timed(section, line, limits)


def _offsets(section: WaypointsSection) -> Array:
    """Offsets (places, 3) north, east, down from the first place, m.  Raises `InputError` for places that are too far."""
    places = section.waypoints
    first = places[0]
    here = [np.radians([w.latitude_deg for w in places]), np.radians([w.longitude_deg for w in places])]
    offsets = np.asarray(
        geodesy.numeric.ned_offset(
            *here,
            np.array([w.height_m for w in places]),
            float(np.radians(first.latitude_deg)),
            float(np.radians(first.longitude_deg)),
            first.height_m,
        )
    )
    if np.linalg.norm(offsets[:, :2], axis=1).max() > 3e5:
        raise InputError("vehicle.waypoints: places are more than 300 km from the first: allowed is up to 300 km")
    return offsets


def _way(section: WaypointsSection, offsets: Array) -> tuple[Array, Array, list[Remark]]:
    """Points (m, 3) of the way, `SPACING_M` apart or more, the largest speed (m,) at each, 0 where it stops, and notes."""
    places, parts, limits = section.waypoints, [], []
    notes = []
    begin = offsets[0]
    legs = np.diff(offsets, axis=0)
    lengths = np.linalg.norm(legs[:, :2], axis=1)
    for number, length in enumerate(lengths, 1):
        if length < 1.0:
            raise InputError(f"vehicle.waypoints[{number}]: {length:.3g} m from the place before: allowed is 1 m or more")
    stops = [w.stop_s > 0.0 for w in places]
    lasts = float(np.sum(lengths / [w.speed_mps for w in places[:-1]])) + sum(w.stop_s for w in places)
    _check_duration(lasts)
    spacing = max(SPACING_M, float(lengths.sum()) / MAX_POINTS)
    for k, length in enumerate(lengths):
        speed = places[k].speed_mps
        direction = legs[k] / length
        end, arc = offsets[k + 1], None
        if k + 1 < len(lengths) and not stops[k + 1]:
            after = legs[k + 1] / lengths[k + 1]
            turn = float(np.arctan2(direction[0] * after[1] - direction[1] * after[0], direction[:2] @ after[:2]))
            slower = min(speed, places[k + 1].speed_mps)
            shorter = min(length, lengths[k + 1])
            if abs(turn) > MAX_TURN:
                raise InputError(
                    f"vehicle.waypoints[{k + 1}]: a turn of {np.degrees(abs(turn)):.4g} deg: allowed is up to "
                    f"{np.degrees(MAX_TURN):.4g} deg, or a stop_s, at which the vehicle turns on the spot"
                )
            reach = min(slower**2 / section.lateral_mps2 * abs(np.tan(0.5 * turn)), 0.45 * shorter)
            if abs(turn) > 1e-4:
                radius = max(reach / abs(np.tan(0.5 * turn)), 1.0)
                corner = min(slower, float(np.sqrt(section.lateral_mps2 * radius)))
                end, arc = end - reach * direction, (end + reach * after, radius, turn, corner)
                missed = radius * (1.0 / np.cos(0.5 * turn) - 1.0)
                if missed > MAX_CUT * shorter:
                    notes.append(_PASSES.filled(number=k + 1, distance=missed))
        count = max(int(np.linalg.norm((end - begin)[:2]) / spacing), 2)
        share = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
        parts.append(begin + share * (end - begin))
        limits.append(np.full(count, speed))
        if stops[k]:
            limits[-1][0] = 0.0
        if arc is not None:
            leave, radius, turn, corner = arc
            count = max(int(radius * abs(turn) / spacing), 4)
            angle = np.linspace(0.0, turn, count, endpoint=False)
            along, across = direction[:2], np.sign(turn) * np.array([-direction[1], direction[0]])
            bow = radius * (np.sin(abs(angle))[:, None] * along + (1.0 - np.cos(angle))[:, None] * across)
            sunk = np.linspace(end[2], leave[2], count, endpoint=False)
            parts.append(np.column_stack([end[:2] + bow, sunk]))
            limits.append(np.full(count, corner))
            begin = leave
        else:
            begin = offsets[k + 1]
    parts.append(offsets[-1:])
    limits.append(np.zeros(1))
    return np.vstack(parts), np.concatenate(limits), notes


def _check_duration(lasts: float) -> None:
    if lasts > MAX_DURATION_S:
        raise InputError(f"vehicle.waypoints: the plan lasts {lasts:.6g} s or more: allowed is up to {MAX_DURATION_S:g} s")


def _timed(section: WaypointsSection, line: Array, limits: Array) -> tuple[Array, Array]:
    """The plan over time: speeds within the limits of places and of acceleration, forward and backward."""
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    square = limits**2
    square[0] = 0.0
    for k in range(len(step)):
        square[k + 1] = min(square[k + 1], square[k] + 2.0 * section.acceleration_mps2 * step[k])
    for k in reversed(range(len(step))):
        square[k] = min(square[k], square[k + 1] + 2.0 * section.acceleration_mps2 * step[k])
    speed = np.sqrt(square)
    lasts = 2.0 * step / np.maximum(speed[1:] + speed[:-1], 1e-3)
    pauses = [w.stop_s for w in section.waypoints]
    waits = np.zeros(len(line))
    waits[0], waits[-1] = max(pauses[0], REST_S), max(pauses[-1], REST_S)
    inner = np.flatnonzero(speed[1:-1] == 0.0) + 1
    waits[inner] = [pause for pause in pauses[1:-1] if pause > 0.0]
    arrival = np.concatenate([[0.0], np.cumsum(lasts)]) + np.concatenate([[0.0], np.cumsum(waits[:-1])])
    leaving = arrival + waits
    _check_duration(float(leaving[-1]))
    even = np.arange(0.0, leaving[-1], STEP_S)
    at = np.clip(np.searchsorted(leaving, even, side="right") - 1, -1, len(step) - 1)
    behind = np.maximum(at, 0)
    since = np.clip(even - leaving[behind], 0.0, lasts[behind]) * (at >= 0)
    push = (speed[behind + 1] - speed[behind]) / lasts[behind]
    share = np.clip((speed[behind] + 0.5 * push * since) * since / step[behind], 0.0, 1.0)[:, None]
    return even, line[behind] + share * (line[behind + 1] - line[behind])
