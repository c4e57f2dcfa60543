"""The frozen inertial frame of alignment in place, and blocks of inertial samples in it.

Frame i is b at the start, frozen; n0 is n at the start. The gyros give q_ib, the Earth's known rate gives q_n0n, and
between them is the quaternion q_n0i, constant except for corrections:

    q_nb = conj(q_n0n) q_n0i q_ib

The Earth's rotation since the start is stored as cosine and sine of half its angle (`half_turn`).

Blocks (of `gyrocompass` and `inertial-fir`): per sample only q_ib changes, and specific force is summed in i.
Everything else is done once per block of samples (about 0.1 s); its mean specific force belongs exactly to the middle
of the block.

Source: the swaying-base paper, (1), (2) and (7), in NED and FRD axes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import atan2, sin_cos
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import rows
from insenv.estimators.parts.strapdown import MEMORY, compensated, remembered

BLOCK_S = 0.1
"""Length of a block, s."""

FRAME = Table((
    Row("q_ib", "Attitude since the start: takes b components to components in b at the start", "1", (4,), "i", (1, 0, 0, 0)),
    Row("q_n0i", "Attitude at the start: takes i components to components in n at the start", "1", (4,), "n0", (1, 0, 0, 0)),
    Row("axis_n", "The Earth's axis", "1", (3,), "n"),
    Row("gravity", "Normal gravity", "m/s^2"),
    Row("gravity_n", "Its vector, which above the ellipsoid leans towards the equator", "m/s^2", (3,), "n"),
    Row("half_turn", "Cosine and sine of half the Earth's rotation angle since the start", "1", (2,), start=(1, 0)),
))  # fmt: skip

PARAMETERS = (
    rows.chosen(rows.PLACE, "latitude", "height")
    + Table((Row("block_samples", "Inertial samples in a block", "1", start=20.0, lower=1.0, upper=1e6),))
    + rows.chosen(rows.NOISES, angle_random_walk=1e-6, velocity_random_walk=1e-4)
)

BLOCK = Table((
    Row("force_sum", "Integral of specific force since the start of the block", "m/s", (3,), "i"),
    Row("block_time", "Time since the start of the block", "s"),
    Row("block_count", "Samples since the start of the block", "1"),
    Row("block_due", "1 when the block is complete", "1"),
))  # fmt: skip
"""After a block has been used, these rows begin anew (`rows.at_start`)."""

STATE = FRAME + BLOCK + Table((
    Row("begin", "1 before the first sample", "1", start=1.0),
    Row("time", "Time since the start", "s"),
)) + MEMORY  # fmt: skip
VELOCITY = Row("velocity_n", "Velocity over the Earth by integration, fed back", "m/s", (3,), "n")


def start(p: Any) -> dict[str, Any]:
    """The rows of `FRAME` that the place determines. p: rows `latitude`, `height`."""
    sin_latitude, cos_latitude = sin_cos(p.latitude)
    axis_n = ca.vertcat(cos_latitude, 0, -sin_latitude)
    gravity_n = geodesy.normal_gravity_about_axis(axis_n, p.height)
    return {"axis_n": axis_n, "gravity": gravity_n[2], "gravity_n": gravity_n}


def advanced(x: Any, u: Any) -> tuple[dict[str, Any], Any]:
    """Rows of `FRAME` and `MEMORY` after one inertial sample, and the integral of its specific force (3, m/s, i)."""
    rotation, increment = compensated(x, u.delta_angle, u.delta_velocity)
    changed = {
        "q_ib": attitude.renormalize(attitude.multiply(x.q_ib, attitude.from_small_rotation_vector(rotation))),
        "half_turn": turned(x.half_turn, u.dt),
        **remembered(x, u.delta_angle, u.delta_velocity),
    }
    return changed, attitude.rotate(x.q_ib, increment)


def turned(half_turn: Any, dt: Any) -> Any:
    """`half_turn` after the Earth has rotated for another `dt` seconds (up to about 10: the series end at rounding)."""
    angle = geodesy.OMEGA_IE * dt / 2
    s, c = angle - angle**3 / 6, 1 - angle * angle / 2 + angle**4 / 24
    return ca.vertcat(half_turn[0] * c - half_turn[1] * s, half_turn[1] * c + half_turn[0] * s)


def q_n0n(half_turn: Any, axis_n: Any) -> Any:
    """The Earth's rotation since the start (4x1): takes n components to n0 components; (7) for that in a delay."""
    return ca.vertcat(half_turn[0], half_turn[1] * axis_n)


def q_nb(x: Any, q_n0i: Any) -> Any:
    """Attitude now, (8)."""
    back = attitude.conjugate(q_n0n(x.half_turn, x.axis_n))
    return attitude.normalize(attitude.multiply(back, attitude.multiply(q_n0i, x.q_ib)))


def corrected(x: Any, turn_n: Any) -> Any:
    """q_n0i after the estimated attitude has been rotated by a small rotation vector in n now (3, rad)."""
    turn = attitude.rotate(q_n0n(x.half_turn, x.axis_n), turn_n)
    q = attitude.multiply(attitude.from_small_rotation_vector(turn), x.q_n0i)
    return attitude.renormalize(q)


def horizontal_earth_rate(x: Any) -> Any:
    """Horizontal component of the Earth rate, rad/s; tiny but not zero at a pole, where there is no heading."""
    return geodesy.OMEGA_IE * (ca.fabs(x.axis_n[0]) + 1e-12)


def heading_variance(p: Any, x: Any, noise: Any) -> Any:
    """Variance (rad^2) of a heading by the Earth's rotation: of biases, and of a white `noise` as of a drift, (rad/s)^2."""
    tilt, slope = p.accel_bias_sigma / x.gravity, x.axis_n[2] / (x.axis_n[0] + 1e-12)
    return (p.gyro_bias_sigma**2 + noise) / horizontal_earth_rate(x) ** 2 + (tilt * slope) ** 2


def levelling(heading: Callable[[Any], Any]) -> Step:
    """The step at the first sample: q_n0i such that its specific force points up; heading: ``p -> rad``."""

    def begin(p: Any, x: Any, u: Any) -> dict[str, Any]:
        fx, fy, fz = ca.vertsplit(u.delta_velocity)
        roll, pitch = atan2(-fy, -fz), atan2(fx, ca.sqrt(fy * fy + fz * fz))
        return {"q_n0i": attitude.from_euler(roll, pitch, heading(p)), "begin": 0}

    return Step(begin, when="begin")


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: attitude since the start, and the sum of the block."""
    changed, force = advanced(x, u)
    return {
        **changed,
        "force_sum": x.force_sum + force,
        "block_time": x.block_time + u.dt,
        "block_count": x.block_count + 1,
        "block_due": x.block_count + 1 >= p.block_samples,
        "time": x.time + u.dt,
    }


def block_velocity_n(x: Any) -> Any:
    """Change of the velocity over the Earth in a complete block, in n at its middle (3, m/s): (C f + g) T."""
    middle = attitude.conjugate(q_n0n(turned(x.half_turn, -x.block_time / 2), x.axis_n))
    force = attitude.rotate(attitude.multiply(middle, x.q_n0i), x.force_sum)
    return force + x.gravity_n * x.block_time


def prepare(known: Knowledge) -> dict[str, Any]:
    """Rows of `PARAMETERS` from what is known."""
    return {**known.rows_of(PARAMETERS), "block_samples": max(1.0, round(BLOCK_S / known.sample_interval))}
