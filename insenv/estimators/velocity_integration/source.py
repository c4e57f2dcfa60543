"""The instruments that measure velocity: GNSS (`FIXES`), and a Doppler log that tracks the ground (`LOG`).

A `Source` has the rows and errors of one, a measurement as the sums of `insenv.estimators.velocity_integration.wahba` take it,
and what is said about it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core.elementary import maximum, select, sin_cos
from insenv.core.tables import Row, Table
from insenv.estimators.parts import frozen_frame, lever_arm, rows
from insenv.estimators.parts.error_model import bias_sigma
from insenv.sensors.dvl import DVL
from insenv.sensors.gnss import ARM, GNSS_STATED

DRIFT, ALPHA, MEAN, SUM, ANSWER, GYRO, ACCEL, OF_VECTOR = (slice(i, i + 3) for i in range(0, 24, 3))
OF_SCALAR, N = 24, 25
"""Errors: drift of C_b^i (rad), of alpha and of its mean (m/s), y, phi of the current answer (rad), biases (rad/s, m/s^2), and
a vector and a scalar of constant errors of the instrument."""
LARGEST_LINEAR = 0.35  # rad: a larger standard deviation is that of no linear problem
EARTH_AXIS = (0.0, 0.0, 1.0)  # in e


@dataclass(frozen=True)
class Measurement:
    """One measurement.

    alpha (3, m/s, i): without what the module's docstring leaves to beta; error (3xN): its derivative by the errors.
    velocity (3, m/s, i0): the velocity in beta; pull_rate (3, m/s^2, i0): the rate of beta's integral.
    variance: of each component of the noise, m^2/s^2.  place: rows of the place, `velocity_n`, and those of `Source.state`.
    """

    alpha: Any
    error: Any
    velocity: Any
    pull_rate: Any
    variance: Any
    place: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Source:
    """An instrument that measures velocity.

    sensor: its id.  title: how the alignment uses it.  means: by what it finds the heading.  needs: what must be measured.
    shows_heading: ``parameters by row name -> sentence`` about what shows the heading.
    arrives: the input row that is 1 with a measurement; age: that of its age (s).  inputs, parameters, state: its rows.
    sigma: ``p -> (4)``, standard deviations of its constant errors, vector and scalar.  start: ``p -> state rows``.
    measurement: ``(p, x, u, q_ni) -> Measurement``; q_ni: ``(p, x) -> (4), 1 or 0``, takes i components to n components by the
        current answer, and whether its heading is known.
    largest_heading: ``p -> rad``; a larger standard deviation of the heading is stated as unknown.
    longest_gap: longest time (s) between two measurements that the integral of beta, a trapezoid, spans; None: any.
    exact: ``(p, that of alpha and i, that of beta and i0) -> the one that has no noise of measurements``.
    by_earth_rate: ``(gyro bias, rad/s; latitude, rad) -> whether the Earth's rotation alone shows the heading``: a drift of
        the gyros then turns the heading by the same angle after any time, and noise by less after a longer one.
    """

    sensor: str
    title: str
    means: str
    needs: str
    shows_heading: Callable[[Mapping[str, Any]], str]
    arrives: str
    age: str
    inputs: Table
    parameters: Table
    sigma: Callable[[Any], Any]
    measurement: Callable[[Any, Any, Any, Callable[[Any, Any], tuple[Any, Any]]], Measurement]
    exact: Callable[[Any, Any, Any], Any]
    largest_heading: Callable[[Any], Any] = field(default=lambda p: LARGEST_LINEAR)
    state: Table = field(default_factory=Table)
    longest_gap: float | None = None
    start: Callable[[Any], dict[str, Any]] = field(default=lambda p: {})
    by_earth_rate: Callable[[float, float], bool] = field(default=lambda gyro_bias, latitude: False)


def at_point(x: Any, arm: Any, age: Any) -> tuple[Any, Any, Any, Any]:
    """alpha (3, m/s, i) of the point at `arm` (3, m, b) `age` seconds ago, its rate (3, m/s^2), and what else is of that time.

    That is its derivative by the lever arm (3x3, 1/s), and C_b^i (3x3).
    """
    rate = x.previous_delta_angle / x.dt  # that of the middle of the sample
    change = lever_arm.angular_acceleration(x, rate, x.dt)
    now = rate + change * (x.dt / 2)
    bend = skew(change) + skew(now) @ skew(now)
    C_ib = attitude.to_dcm(x.q_ib)
    by_arm = C_ib @ (skew(now) - age * bend)  # as `lever_arm.then`
    back = attitude.to_dcm(attitude.from_small_rotation_vector((change * (age / 2) - now) * age))
    return x.alpha - x.force * age + by_arm @ arm, x.force + C_ib @ bend @ arm, by_arm, C_ib @ back


def pull_rate(velocity_n: Any, latitude: Any, longitude: Any, height: Any, q_i0e: Any) -> Any:
    """Rate of beta's integral (3, m/s^2, i0), omega_ie x v - g, at a velocity over the Earth and a place."""
    C_en = geodesy.C_en(latitude, longitude)
    coriolis = ca.cross(geodesy.OMEGA_IE * ca.SX(EARTH_AXIS), C_en @ velocity_n)
    return attitude.rotate(q_i0e, coriolis - geodesy.normal_gravity_e(C_en, height))


def earth_turn(x: Any, age: Any) -> Any:
    """Takes e components `age` seconds ago to i0 components (4)."""
    return frozen_frame.q_n0n(frozen_frame.turned(x.half_turn, -age), ca.SX(EARTH_AXIS))


def _bias(parameters: Mapping[str, Any]) -> tuple[str, float]:
    """Name and value (rad/s) of the row with the standard deviation of the gyro bias."""
    row = "start_gyro_bias_error" if parameters["start_gyro_bias_error"] > 0 else "gyro_bias_sigma"
    return row, float(parameters[row])


# GNSS: the velocity of the antenna over the Earth; lever arm and delay of the fixes are its constant errors.

LONGEST_GAP = 20.0
"""s: beta is then wrong by g a T^3 / (12 R) and by the Coriolis term of what a turn adds: for an aircraft by 0.05 m/s."""
SHORT = 300.0  # s: gyros that lose a heading in less need turns all the time


def kept_for(gyro_bias: float) -> float:
    """Time (s) after which gyros with a bias (rad/s, 1 sigma) have lost a heading."""
    return LARGEST_LINEAR / max(gyro_bias, 1e-30)


_OF_FIXES = ("antenna_lever_arm_sigma", "gnss_delay_sigma")


def _of_fix(p: Any, x: Any, u: Any, q_ni: Any) -> Measurement:
    q_i0e = earth_turn(x, u.gnss_age)
    place = {"latitude": u.gnss_latitude, "longitude": u.gnss_longitude, "height": u.gnss_height}
    C_en = geodesy.C_en(u.gnss_latitude, u.gnss_longitude)
    alpha, alpha_rate, by_arm, _ = at_point(x, p.antenna_lever_arm, u.gnss_age)
    error = ca.SX(3, N)
    # of the velocity that a delay misses, gravity's part is a constant and counts as little as that of alpha and beta
    error[:, ALPHA], error[:, OF_VECTOR], error[:, OF_SCALAR] = ca.SX.eye(3), by_arm, alpha_rate
    return Measurement(
        alpha=alpha,
        error=error,
        velocity=attitude.rotate(q_i0e, C_en @ u.gnss_velocity_n),
        pull_rate=pull_rate(u.gnss_velocity_n, u.gnss_latitude, u.gnss_longitude, u.gnss_height, q_i0e),
        variance=(u.gnss_velocity_sigma[0] ** 2 + u.gnss_velocity_sigma[1] ** 2) / 2,
        place={**place, "velocity_n": u.gnss_velocity_n},
    )


def _by_motion(parameters: Mapping[str, Any]) -> str:
    row, bias = _bias(parameters)
    sentence = "turns or changes of speed show it, a straight line at constant speed does not"
    lost_after = kept_for(bias)
    if lost_after >= SHORT:
        return sentence
    return (
        f"{sentence}. Gyros with a bias of {math.degrees(bias) * 3600:.0f} deg/h ({row}) lose it again in {lost_after:.2g} s: "
        "if the unit is better, state its grade"
    )


FIXES = Source(
    sensor="gnss",
    title="by the velocity of GNSS",
    means="by the velocity of GNSS",
    needs="fixes with a velocity",
    shows_heading=_by_motion,
    arrives="gnss_velocity_valid",
    age="gnss_age",
    inputs=rows.FIX_INPUTS,
    parameters=rows.chosen(GNSS_STATED, ARM.name, *_OF_FIXES),
    sigma=lambda p: ca.vertcat(*(getattr(p, name) for name in _OF_FIXES)),
    measurement=_of_fix,
    exact=lambda p, of_alpha, of_beta: of_alpha,
    longest_gap=LONGEST_GAP,
)


# Doppler velocity log that tracks the ground: velocity in body axes; misalignment and scale factor are its constant errors.
#
# Beta is then the integral of gravity alone, which the rotation of the Earth turns: that shows the heading, to gyros that are
# good enough for it.  So does the way over the ground, 2 % as fast at 6 m/s.  It counts in the place as soon as the heading
# is known; that neither it nor the Coriolis term counts in gravity before is a small share of an angle that is not known
# well then.

LARGEST_HEADING = 0.12
"""rad: standard deviation of a heading that may be wrong by atan(b_east / (Omega cos L + b_north)), which a bias b of the gyros
enters linearly only where it is small.
"""
LEAST_NOISE = 1e-3
"""m/s: standard deviation of a log without stated noise."""


def _of_log(p: Any, x: Any, u: Any, q_ni: Any) -> Measurement:
    since = x.time - u.dvl_age - x.epoch
    alpha, _, _, C_ib = at_point(x, p.dvl_lever_arm_b, u.dvl_age)
    velocity_i = C_ib @ u.dvl_velocity_b
    into_n, known = q_ni(p, x)
    velocity_n, gone_n = (known * attitude.rotate(into_n, vector) for vector in (velocity_i, x.way))
    place = geodesy.geodetic_from_ned_offset(x.velocity_n * since + gone_n, x.latitude, x.longitude, x.height)
    error = ca.SX(3, N)
    error[:, ALPHA], error[:, DRIFT] = ca.SX.eye(3), skew(velocity_i)
    error[:, OF_VECTOR], error[:, OF_SCALAR] = -C_ib @ skew(u.dvl_velocity_b), -velocity_i
    return Measurement(
        alpha=alpha - velocity_i,
        error=error,
        velocity=ca.SX.zeros(3),
        pull_rate=pull_rate(velocity_n, *place, earth_turn(x, u.dvl_age)),
        variance=maximum(p.dvl_noise, LEAST_NOISE) ** 2,
        place={
            **dict(zip(("latitude", "longitude", "height"), place, strict=True)),
            "velocity_n": velocity_n,
            "way": (1 - known) * (x.way + velocity_i * since),
        },
    )


def finds_north(gyro_bias: Any, latitude: Any) -> Any:
    """Whether gyros with a bias (rad/s, 1 sigma) show the heading at a latitude (rad), numbers or symbols."""
    return gyro_bias < LARGEST_HEADING * geodesy.OMEGA_IE * sin_cos(latitude)[1]


def _finds_north(p: Any) -> Any:
    return finds_north(bias_sigma(p), p.start_latitude)


def _exact(p: Any, of_alpha: Any, of_beta: Any) -> Any:
    """That of beta; for gyros that turn alpha more than the Earth does that of alpha, which shows the level alone then."""
    return select(_finds_north(p), of_beta, of_alpha)


def _by_rotation(parameters: Mapping[str, Any]) -> str:
    row, bias = _bias(parameters)
    earth = math.degrees(geodesy.OMEGA_IE * math.cos(parameters["start_latitude"])) * 3600
    return (
        f"by a Doppler log the rotation of the Earth alone shows it, {earth:.2g} deg/h about north, in some minutes and to "
        f"gyros with a bias far below that; here {row} is {math.degrees(bias) * 3600:.2g} deg/h"
    )


_STATED = ("dvl_lever_arm_b", "dvl_noise", "dvl_scale_factor_sigma", "dvl_misalignment_sigma")
LOG = Source(
    sensor="dvl",
    title="by a Doppler log",
    means="by the Doppler log and the rotation of the Earth",
    needs="velocities of a Doppler log",
    shows_heading=_by_rotation,
    by_earth_rate=finds_north,
    arrives="dvl_new",
    age="dvl_age",
    inputs=DVL.measurement,
    parameters=rows.chosen(DVL.stated_errors, *_STATED)
    + rows.chosen(rows.START, "start_latitude", "start_longitude", "start_height"),
    sigma=lambda p: ca.vertcat(ca.repmat(p.dvl_misalignment_sigma, 3, 1), p.dvl_scale_factor_sigma),
    measurement=_of_log,
    state=Table((Row("way", "Way over the ground before the heading was known", "m", (3,), "i"),)),
    exact=_exact,
    largest_heading=lambda p: select(_finds_north(p), LARGEST_HEADING, 0.0),
    start=lambda p: {"latitude": p.start_latitude, "longitude": p.start_longitude, "height": p.start_height},
)
