"""Where alignment is not applicable: heading by the Earth's rotation needs gyros better than its horizontal component.

A gyro error d about east, and a tilt about north that an accelerometer error b leaves, cause a heading error of

    d / (omega_ie cos L),   (b / g) tan L

(`insenv.evaluation.limits`), whatever the method. So the data sheet of gyros and accelerometers shows in advance
whether the heading can have a meaning. Near a pole both errors grow without bound, and the direction of north changes
from place to place.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, degrees, hypot, pi, sqrt, tan
from typing import Any

from insenv.geodesy import NOMINAL_GRAVITY, OMEGA_IE, A

DOUBTFUL = 0.1
"""rad: a larger heading error gives a note; as a ratio, gyro error over horizontal Earth rate."""
HOPELESS = 1.0
"""rad: with a heading error of this size or more there is no heading."""
NEAR_POLE = 0.5 * pi / 180
"""rad of latitude, 56 km."""


LINEAR_TILT, LINEAR_HEADING = 6 * pi / 180, 20 * pi / 180
"""rad: with larger start errors the covariance of a linearised filter becomes too small while it converges."""


def linear_start(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about a start attitude that is too uncertain for a linearised filter.

    parameters: SI, by row name: `tilt_sigma`, `heading_sigma`. duration_s: of the data, s.
    """
    tilt, heading = float(parameters["tilt_sigma"]), float(parameters["heading_sigma"])
    if tilt <= LINEAR_TILT and heading <= LINEAR_HEADING:
        return ()
    return (
        f"the start attitude is uncertain by {degrees(tilt):.2g} deg of level and {degrees(heading):.3g} deg of heading: this "
        f"linearised filter states too small sigmas from {degrees(LINEAR_TILT):.2g} deg of level or "
        f"{degrees(LINEAR_HEADING):.2g} deg of heading on; use aqe-sukf",
    )


def notes(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """Sentences about the heading of an alignment by the Earth's rotation, after `duration_s` of data.

    parameters: SI, by row name: `latitude`, `gyro_bias_sigma`, `accel_bias_sigma`, `angle_random_walk`, and `moving` if
    there is one (1: the vehicle moves and has GNSS velocity, so there is no sentence).
    """
    if float(parameters.get("moving", 0.0)) != 0.0:
        return ()
    latitude = float(parameters["latitude"])
    bias, walk = float(parameters["gyro_bias_sigma"]), float(parameters["angle_random_walk"])
    found = []
    to_pole = pi / 2 - abs(latitude)
    if to_pole < NEAR_POLE:
        found.append(
            f"{degrees(to_pole):.2g} deg ({A * to_pole / 1000:.3g} km) from a pole: the direction of north changes from "
            "place to place, so heading has little meaning; use a navigating estimator (wander azimuth) there"
        )
    horizontal = OMEGA_IE * max(cos(latitude), 1e-9)
    rate = hypot(bias, walk / sqrt(max(duration_s, 1.0)))
    by_gyro, by_tilt = rate / horizontal, float(parameters["accel_bias_sigma"]) / NOMINAL_GRAVITY * abs(tan(latitude))
    if hypot(by_gyro, by_tilt) > DOUBTFUL:
        found.append(_doubt(by_gyro, by_tilt, rate, horizontal, latitude))
    return tuple(found)


def _doubt(by_gyro: float, by_tilt: float, rate: float, horizontal: float, latitude: float) -> str:
    hourly = degrees(1) * 3600
    if by_gyro >= by_tilt:
        why = (
            f"a gyro error of {rate * hourly:.3g} deg/h is {by_gyro:.2g} times the horizontal Earth rate of "
            f"{horizontal * hourly:.3g} deg/h at {degrees(latitude):.4g} deg of latitude"
        )
    else:
        level = degrees(by_tilt / abs(tan(latitude)))
        why = f"the accelerometers level to {level:.2g} deg, at {degrees(latitude):.4g} deg of latitude"
    size = hypot(by_gyro, by_tilt)
    if size >= HOPELESS:
        return f"not applicable for heading: {why}"
    return f"heading is good to {degrees(size):.2g} deg only: {why}"
