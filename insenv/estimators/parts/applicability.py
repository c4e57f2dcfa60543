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

from insenv.estimators.contract import Notes
from insenv.geodesy import NOMINAL_GRAVITY, OMEGA_IE, A

DOUBTFUL = 0.1
"""rad: a larger heading error gives a note; as a ratio, gyro error over horizontal Earth rate."""
HOPELESS = 1.0
"""rad: with a heading error of this size or more there is no heading."""
NEAR_POLE = 0.5 * pi / 180
"""rad of latitude, 56 km."""
LINEAR_TILT, LINEAR_HEADING = 6 * pi / 180, 10 * pi / 180
"""rad: with larger start errors the covariance of a linearised filter becomes too small while it converges.

Attitude errors of `loosely-coupled` beyond three stated sigmas, 128 seeds from 64000, from a start heading known to 10, 15, 20,
30 and 40 deg: 0.8, 1.9, 4.5, 14 and 23 % in `aircraft-inflight-alignment`, 0.8, 0.8, 1.1, 3.8 and 7.8 % in `car-city-drive`.
"""
FREE_TILT = 0.1 * pi / 180
"""rad: the same for a filter of which no aid holds the horizontal velocity, and a barometer the height.

The Coriolis acceleration then tells the velocity, and g tilt^2 / 2 is as large. A ship with a navigation-grade unit, 32 seeds
from 90, 30 min: north is 1.3, 6.5 and 44 stated sigmas off (rms) from a level known to 0.1, 0.2 and 0.5 deg.
"""
UNSEEN_HEADING = 20 * pi / 180
"""rad: with a larger one, the sigma of a filter for large errors falls too far before a manoeuvre shows the heading."""
FAR_HEADING = 31 * pi / 180
"""rad: with a larger standard deviation a start heading is off by more than 90 deg in more than 0.3 % of the cases."""
NOISELESS = 1e-8, 1e-6
"""White noise of gyros (rad/s^0.5) and accelerometers (m/s^1.5), a fiftieth of that of the best units: up to it, none."""


OTHERS = "use fusion with the velocity of GNSS, or aqe-sukf"


def linear_start(parameters: Mapping[str, Any], duration_s: float, advice: str = OTHERS) -> tuple[str, ...]:
    """A sentence about a start attitude that is too uncertain for a linearised filter.

    parameters: SI, by row name: `tilt_sigma`, `heading_sigma`. duration_s: of the data, s. advice: what to do.
    """
    tilt, heading = float(parameters["tilt_sigma"]), float(parameters["heading_sigma"])
    if tilt <= LINEAR_TILT and heading <= LINEAR_HEADING:
        return ()
    return (
        f"the start attitude is uncertain by {degrees(tilt):.2g} deg of level and {degrees(heading):.3g} deg of heading: this "
        f"linearised filter states too small sigmas from {degrees(LINEAR_TILT):.2g} deg of level or "
        f"{degrees(LINEAR_HEADING):.2g} deg of heading on; {advice}",
    )


def free_start(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about a level that is too uncertain for a linearised filter whose velocity nothing holds.

    Arguments as for `linear_start`.
    """
    tilt = float(parameters["tilt_sigma"])
    if tilt <= 1.01 * FREE_TILT:
        return ()
    return (
        f"none of the aids holds the horizontal velocity, and the level at the start is uncertain by {degrees(tilt):.2g} deg: "
        f"this linearised filter states sigmas of position and velocity that are many times too small from "
        f"{degrees(FREE_TILT):.2g} deg on; align first, or add GNSS, an odometer or a Doppler log",
    )


def drifting_heading(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about gyros whose bias turns the heading beyond what a linearised filter takes, until a turn shows the bias.

    parameters: SI, by row name: `gyro_bias_sigma`, `start_gyro_bias_error`. duration_s: of the data, s.
    """
    bias = float(parameters["start_gyro_bias_error"]) or float(parameters["gyro_bias_sigma"])
    if bias * duration_s <= LINEAR_HEADING:
        return ()
    return (
        f"a gyro bias of {degrees(bias) * 3600:.3g} deg/h may turn the heading by {degrees(bias * duration_s):.3g} deg in the "
        f"{duration_s:.3g} s of the run: beyond {degrees(LINEAR_HEADING):.2g} deg this linearised filter's sigma of the "
        "heading can be half of what it should be; an early turn about a level axis shows the bias",
    )


def unseen_heading(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about a heading that only manoeuvres show, for a filter that converges from any heading."""
    heading = float(parameters["heading_sigma"])
    if heading <= UNSEEN_HEADING:
        return ()
    return (
        f"the start heading is known to {degrees(heading):.3g} deg only: until turns or changes of speed have shown it, its "
        "stated sigma can be half of what it should be, and in the first of them that of the velocity a fraction",
    )


def unmodelled_motion(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about scale factors and misalignments that a filter counts as noise and does not estimate.

    They matter where half a turn costs more than the accelerometers' bias does at rest.

    parameters: SI, by row name: `rotation_error`, `accel_bias_sigma`.
    """
    error = float(parameters["rotation_error"])
    if pi * error <= float(parameters["accel_bias_sigma"]) / NOMINAL_GRAVITY:
        return ()
    return (
        f"scale factors and misalignments of the gyros ({1000 * error:.2g} mrad) are counted as noise, not estimated: in and "
        "after turns the attitude can be wrong by more than three stated sigmas",
    )


def noiseless(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about a linearised filter that is told of a unit without white noise: it trusts its linearisation.

    parameters: SI, by row name: `angle_random_walk`, `velocity_random_walk`, `tilt_sigma`, `heading_sigma`.
    """
    if float(parameters["angle_random_walk"]) > NOISELESS[0] or float(parameters["velocity_random_walk"]) > NOISELESS[1]:
        return ()
    omitted = degrees(float(parameters["tilt_sigma"]) * float(parameters["heading_sigma"]))
    return (
        f"the inertial unit is told to have no white noise: no stated sigma covers what the linearised filter omits of the "
        f"start attitude, about {omitted:.2g} deg",
    )


def far_heading(parameters: Mapping[str, Any], duration_s: float) -> tuple[str, ...]:
    """A sentence about a heading loop that starts from a heading that may be more than a right angle off.

    parameters: SI, by row name: `start_heading_sigma`.
    """
    heading = float(parameters["start_heading_sigma"])
    if heading <= FAR_HEADING:
        return ()
    return (
        f"the start heading is known to {degrees(heading):.3g} deg only: from more than 90 deg off the heading loop turns "
        "slowly, and from 180 deg not at all, so that its stated sigma can be too small; use q-method",
    )


TURNED = (
    "the vehicle is a turntable: the stated sigmas leave out what turns of the unit do with its errors, and can be several "
    "times too small once it turns; use fusion"
)
"""Roll and pitch of `ecef-kf` at the end of `turntable-indexing` (24 seeds from 7000): 0.005 deg rms, 0.0006 stated; heading of
`gyrocompass` 0.55 and 0.07, of `inertial-fir` 0.22 and 0.06.  Heading of the q-method at 540 s, four minutes after the first
half turn (64 seeds from 7000): 0.73 and 0.24, of `qakf` at 630 s 0.36 and 0.17, of `qakf-improved` at 1830 s 0.17 and 0.08."""


def together(*kinds: Notes) -> Notes:
    """The sentences of several kinds, one after another."""
    return lambda parameters, duration_s: tuple(note for kind in kinds for note in kind(parameters, duration_s))


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
