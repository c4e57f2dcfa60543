"""`inertial-fir`: alignment in place on any sway, by gravity in the inertial frame after linear-phase FIR low-passes.

No coarse alignment is needed, at any attitude. In the frozen frame i, specific force is minus gravity, which moves
slowly along a cone with the Earth, plus disturbances above 1/15 Hz. Means over blocks of 0.1 s pass three symmetric
low-passes and two decimations (`insenv.estimators.parts.fir`). From the filtered vectors f at times t_M - D/2, t_M and
t_M + D/2, with f = -g:

    U = f(t_M) / |f(t_M)|,   E along f(t_M + D/2) - f(t_M - D/2),   N = U x E                               (3), (6)
    C_i^nM = [N E -U]^T  (the paper's n is north, up, east)                                               (5)
    C_b^n = C_nM^n C_i^nM C_b^i,  C_nM^n by the Earth's rotation in the delay, which is known exactly      (7), (8)

This first fix comes after `SPAN` blocks, 180 s, and sets the attitude. Fine levelling by velocity feedback follows: the
integrated velocity, which should stay near zero, corrects itself and the tilts with the gains of the two-state Kalman
filter of one horizontal channel (velocity error' = g tilt) for a given standard deviation of the sway's velocity. (A
constant gain high enough to level within a minute would bring the sway of a moored boat into the tilts.) Later fixes,
one every 2 s, are averaged into the heading with weights 1/k. This is insenv's addition; `heading_memory` = 0 keeps the
first fix, as in the paper.

The cascade passes what rotates with the Earth with a gain 2.0e-7 below that of what does not: a tilt about east of at
most 1.0e-7 rad, which is not corrected.

Source: the swaying-base paper (Lian, Tang, Wu, Hu 2007), numbers of its equations.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import PI, minimum, select, sin_cos
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, frozen_frame, rows
from insenv.estimators.parts.fir import BLOCK_S, CASCADE, filtered

TAPS = tuple(len(h) for h in CASCADE.filters)
STRIDE = CASCADE.strides[-1]
"""Blocks from one filtered vector to the next."""
BASELINE = 54
"""Filtered vectors from the oldest to the newest of a difference: D = 108 s."""
SPAN = -(-CASCADE.span // STRIDE) * STRIDE + BASELINE * STRIDE
"""Blocks until the first fix."""
DELAY = 0.5 + CASCADE.delay + BASELINE * STRIDE / 2
"""Blocks from t_M to the end of the last block, exact."""


def noise_times(averaged: Any) -> tuple[Any, Any]:
    """Times (s, s^3) by which the noise of heading falls.

    The squared noise of heading times the squared horizontal Earth rate is N^2 over the first plus (V/g)^2 over the
    second, with N and V the random walks of gyros and accelerometers.

    averaged: time over which fixes are averaged, s. Fitted to the inverse integrals of the squares of the weights that
    cascade, difference and average give to drift, and of these weights' slopes: within 6 and 25 % (a test integrates
    them).
    """
    square = averaged * averaged
    return 40.0 + ca.sqrt(square + 78.85**2), 1.82e5 + 57.0 * square


PARAMETERS = frozen_frame.PARAMETERS + Table((
    Row("sway_velocity_sigma", "Standard deviation of horizontal sway velocity", "m/s", start=0.3, lower=1e-6, upper=100.0),
    Row("level_sigma", "Standard deviation of tilt after the first fix", "rad", start=3e-5, lower=1e-9, upper=1.0),
    Row("heading_memory", "Time over which fixes are averaged into the heading", "s", start=600.0, lower=0.0, upper=1e6),
))  # fmt: skip

STATE = frozen_frame.STATE + Table((
    Row("first_inputs", "Inputs of the first sub-filter, newest first", "m/s^2", (TAPS[0], 3), "i"),
    Row("second_inputs", "Inputs of the second sub-filter", "m/s^2", (TAPS[1], 3), "i"),
    Row("third_inputs", "Inputs of the third sub-filter", "m/s^2", (TAPS[2], 3), "i"),
    Row("filtered", "Filtered specific force, newest first", "m/s^2", (BASELINE + 1, 3), "i"),
    Row("blocks", "Blocks since the start", "1"),
    Row("first_due", "1 when the first sub-filter is due", "1"),
    Row("second_due", "1 when the second sub-filter is due", "1"),
    Row("third_due", "1 when the third sub-filter is due", "1"),
    Row("fix_due", "1 when the filtered vectors give a fix", "1"),
    Row("fixes", "Number of fixes", "1"),
    Row("level_due", "1 when a block for levelling is complete", "1"),
    Row("velocity_n", "Velocity over the Earth by integration, fed back", "m/s", (3,), "n"),
    Row("velocity_variance", "Its variance in a horizontal channel", "m^2/s^2"),
    Row("tilt_variance", "Variance of the tilt of that channel", "rad^2"),
    Row("velocity_tilt", "Their covariance", "m/s"),
))  # fmt: skip


def begin(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Level by the first sample, at heading 0: the attitude until the first fix."""
    return frozen_frame.levelled(u, 0.0)


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    changed = frozen_frame.sample(p, x, u)
    return {**changed, "level_due": ca.logic_and(changed["block_due"], x.fixes > 0)}


def level(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Velocity feedback, once per block: Kalman filter of velocity and tilt, with the same gains north and east."""
    T, g = x.block_time, x.gravity
    velocity = x.velocity_n + frozen_frame.block_velocity_n(x)
    # time update: velocity error' = g tilt, tilt' = white noise; a gyro bias as the noise that drifts as far in 100 s
    tilt = x.tilt_variance
    drift = p.angle_random_walk**2 + 100.0 * p.gyro_bias_sigma**2
    vv = x.velocity_variance + g * T * (2 * x.velocity_tilt + g * T * tilt) + p.velocity_random_walk**2 * T
    vt = x.velocity_tilt + g * T * tilt
    # velocity observed to be zero, with the sway as noise with a correlation time of 1 s
    S = vv + p.sway_velocity_sigma**2 / T
    gain_v, gain_t = vv / S, vt / S
    turn = ca.vertcat(-gain_t * velocity[1], gain_t * velocity[0], 0)
    return {
        "q_n0i": frozen_frame.corrected(x, turn),
        "velocity_n": ca.vertcat((1 - gain_v) * velocity[:2], 0),
        "velocity_variance": (1 - gain_v) * vv,
        "velocity_tilt": (1 - gain_v) * vt,
        "tilt_variance": tilt + drift * T - gain_t * vt,
        "level_due": 0,
    }


def block(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The mean specific force of a block enters the cascade."""
    blocks = x.blocks + 1
    return {
        "first_inputs": _pushed(x.first_inputs, x.force_sum / x.block_time),
        "blocks": blocks,
        "first_due": _every(CASCADE.decimation[0], blocks),
        **frozen_frame.block_done(),
    }


def first(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """First sub-filter and decimation."""
    y = filtered(CASCADE.filters[0], x.first_inputs)
    return {"second_inputs": _pushed(x.second_inputs, y), "first_due": 0, "second_due": _every(STRIDE, x.blocks)}


def second(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Second sub-filter and decimation."""
    y = filtered(CASCADE.filters[1], x.second_inputs)
    return {"third_inputs": _pushed(x.third_inputs, y), "second_due": 0, "third_due": 1}


def third(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Third sub-filter."""
    y = filtered(CASCADE.filters[2], x.third_inputs)
    return {"filtered": _pushed(x.filtered, y), "third_due": 0, "fix_due": x.blocks >= SPAN}


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Attitude from gravity and its derivative, (3), (5), (6), with the delay compensated, (7)."""
    up = _unit(x.filtered[BASELINE // 2, :].T)
    north = _unit(ca.cross(up, (x.filtered[0, :] - x.filtered[BASELINE, :]).T))
    east = ca.cross(north, up)
    q_nMi = attitude.from_dcm(ca.horzcat(north, east, -up).T)
    # the Earth's rotation from the start to t_M, with the mean length of a block
    delay = DELAY * x.time / x.blocks
    s, c = sin_cos(geodesy.OMEGA_IE * (x.time - delay) / 2)
    q_n0i = attitude.multiply(frozen_frame.q_n0n(ca.vertcat(c, s), x.axis_n), q_nMi)

    is_first = x.fixes == 0
    to_n0 = frozen_frame.q_n0n(x.half_turn, x.axis_n)
    difference = attitude.rotate_inverse(to_n0, attitude.error_rotation_vector(q_n0i, x.q_n0i))
    interval = STRIDE * x.time / x.blocks
    # weight 1/k; without memory only the first fix counts
    memory = minimum(x.fixes + 1, p.heading_memory / interval)
    weight = select(memory < 1.0, 0.0, 1 / select(memory < 1.0, 1.0, memory))
    turn = attitude.rotate(to_n0, ca.vertcat(0, 0, weight * difference[2]))
    averaged = attitude.normalize(attitude.multiply(attitude.from_rotation_vector(turn), x.q_n0i))
    return {
        "q_n0i": select(is_first, q_n0i, averaged),
        "fixes": x.fixes + 1,
        "fix_due": 0,
        "velocity_variance": select(is_first, p.sway_velocity_sigma**2, x.velocity_variance),
        "tilt_variance": select(is_first, p.level_sigma**2, x.tilt_variance),
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now, and the limit of biases and white noise; before the first fix the heading is unknown."""
    g = x.gravity
    drift_time, cube = noise_times(minimum(STRIDE * BLOCK_S * x.fixes, p.heading_memory))
    noise = p.angle_random_walk**2 / drift_time + (p.velocity_random_walk / g) ** 2 / cube
    tilt = p.accel_bias_sigma / g
    slope = x.axis_n[2] / (x.axis_n[0] + 1e-12)
    heading = ca.sqrt((p.gyro_bias_sigma**2 + noise) / frozen_frame.horizontal_earth_rate(x) ** 2 + (tilt * slope) ** 2)
    # at most the gyro drift since the time of the fix's vertical
    levelled = ca.sqrt(tilt**2 + x.tilt_variance + (p.gyro_bias_sigma * (DELAY * BLOCK_S)) ** 2)
    unknown = x.fixes == 0
    levelled, heading = select(unknown, 0.2, levelled), select(unknown, PI, minimum(heading, PI))
    return {"q_nb": frozen_frame.q_nb(x, x.q_n0i), "attitude_sigma": ca.vertcat(levelled, levelled, heading)}


def _pushed(buffer: Any, vector: Any) -> Any:
    """A buffer (rows, newest first) with a new vector (3x1) in and its oldest out."""
    return ca.vertcat(vector.T, buffer[:-1, :])


def _every(count: int, blocks: Any) -> Any:
    """Whether `blocks` is a multiple of `count`."""
    return blocks == count * ca.floor((blocks + 0.5) / count)


def _unit(vector: Any) -> Any:
    return vector / (ca.sqrt(ca.sumsqr(vector)) + 1e-300)


MODEL = Model(
    id="inertial-fir",
    title="alignment in place by gravity in the inertial frame behind FIR low-passes, then levelling",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={
        "begin": Step(begin, when="begin"),
        "sample": Step(sample),
        "level": Step(level, when="level_due"),
        "block": Step(block, when="block_due"),
        "first": Step(first, when="first_due"),
        "second": Step(second, when="second_due"),
        "third": Step(third, when="third_due"),
        "fix": Step(fix, when="fix_due"),
    },
    output=output,
    start=frozen_frame.start,
)

ESTIMATOR = Estimator(
    MODEL,
    kind="alignment",
    prepare=frozen_frame.prepare,
    needs=lambda parameters: SPAN * BLOCK_S,  # until the first fix
    applicability=applicability.notes,
)
