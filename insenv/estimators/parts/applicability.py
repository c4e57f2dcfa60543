"""Where alignment is not applicable: heading by the Earth's rotation needs gyros better than its horizontal part.

A gyro error d about east, and a tilt about north that accelerometers good to b leave, look like a heading error of

    d / (omega_ie cos L),   (b / g) tan L

(`insenv.evaluation.limits`), whatever the method. What an alignment is told of its gyros and accelerometers thus says
before it starts whether its heading can mean anything; near a pole both grow without bound, and north itself turns from
place to place.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, hypot, pi, sqrt, tan
from typing import Any

from insenv.geodesy import OMEGA_IE, A

DOUBTFUL = 0.1
"""rad: from such a heading error on a note is made; as a fraction, that of gyro error over horizontal Earth rate."""
HOPELESS = 1.0
"""rad: from here on the linear formula says that there is no heading at all."""
NEAR_POLE = 0.5 * pi / 180
"""rad of latitude, 56 km."""
GRAVITY = 9.8


def notes(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """Sentences about the heading of an alignment by the Earth's rotation, after `duration_s` of data.

    parameters: SI, by row name: `latitude`, `gyro_bias_sigma`, `accel_bias_sigma`, `angle_random_walk`, and `moving` where
    there is one (the vehicle has GNSS velocity and moves: no sentence).
    """
    if float(parameters.get("moving", 0.0)) != 0.0:
        return ()
    latitude = float(parameters["latitude"])
    bias, walk = float(parameters["gyro_bias_sigma"]), float(parameters["angle_random_walk"])
    found = []
    to_pole = pi / 2 - abs(latitude)
    if to_pole < NEAR_POLE:
        found.append(
            f"{degrees(to_pole):.2g} deg ({A * to_pole / 1000:.3g} km) from a pole: north turns from place to place, and "
            "heading means little; a navigating estimator works there, in wander azimuth"
        )
    horizontal = OMEGA_IE * max(cos(latitude), 1e-9)
    rate = hypot(bias, walk / sqrt(max(duration_s, 1.0)))
    by_gyro, by_tilt = rate / horizontal, float(parameters["accel_bias_sigma"]) / GRAVITY * abs(tan(latitude))
    if hypot(by_gyro, by_tilt) > DOUBTFUL:
        found.append(_doubt(by_gyro, by_tilt, rate, horizontal, latitude))
    return tuple(found)


def _doubt(by_gyro: float, by_tilt: float, rate: float, horizontal: float, latitude: float) -> str:
    hourly = degrees(1) * 3600
    if by_gyro >= by_tilt:
        why = (
            f"gyros told to be good to {rate * hourly:.3g} deg/h are {by_gyro:.2g} of the horizontal Earth rate, "
            f"{horizontal * hourly:.3g} deg/h at {degrees(latitude):.4g} deg"
        )
    else:
        why = f"accelerometers that level to {degrees(by_tilt / abs(tan(latitude))):.2g} deg, at {degrees(latitude):.4g} deg"
    size = hypot(by_gyro, by_tilt)
    if size >= HOPELESS:
        return f"not applicable for heading: {why}"
    return f"heading is good to {degrees(size):.2g} deg only: {why}"
