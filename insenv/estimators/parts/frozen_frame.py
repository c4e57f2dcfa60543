"""The frozen inertial frame that `inertial-fir` and `gyrocompass` work in: every inertial sample, the Earth's turn.

Frame i is b at the start, frozen; n0 is n at the start.  Gyros carry q_ib, the Earth's known rate carries q_n0n, and between
them stands the quaternion q_n0i, constant but for what alignment corrects in it:

    q_nb = conj(q_n0n) q_n0i q_ib

Per sample only q_ib moves, and specific force is summed in i; all else is done once a block of samples (some 0.1 s), whose mean
specific force belongs exactly to the block's middle.  Source: the swaying-base paper, (1), (2) and (7), in NED and FRD axes.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import atan2, sin_cos
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Knowledge
from insenv.estimators.parts.fir import BLOCK_S
from insenv.estimators.parts.increments import MEMORY, compensated, remembered

PARAMETERS = Table((
    Row("latitude", "Geodetic latitude", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("height", "Height over the ellipsoid", "m", lower=-12e3, upper=1e5),
    Row("block_samples", "Inertial samples in a block", "1", start=20.0, lower=1.0, upper=1e6),
    Row("gyro_bias_sigma", "Gyro bias that the stated accuracy counts with", "rad/s", lower=0.0, upper=1.0),
    Row("accel_bias_sigma", "Accelerometer bias that the stated accuracy counts with", "m/s^2", lower=0.0, upper=100.0),
    Row("angle_random_walk", "White noise of the gyros", "rad/s^0.5", start=1e-6, lower=0.0, upper=1.0),
    Row("velocity_random_walk", "White noise of the accelerometers", "m/s^1.5", start=1e-4, lower=0.0, upper=100.0),
))  # fmt: skip

STATE = Table((
    Row("q_ib", "Attitude since the start: takes b components to components in b at the start", "1", (4,), "i", (1, 0, 0, 0)),
    Row("q_n0i", "Attitude at the start: takes i components to components in n at the start", "1", (4,), "n0", (1, 0, 0, 0)),
    Row("axis_n", "The Earth's axis", "1", (3,), "n"),
    Row("gravity", "Normal gravity", "m/s^2"),
    Row("half_turn", "Cosine and sine of half the angle that the Earth has turned since the start", "1", (2,), start=(1, 0)),
    Row("force_sum", "Integral of specific force since the block's begin", "m/s", (3,), "i"),
    Row("block_time", "Time since the block's begin", "s"),
    Row("block_count", "Samples since the block's begin", "1"),
    Row("block_due", "Whether the block is complete", "1"),
    Row("begin", "Whether no sample has been taken yet", "1", start=1.0),
    Row("time", "Time since the start", "s"),
)) + MEMORY  # fmt: skip

OUTPUTS = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Stated accuracy about north, east, down", "rad", (3,), "n"),
))  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """What the place determines."""
    sin_latitude, cos_latitude = sin_cos(p.latitude)
    return {
        "axis_n": ca.vertcat(cos_latitude, 0, -sin_latitude),
        "gravity": geodesy.normal_gravity(sin_latitude, p.height),
    }


def levelled(u: Any, heading: Any) -> dict[str, Any]:
    """At the first sample: q_n0i such that its specific force points up, at a heading (rad)."""
    x, y, z = ca.vertsplit(u.delta_velocity)
    roll, pitch = atan2(-y, -z), atan2(x, ca.sqrt(y * y + z * z))
    return {"q_n0i": attitude.from_euler(roll, pitch, heading), "begin": 0}


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: attitude since the start, and the block's sum."""
    rotation, increment = compensated(x, u.delta_angle, u.delta_velocity)
    return {
        "q_ib": attitude.renormalize(attitude.multiply(x.q_ib, attitude.from_small_rotation_vector(rotation))),
        "half_turn": turned(x.half_turn, u.dt),
        "force_sum": x.force_sum + attitude.rotate(x.q_ib, increment),
        "block_time": x.block_time + u.dt,
        "block_count": x.block_count + 1,
        "block_due": x.block_count + 1 >= p.block_samples,
        "time": x.time + u.dt,
        **remembered(x, u.delta_angle, u.delta_velocity),
    }


def block_done() -> dict[str, Any]:
    """Rows of a block that has been used."""
    return {"force_sum": ca.SX.zeros(3), "block_time": 0, "block_count": 0, "block_due": 0}


def turned(half_turn: Any, dt: Any) -> Any:
    """`half_turn` after the Earth has turned on for `dt` (up to some 10 s: the series end at rounding)."""
    angle = geodesy.OMEGA_IE * dt / 2
    s, c = angle - angle**3 / 6, 1 - angle * angle / 2 + angle**4 / 24
    return ca.vertcat(half_turn[0] * c - half_turn[1] * s, half_turn[1] * c + half_turn[0] * s)


def q_n0n(half_turn: Any, axis_n: Any) -> Any:
    """The Earth's turn since the start, 4x1: takes components in n now to n0.  For the turn during a delay it is (7)."""
    return ca.vertcat(half_turn[0], half_turn[1] * axis_n)


def block_velocity_n(x: Any) -> Any:
    """What a complete block adds to the velocity over the Earth, in n at its middle (3, m/s): (C f + g) T."""
    middle = attitude.conjugate(q_n0n(turned(x.half_turn, -x.block_time / 2), x.axis_n))
    force = attitude.rotate(attitude.multiply(middle, x.q_n0i), x.force_sum)
    return force + ca.vertcat(0, 0, x.gravity * x.block_time)


def corrected(x: Any, turn_n: Any) -> Any:
    """q_n0i after the estimated attitude has been turned by a small rotation vector in n now (3, rad)."""
    turn = attitude.rotate(q_n0n(x.half_turn, x.axis_n), turn_n)
    q = attitude.multiply(attitude.from_small_rotation_vector(turn), x.q_n0i)
    return attitude.renormalize(q)


def q_nb(x: Any) -> Any:
    """Attitude now, (8)."""
    back = attitude.conjugate(q_n0n(x.half_turn, x.axis_n))
    return attitude.normalize(attitude.multiply(back, attitude.multiply(x.q_n0i, x.q_ib)))


def horizontal_earth_rate(x: Any) -> Any:
    """rad/s; at a pole, where there is no heading, a trace of it."""
    return geodesy.OMEGA_IE * (ca.fabs(x.axis_n[0]) + 1e-12)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Rows of `PARAMETERS` from what is known."""
    return {
        "latitude": known.latitude,
        "height": known.height,
        "block_samples": max(1.0, round(BLOCK_S / known.sample_interval)),
        "gyro_bias_sigma": known.sensors.gyro_bias_sigma,
        "accel_bias_sigma": known.sensors.accel_bias_sigma,
        "angle_random_walk": known.sensors.angle_random_walk,
        "velocity_random_walk": known.sensors.velocity_random_walk,
    }
