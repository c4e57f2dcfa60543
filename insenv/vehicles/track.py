"""A vehicle on a given track: position and attitude are splines of degree 5 over time (`insenv.vehicles.splines`).

Latitude, longitude, height, roll, pitch and heading are the channels; their control points are rows of a parameter. The model
holds the six points of the interval that it is in; at a knot it looks up the next one. The velocity is the exact derivative:

    v_N = (R_M + h) dL/dt,    v_E = (R_N + h) cos L dl/dt,    v_D = -dh/dt        (Groves 2013, eq. 2.111)

so that the integral of the velocity, the position of the truth, stays on the track.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca

from insenv.core.elementary import minimum
from insenv.core.lookup import row_of
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table
from insenv.geodesy import radii
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.splines import BASIS, POINTS
from insenv.vehicles.truth import SineCosine, Vehicle

CHANNELS = ("latitude", "longitude", "height", "roll", "pitch", "heading")
SIZES = (64, 256, 1024, 4096, 16384)
"""Numbers of control points for which there is a model."""


@lru_cache(maxsize=len(SIZES))
def track(points: int) -> Vehicle:
    """A vehicle on a track of at most `points` control points, one of `SIZES`.

    Parameters: ``track_points`` (points, 6): control points of `CHANNELS`, rad and m, latitude, longitude and height less those
    of the origin; ``track_interval`` s between knots; ``track_latitude``, ``track_height`` of the origin; mean_roll,
    mean_pitch, start_heading are added to the angles.
    """
    channels = len(CHANNELS)
    parameters = Table((
        Row("track_points", "Control points of latitude, longitude, height (less those of the origin), roll, pitch, heading",
            "1", (points, channels)),
        Row("track_interval", "Time between knots", "s", start=1.0, lower=1e-3, upper=3600.0),
        Row("track_latitude", "Latitude of the origin", "rad", lower=-1.571, upper=1.571),
        Row("track_height", "Height of the origin above the ellipsoid", "m"),
        Row("mean_roll", "Added to the roll of the track", "rad"),
        Row("mean_pitch", "Added to the pitch of the track", "rad"),
        Row("start_heading", "Added to the heading of the track", "rad"),
    ))  # fmt: skip
    state = Table((
        Row("track_window", "Control points of the interval", "1", (POINTS, channels)),
        Row("track_next", "The control point that comes at the next knot", "1", (channels,)),
        Row("track_number", "Number of that point"),
        Row("track_time", "Time since the knot", "s"),
        Row("track_due", "Whether a knot is reached (1) or not (0)"),
    ))  # fmt: skip

    def start(p: Values) -> dict[str, Any]:
        window = p.track_points[:POINTS, :]
        return {"track_window": window, "track_next": p.track_points[POINTS, :].T, "track_number": POINTS + 0.0}

    def look_up(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {"track_next": ca.vertcat(*row_of(p.track_points, x.track_number))}

    def advance(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {
            "track_window": ca.vertcat(x.track_window[1:, :], x.track_next.T),
            "track_number": minimum(x.track_number + 1.0, points - 1.0),
            "track_time": x.track_time - p.track_interval,
            "track_due": 0.0,
        }

    def hold(p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {"track_due": x.track_time + 1.5 * p.sample_interval > p.track_interval}

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        return [{"track_time": x.track_time + place * p.sample_interval} for place in PLACES]

    def derivative(p: Values, x: Values) -> dict[str, Any]:
        return {"track_time": 1.0}

    def values(p: Values, x: Values) -> tuple[list[Any], list[Any]]:
        """The channels and their derivatives."""
        u = x.track_time / p.track_interval
        found, rates = [], []
        for channel in range(channels):
            terms = [sum(float(w) * x.track_window[j, channel] for j, w in enumerate(row) if w) for row in BASIS]
            value: Any = 0.0
            rate: Any = 0.0
            for power in reversed(range(POINTS)):
                value = value * u + terms[power]
                rate = rate * u + power * terms[power] if power else rate
            found.append(value)
            rates.append(rate / p.track_interval)
        return found, rates

    def angles(p: Values, x: Values) -> list[Any]:
        latitude, _, _, roll, pitch, heading = values(p, x)[0]
        return [p.mean_roll + roll, p.mean_pitch + pitch, p.start_heading + heading, p.track_latitude + latitude]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        sine, cosine = pairs[3]
        found, rates = values(p, x)
        R_M, R_N = radii(sine)
        height = p.track_height + found[2]
        return ca.vertcat((R_M + height) * rates[0], (R_N + height) * cosine * rates[1], -rates[2])

    return Vehicle(
        id=f"track-{points}",
        title="A vehicle on a given track",
        parameters=parameters,
        state=state,
        along=along,
        derivative=derivative,
        angles=angles,
        velocity_n=velocity_n,
        start=start,
        hold=hold,
        steps={"track_look_up": Step(look_up, when="track_due"), "track_advance": Step(advance, when="track_due")},
    )
