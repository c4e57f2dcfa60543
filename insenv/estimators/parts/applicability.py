"""Where alignment is not applicable: heading by the Earth's rotation needs gyros better than its horizontal component.

A gyro error d about east, and a tilt about north that an accelerometer error b leaves, cause a heading error of

    d / (omega_ie cos L),   (b / g) tan L

(`insenv.evaluation.limits`), whatever the method. So the data sheet of gyros and accelerometers shows in advance
whether the heading can have a meaning. Near a pole both errors grow without bound, and the direction of north changes
from place to place.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, cosh, degrees, hypot, pi, sqrt, tan
from typing import Any

import numpy as np

from insenv.base.remarks import Caveat, Doubt, Remark, declared, remark
from insenv.estimators.contract import Notes
from insenv.geodesy import MEAN_RADIUS, NOMINAL_GRAVITY, OMEGA_IE, A

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
SMOOTHED_TILT, SMOOTHED_HEADING = 25 * pi / 180, 65 * pi / 180
"""rad: what is shown of a smoother that begins again, with 64 seeds each from 7000.

Attitude errors beyond three stated sigmas from 20 and 60 deg: 1.6 % (`aircraft-inflight-alignment`) and 2.0 %
(`large-misalignment`); from 60 and 90 deg 71 % (`large-misalignment-training`).
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

# Rules, of parameters (SI, by row name) and the duration of the data (s).


def above(code: str, text: str, row: str, largest: float, kind: type[Remark] = Remark) -> Notes:
    """The remark that an angle, a parameter row, is larger than this (rad); ``{angle}`` in the text stands for it in deg."""

    @remark(code, text, kind)
    def rule(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
        angle = float(parameters[row])
        return None if angle <= largest else {"angle": degrees(angle)}

    return rule


@remark(
    "start-uncertain",
    "the start attitude is uncertain by {tilt:.2g} deg of level and {heading:.3g} deg of heading: this linearised filter "
    f"states too small sigmas from {degrees(LINEAR_TILT):.2g} deg of level or {degrees(LINEAR_HEADING):.2g} deg of heading on; "
    f"{{advice}}",
)
def linear_start(parameters: Mapping[str, Any], duration_s: float, advice: str = OTHERS) -> dict[str, Any] | None:
    """A start attitude that is too uncertain for a linearised filter; advice: what to do.

    parameters: `tilt_sigma`, `heading_sigma`.
    """
    tilt, heading = float(parameters["tilt_sigma"]), float(parameters["heading_sigma"])
    if tilt <= LINEAR_TILT and heading <= LINEAR_HEADING:
        return None
    return {"tilt": degrees(tilt), "heading": degrees(heading), "advice": advice}


@remark(
    "start-too-uncertain",
    "the start attitude is uncertain by {tilt:.2g} deg of level and {heading:.3g} deg of heading: from "
    f"{degrees(SMOOTHED_TILT):.2g} deg of level or {degrees(SMOOTHED_HEADING):.2g} deg of heading on the passes of this "
    "smoother may not lead to the truth; use fusion-smoother with the velocity of GNSS",
)
def smoothed_start(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """The same for a smoother that begins again (`insenv.runs.second_pass`)."""
    tilt, heading = float(parameters["tilt_sigma"]), float(parameters["heading_sigma"])
    if tilt <= SMOOTHED_TILT and heading <= SMOOTHED_HEADING:
        return None
    return {"tilt": degrees(tilt), "heading": degrees(heading)}


free_start = above(
    "level-uncertain",
    "none of the aids holds the horizontal velocity, and the level at the start is uncertain by {angle:.2g} deg: this "
    f"linearised filter states sigmas of position and velocity that are many times too small from {degrees(FREE_TILT):.2g} deg "
    "on; align first, or add GNSS, an odometer or a Doppler log",
    "tilt_sigma",
    1.01 * FREE_TILT,
)
"""A level that is too uncertain for a linearised filter whose velocity nothing holds."""


@remark(
    "heading-drifts",
    "a gyro bias of {bias:.3g} deg/h may turn the heading by {turn:.3g} deg in the {duration:.3g} s of the run: beyond "
    f"{degrees(LINEAR_HEADING):.2g} deg this linearised filter's sigma of the heading can be half of what it should be; an "
    "early turn about a horizontal axis makes the bias observable",
)
def drifting_heading(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """Gyros whose bias turns the heading beyond what a linearised filter takes, until a turn shows the bias.

    parameters: `gyro_bias_sigma`, `start_gyro_bias_error`.
    """
    bias = float(parameters["start_gyro_bias_error"]) or float(parameters["gyro_bias_sigma"])
    if bias * duration_s <= LINEAR_HEADING:
        return None
    return {"bias": degrees(bias) * 3600, "turn": degrees(bias * duration_s), "duration": duration_s}


@remark(
    "iron-unknown",
    "the field of the vehicle is known to {iron:.2g} uT (1 sigma), that of the Earth has {field:.3g} uT along the horizontal: "
    f"the magnetometer leaves the start heading uncertain by {{angle:.3g}} deg, and from {degrees(LINEAR_HEADING):.2g} deg on "
    "this linearised filter states too small sigmas until the vehicle has moved; calibrate the magnetometer on the vehicle, or "
    "state a heading",
    Doubt,
)
def unknown_iron(parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """A start heading that is not known, nor shown by a magnetometer with unknown hard and soft iron.

    parameters: `heading_sigma`, `magnetic_field_n` and the stated errors of a magnetometer.
    """
    field_n, heading = np.asarray(parameters["magnetic_field_n"]), float(parameters["heading_sigma"])
    total, along = float(np.linalg.norm(field_n)), float(np.linalg.norm(field_n[:2]))
    parts = (float(parameters.get(f"magnetometer_{name}_sigma", 0.0)) for name in ("soft_iron", "coupling"))
    iron = hypot(float(parameters["magnetometer_hard_iron_sigma"]), *(part * total for part in parts))
    shown = heading * iron / max(hypot(heading * along, iron), 1e-12)
    return None if shown <= LINEAR_HEADING else {"iron": 1e6 * iron, "field": 1e6 * along, "angle": degrees(shown)}


unseen_heading = above(
    "heading-unseen",
    "the start heading is known to {angle:.3g} deg only: until turns or changes of speed make it observable, its stated "
    "sigma can be half of what it should be; in the first of them that of the velocity can be a fraction of what it should be",
    "heading_sigma",
    UNSEEN_HEADING,
    Caveat,
)
"""A heading that only manoeuvres show, for a filter that converges from any heading."""
far_heading = above(
    "heading-far",
    "the start heading is known to {angle:.3g} deg only: with an error above 90 deg the heading loop converges slowly, at "
    "180 deg not at all, so that its stated sigma can be too small; use q-method",
    "start_heading_sigma",
    FAR_HEADING,
    Caveat,
)
"""A heading loop that starts from a heading that may be more than a right angle off."""


@remark(
    "motion-errors-as-noise",
    "scale factors and misalignments of the gyros ({error:.2g} mrad) are counted as noise, not estimated: in and after turns "
    "the attitude can be wrong by more than three stated sigmas",
    Caveat,
)
def unmodelled_motion(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """Scale factors and misalignments that a filter counts as noise and does not estimate.

    They matter where half a turn costs more than the accelerometers' bias does at rest.

    parameters: `rotation_error`, `accel_bias_sigma`.
    """
    error = float(parameters["rotation_error"])
    return None if pi * error <= float(parameters["accel_bias_sigma"]) / NOMINAL_GRAVITY else {"error": 1000 * error}


@remark(
    "unit-without-noise",
    "the inertial unit is stated to have no white noise: no stated sigma covers what the linearised filter neglects of the "
    "start attitude, about {omitted:.2g} deg",
    Caveat,
)
def noiseless(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """A unit without white noise: a linearised filter trusts its linearisation.

    parameters: `angle_random_walk`, `velocity_random_walk`, `tilt_sigma`, `heading_sigma`.
    """
    if float(parameters["angle_random_walk"]) > NOISELESS[0] or float(parameters["velocity_random_walk"]) > NOISELESS[1]:
        return None
    return {"omitted": degrees(float(parameters["tilt_sigma"]) * float(parameters["heading_sigma"]))}


_PRINTED = declared("printed-form", "the paper's filter as printed, for comparison with it: {fault}; use {instead}")


def printed(fault: str, instead: str) -> Notes:
    """What the printed form of a paper's filter is for: its fault, and the estimators to use instead."""
    said = _PRINTED.filled(fault=fault, instead=instead)
    return lambda parameters, duration_s: (said,)


TURNED = declared(
    "turntable",
    "the vehicle is a turntable: the stated sigmas do not include the effect of rotation on the errors of the unit, and can be "
    "several times too small once it turns; use fusion",
    Caveat,
)
"""Roll and pitch of `ecef-kf` at the end of `turntable-indexing` (24 seeds from 7000): 0.005 deg rms, 0.0006 stated; heading of
`gyrocompass` 0.55 and 0.07, of `inertial-fir` 0.22 and 0.06.  Heading of the q-method at 540 s, four minutes after the first
half turn (64 seeds from 7000): 0.73 and 0.24, of `qakf` at 630 s 0.36 and 0.17, of `qakf-improved` at 1830 s 0.17 and 0.08."""


def together(*rules: Notes) -> Notes:
    """The sentences of several rules, one after another."""
    return lambda parameters, duration_s: tuple(note for rule in rules for note in rule(parameters, duration_s))


# The heading of an alignment by the Earth's rotation, after `duration_s` of data.
#
# parameters: `latitude`, `gyro_bias_sigma`, `accel_bias_sigma`, `angle_random_walk`, and `moving` if there is one (1: the
# vehicle moves and has GNSS velocity, so there is no sentence).


@remark(
    "near-pole",
    "{angle:.2g} deg ({distance:.3g} km) from a pole: the direction of north changes from place to place, so heading has "
    "little meaning; use a navigating estimator (wander azimuth) there",
)
def near_pole(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """A place at which the direction of north has little meaning."""
    to_pole = pi / 2 - abs(float(parameters["latitude"]))
    if _moves(parameters) or to_pole >= NEAR_POLE:
        return None
    return {"angle": degrees(to_pole), "distance": A * to_pole / 1000}


@remark("heading-not-applicable", "not applicable for heading: {why}")
def no_heading(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """Instruments that give no heading at all."""
    error, why = _heading_error(parameters, duration_s)
    return None if _moves(parameters) or error < HOPELESS else {"why": why}


@remark("heading-poor", "heading is good to {error:.2g} deg only: {why}")
def poor_heading(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """Instruments that give a poor heading."""
    error, why = _heading_error(parameters, duration_s)
    return None if _moves(parameters) or not DOUBTFUL < error < HOPELESS else {"error": degrees(error), "why": why}


notes = together(near_pole, no_heading, poor_heading)


def _moves(parameters: Mapping[str, Any]) -> bool:
    return float(parameters.get("moving", 0.0)) != 0.0


def _heading_error(parameters: Mapping[str, Any], duration_s: float) -> tuple[float, str]:
    """The error of the heading (rad) by gyros and accelerometers, and which of them makes the larger part."""
    latitude, hourly = float(parameters["latitude"]), degrees(1) * 3600
    bias, walk = float(parameters["gyro_bias_sigma"]), float(parameters["angle_random_walk"])
    horizontal = OMEGA_IE * max(cos(latitude), 1e-9)
    rate = hypot(bias, walk / sqrt(max(duration_s, 1.0)))
    by_gyro, by_tilt = rate / horizontal, float(parameters["accel_bias_sigma"]) / NOMINAL_GRAVITY * abs(tan(latitude))
    if by_gyro >= by_tilt:
        why = (
            f"a gyro error of {rate * hourly:.3g} deg/h is {by_gyro:.2g} times the horizontal Earth rate of "
            f"{horizontal * hourly:.3g} deg/h at {degrees(latitude):.4g} deg of latitude"
        )
    else:
        level = degrees(by_tilt / abs(tan(latitude)))
        why = f"the accelerometers level to {level:.2g} deg, at {degrees(latitude):.4g} deg of latitude"
    return hypot(by_gyro, by_tilt), why


# Why free-inertial height diverges: an error of height changes gravity, and gravity the height.
#
# Of an error dh of the height, gravity computed at h + dh lacks 2 g / R dh, so dh'' = 2 g / R dh: a solution grows as
# exp(t / T) with T = sqrt(R / 2 g), and an error at the start by the factor cosh(t / T). Britting (1971), chapter 6.

HEIGHT_TIME = sqrt(MEAN_RADIUS / (2.0 * NOMINAL_GRAVITY))
"""T: s, 570."""
NOTED_GROWTH = 2.0
"""Growth from which there is a note: after 750 s."""
NOTED_HEIGHT_ERROR = 5.0
"""m: a smaller error of the height is not noted."""


@remark(
    "height-drifts",
    "none of the aids holds the height of a vehicle that moves: an accelerometer bias of accel_bias_sigma makes an error of "
    "{error:.2g} m in {duration:g} s. Add a barometer, GNSS, a Doppler log or, for wheels, non_holonomic",
)
def drifting_height(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """The height of a filter whose aids do not hold it, where its error has begun to count.

    parameters: ``accel_bias_sigma`` (m/s^2) and ``position_sigma`` (3, m) by name.  A bias b makes the error
    b T^2 (cosh(t / T) - 1).
    """
    growth = cosh(min(duration_s / HEIGHT_TIME, 700.0)) - 1.0
    error = float(parameters["accel_bias_sigma"]) * HEIGHT_TIME**2 * growth
    if error < max(NOTED_HEIGHT_ERROR, float(parameters["position_sigma"][2])):
        return None
    return {"error": error, "duration": duration_s}


@remark(
    "height-unaided",
    f"nothing aids the height: its errors grow by a factor e every {HEIGHT_TIME:.0f} s, sqrt(R / 2 g), those of the start by "
    "{growth:.2g} in {duration:g} s; use an estimator with GNSS where the height matters",
)
def unaided_height(parameters: Mapping[str, Any], duration_s: float) -> dict[str, Any] | None:
    """The height of an estimator without aiding, after `duration_s`, where it has begun to count."""
    growth = cosh(min(duration_s / HEIGHT_TIME, 700.0))
    return None if growth < NOTED_GROWTH else {"growth": growth, "duration": duration_s}
