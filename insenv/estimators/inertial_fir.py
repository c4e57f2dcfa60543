"""`inertial-fir`: alignment in place on any sway, by gravity in the inertial frame after linear-phase FIR low-passes.

No coarse alignment is needed, at any attitude. In the frozen frame i, specific force is minus gravity, which moves
slowly along a cone with the Earth, plus disturbances above 1/15 Hz. Means over blocks of 0.1 s pass three symmetric
low-passes and two decimations. From the filtered vectors f at times t_M - D/2, t_M and t_M + D/2, with f = -g:

    U = f(t_M) / |f(t_M)|,   E along f(t_M + D/2) - f(t_M - D/2),   N = U x E                               (3), (6)
    C_i^nM = [N E -U]^T  (the paper's n is north, up, east)                                               (5)
    C_b^n = C_nM^n C_i^nM C_b^i,  C_nM^n by the Earth's rotation in the delay, which is known exactly      (7), (8)

This first fix comes after `SPAN` blocks, 180 s, and sets the attitude. Fine levelling by velocity feedback follows: the
integrated velocity, which should stay near zero, corrects itself and the tilts with the gains of the two-state Kalman
filter of one horizontal channel (velocity error' = g tilt) for a given standard deviation of the sway's velocity. (A
constant gain high enough to level within a minute would bring the sway of a moored boat into the tilts.)

insenv's addition: the heading of the difference between two ends, each a weighted sum (`END`) of the twelve vectors at the
newest and the oldest edge. Every later vector, one every 2 s, lengthens the difference: the step of the newest end shows
the heading as the whole difference does, and the heading is the mean over all k steps, the new one with the weight 1/k. The
mean of the steps is the difference of the ends. `heading_memory` = 0 keeps the first fix, as in the paper.

Motion slower than the stop-band passes the cascade, as the surge of a ship at a mooring does, and is taken for the way of
gravity. What passes is measured: the scatter of the ends about a straight line (`insenv.estimators.parts.scatter`). Beyond
that of the noises it counts in the standard deviations of heading and level, in the gain of the levelling, and in a note.

The cascade passes what rotates with the Earth with a gain 2.0e-7 below that of what does not: a tilt about east of at
most 1.0e-7 rad, which is not corrected.

Source: the swaying-base paper (Lian, Tang, Wu, Hu 2007), numbers of its equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import cos
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.base.remarks import declared
from insenv.core.elementary import PI, exp, maximum, minimum, select, sin_cos
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, frozen_frame, rows, scatter
from insenv.estimators.parts.finding import Finding
from insenv.estimators.parts.frozen_frame import BLOCK_S

# The cascade of low-passes: each sub-filter is of odd length and symmetric, so its delay is exactly half its length at every
# frequency. The coefficients are those of the shortest sub-filters that keep the specification below, by the exchange of Parks
# and McClellan (SciPy 1.17.1), rounded to 1e-12. They are constants, so that results do not depend on the installed SciPy; the
# tests design them again and compare. Source: section 1 of the paper: two decimations, three sub-filters, pass-band ripple
# 0.01, disturbances above 1/15 Hz.
PASS_HZ = 0.002
"""Edge of the pass-band: in the inertial frame gravity turns at 1.16e-5 Hz."""
STOP_HZ = 1.0 / 15.0
"""Edge of the stop-band: disturbances lie above it."""
STOP_DB = 100.0
"""Attenuation, dB. Of a sway of 0.5 m/s^2 at most 5e-6 m/s^2 remains: below 0.01 deg of heading."""

# First half and centre of each symmetric sub-filter.
# fmt: off
FIRST = (
    0.000119304809, 0.000779186969, 0.00293764973, 0.008150885028, 0.018242956898, 0.034508416729,
    0.056691206986, 0.082274471112, 0.106638565787, 0.124285966081, 0.130742779742,
)
SECOND = (
    0.000152628606, 0.001088344856, 0.004321658822, 0.012303499383, 0.027649709056, 0.051505777724,
    0.081803854968, 0.112695970895, 0.136072961275, 0.14481118883,
)
THIRD = (
    3.5758884e-05, 0.000177501735, 0.000573978431, 0.001467513019, 0.003198907039, 0.006179465245,
    0.010825072271, 0.017456255688, 0.026181783221, 0.036794845097, 0.048715268683, 0.061005716851,
    0.072473578057, 0.081847771199, 0.087996837056, 0.090139495049,
)
# fmt: on

FILTERS = tuple(half + half[-2::-1] for half in (FIRST, SECOND, THIRD))
"""Coefficients of the sub-filters, newest sample first."""
STRIDES = (1, 5, 20)
"""Blocks between two inputs of each sub-filter; the last is also that from one filtered vector to the next."""
STRIDE = STRIDES[-1]
CASCADE_SPAN = 1 + sum((len(h) - 1) * stride for h, stride in zip(FILTERS, STRIDES, strict=True))
"""Blocks that one filtered vector depends on."""
CASCADE_DELAY = (CASCADE_SPAN - 1) / 2
"""Blocks from the time of a filtered vector to the middle of the last block, exact."""
BASELINE = 54
"""Steps from the oldest filtered vector to the newest in the difference of the first fix: D = 108 s."""
SPAN = -(-CASCADE_SPAN // STRIDE) * STRIDE + BASELINE * STRIDE
"""Blocks until the first fix."""
DELAY = 0.5 + CASCADE_DELAY + BASELINE * STRIDE / 2
"""Blocks from t_M to the end of the last block, exact."""
END = (0.746, 0.278, -0.005, -0.14, -0.169, -0.136, -0.073, -0.006, 0.052, 0.1, 0.147, 0.206)
"""Weights of the vectors of an end, from its edge inwards: those of the least noise of heading after 240 s, for N of 0.002
deg/sqrt(h) and V of 20 ug/sqrt(Hz), with a white noise of 1e-6 rad of each vector added, which keeps the weights small and so
the attenuation of the cascade (a test designs them again)."""
ENDS_FROM = CASCADE_SPAN + (len(END) - 1) * STRIDE
"""Blocks until the first end."""
LAG = sum(j * weight for j, weight in enumerate(END))
"""Steps from the edge to the mean time of an end."""
START = BASELINE - 2 * LAG
"""Steps between the two ends at the first fix."""
END_DELAY = 0.5 + CASCADE_DELAY + LAG * STRIDE
"""Blocks from the mean time of the newest end to the end of the last block."""
STEP_DELAY = 0.5 + CASCADE_DELAY + (LAG + 0.5) * STRIDE
"""Blocks from the middle of the newest step to the end of the last block."""
PRINTED_SMEAR, PRINTED_ENDS = 9.859, 0.06397
SMEAR, ENDS = 16.135, 0.04164
"""Of the impulse response h of blocks and cascade, with the weights of an end and (as printed) without: twice the integral of
H (1 - H), H that of h (s), and twice that of h^2 (1/s)."""


def noise_times(elapsed: Any, memory: Any) -> tuple[Any, Any]:
    """Times (s, s^3) by which the noise of heading falls.

    The squared noise of heading times the squared horizontal Earth rate is N^2 over the first plus (V/g)^2 over the
    second, with N and V the random walks of gyros and accelerometers: the inverse integrals of the squares of the weights
    that cascade and mean give to drift, and of these weights' slopes (a test integrates them: within 2 and 13 %).

    elapsed: time since the first fix, s. memory: the part of it over which the mean goes, s; older steps are forgotten
    exponentially; below one step the first fix is kept.
    """
    interval = STRIDE * BLOCK_S
    printed = memory < interval
    recent = minimum(elapsed, memory)
    whole = interval * START + recent
    faded = exp(-2.0 * (elapsed - recent) / whole)  # of the squares of the oldest weights
    longer = whole * whole * 2.0 / (1.0 + faded)
    first = interval * BASELINE
    return (
        select(printed, first * first / (first - PRINTED_SMEAR), longer / (whole - SMEAR)),
        select(printed, first * first / PRINTED_ENDS, longer / ENDS),
    )


SCATTERED = 2 * STRIDE * BLOCK_S * scatter.MEMORY / 15
"""s: the variance of a Brownian path of unit density about the line through its last part."""
EXPECTED = 3.0
"""Variances of the noises up to which the scatter of the ends counts as noise: it is the largest of many."""
SHAKEN = 60.0
"""s over which the horizontal acceleration is averaged."""
IN_PHASE = 0.2
"""Part of the acceleration that moves with the heading and does not average out: largest in surges of 18 s."""
LEAST_HEADING = 1e-4
"""rad: what motion makes of the heading is not worth a note below this, however good the gyros."""

PARAMETERS = frozen_frame.PARAMETERS + Table((
    Row("sway_velocity_sigma", "Standard deviation of horizontal sway velocity", "m/s", start=0.3, lower=1e-6, upper=100.0),
    Row("level_sigma", "Standard deviation of tilt after the first fix", "rad", start=3e-5, lower=1e-9, upper=1.0),
    Row("heading_memory", "Time since the first fix that the heading is averaged over", "s", start=600.0, lower=0.0, upper=1e6),
))  # fmt: skip

OUTPUTS = rows.ALIGNMENT + Table((
    Row("motion_heading_sigma", "Part of the standard deviation of the heading: slow motion of the base", "rad"),
))  # fmt: skip

STATE = frozen_frame.STATE + Table((
    Row("first_inputs", "Inputs of the first sub-filter, newest first", "m/s^2", (len(FIRST) * 2 - 1, 3), "i"),
    Row("second_inputs", "Inputs of the second sub-filter", "m/s^2", (len(SECOND) * 2 - 1, 3), "i"),
    Row("third_inputs", "Inputs of the third sub-filter", "m/s^2", (len(THIRD) * 2 - 1, 3), "i"),
    Row("filtered", "Filtered specific force, newest first", "m/s^2", (BASELINE + 1, 3), "i"),
    Row("blocks", "Blocks since the start", "1"),
    Row("first_due", "1 when the first sub-filter is due", "1"),
    Row("second_due", "1 when the second sub-filter is due", "1"),
    Row("third_due", "1 when the third sub-filter is due", "1"),
    Row("end_due", "1 when the newest filtered vectors make an end", "1"),
    Row("fix_due", "1 when the filtered vectors give a fix", "1"),
    Row("fixes", "Number of fixes", "1"),
    Row("level_due", "1 when a block for levelling is complete", "1"),
    frozen_frame.VELOCITY,
    Row("velocity_variance", "Its variance in a horizontal channel", "m^2/s^2"),
    Row("tilt_variance", "Variance of the tilt of that channel", "rad^2"),
    Row("velocity_tilt", "Their covariance", "m/s"),
    Row("shaking", "Mean square of the horizontal acceleration", "m^2/s^4"),
    Row("end_motion", "Largest variance of an end by motion that passes the cascade", "m^2/s^4"),
)) + scatter.state("end", "the ends", "m/s^2", 3, "i")  # fmt: skip


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    changed = frozen_frame.sample(p, x, u)
    return {**changed, "level_due": ca.logic_and(changed["block_due"], x.fixes > 0)}


def level(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Velocity feedback, once per block: Kalman filter of velocity and tilt, with the same gains north and east."""
    T, g = x.block_time, x.gravity
    gained = frozen_frame.block_velocity_n(x)
    velocity = x.velocity_n + gained
    # time update: velocity error' = g tilt, tilt' = white noise; a gyro bias, and the Earth's rotation that a wrong heading
    # leaves over, as the noise that drifts as far in 100 s
    tilt = x.tilt_variance
    drift = p.angle_random_walk**2 + 100.0 * (p.gyro_bias_sigma**2 + _rate_of_motion(p, x))
    vv = x.velocity_variance + g * T * (2 * x.velocity_tilt + g * T * tilt) + p.velocity_random_walk**2 * T
    vt = x.velocity_tilt + g * T * tilt
    # velocity observed to be zero, with the sway as noise with a correlation time of 1 s
    S = vv + p.sway_velocity_sigma**2 / T
    gain_v, gain_t = vv / S, vt / S
    turn = ca.vertcat(-gain_t * velocity[1], gain_t * velocity[0], 0)
    return {
        "q_n0i": frozen_frame.corrected(x, turn),
        "shaking": x.shaking + T / SHAKEN * (ca.sumsqr(gained[:2] / T) - x.shaking),
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
        "first_due": _every(STRIDES[1], blocks),
        **rows.at_start(frozen_frame.BLOCK),
    }


def first(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """First sub-filter and decimation."""
    y = filtered(FILTERS[0], x.first_inputs)
    return {"second_inputs": _pushed(x.second_inputs, y), "first_due": 0, "second_due": _every(STRIDE, x.blocks)}


def second(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Second sub-filter and decimation."""
    y = filtered(FILTERS[1], x.second_inputs)
    return {"third_inputs": _pushed(x.third_inputs, y), "second_due": 0, "third_due": 1}


def third(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Third sub-filter."""
    y = filtered(FILTERS[2], x.third_inputs)
    return {"filtered": _pushed(x.filtered, y), "third_due": 0, "end_due": x.blocks >= ENDS_FROM}


def end(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The newest end: how much the ends scatter about a straight line."""
    newest = sum((END[j] * x.filtered[j, :].T for j in range(len(END))), ca.SX.zeros(3))
    curved_n0 = attitude.rotate(_q_n0n_before(x, END_DELAY), _curved(x, -x.gravity_n))
    evenly = newest - attitude.rotate_inverse(x.q_n0i, curved_n0)
    return {**scatter.taken(x, "end", evenly), "end_due": 0, "fix_due": x.blocks >= SPAN}


def _curved(x: Any, force_n: Any) -> Any:
    """What the way of a vector that stays in n bends away from its direction at the first fix, in axes n now."""
    turned = geodesy.OMEGA_IE * x.fixes * STRIDE * x.time / x.blocks
    s, c = sin_cos(turned)
    about = ca.cross(x.axis_n, force_n)
    then = c * force_n - s * about + (1 - c) * ca.dot(x.axis_n, force_n) * x.axis_n
    return force_n - then - turned * ca.cross(x.axis_n, then)


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Attitude from gravity and its derivative, (3), (5), (6), with the delay compensated, (7); then the mean of the steps."""
    up = _unit(x.filtered[BASELINE // 2, :].T)
    north = _unit(ca.cross(up, (x.filtered[0, :] - x.filtered[BASELINE, :]).T))
    east = ca.cross(north, up)
    # gravity leans against the ellipsoid's normal
    lean = attitude.from_small_rotation_vector(ca.vertcat(0, x.gravity_n[0] / x.gravity, 0))
    q_nMi = attitude.multiply(lean, attitude.from_dcm(ca.horzcat(north, east, -up).T))
    q_n0i = attitude.multiply(_q_n0n_before(x, DELAY), q_nMi)

    # the way of gravity between the ends, or of the newest end in its last step, points along east by what the Earth turns in
    # its time; its north part shows the heading
    is_first, interval = x.fixes == 0, STRIDE * x.time / x.blocks
    opposite = [select(is_first, x.filtered[BASELINE - j, :], x.filtered[j + 1, :]) for j in range(len(END))]
    way_i = sum((END[j] * (x.filtered[j, :] - opposite[j]).T for j in range(len(END))), ca.SX.zeros(3))
    base = select(is_first, q_n0i, x.q_n0i)
    way_n = attitude.rotate_inverse(_q_n0n_before(x, select(is_first, DELAY, STEP_DELAY)), attitude.rotate(base, way_i))
    full = x.gravity * frozen_frame.horizontal_earth_rate(x) * interval
    # without memory only the first fix counts
    memory = p.heading_memory / interval
    weight = select(memory < 1.0, 0.0, 1.0 / (START + minimum(x.fixes, memory)))  # of a step
    to_n0 = frozen_frame.q_n0n(x.half_turn, x.axis_n)
    turn = attitude.rotate(to_n0, ca.vertcat(0, 0, weight * way_n[0] / full))
    return {
        "end_motion": maximum(x.end_motion, _motion(p, x, north)),
        "q_n0i": attitude.normalize(attitude.multiply(attitude.from_rotation_vector(turn), base)),
        "fixes": x.fixes + 1,
        "fix_due": 0,
        "velocity_variance": select(is_first, p.sway_velocity_sigma**2, x.velocity_variance),
        "tilt_variance": select(is_first, p.level_sigma**2, x.tilt_variance),
    }


def _motion(p: Any, x: Any, axis_i: Any) -> Any:
    """Variance ((m/s^2)^2) of an end along an axis (3, i) beyond that of the noises."""
    noise = p.velocity_random_walk**2 * ENDS / 2 + (x.gravity * p.angle_random_walk) ** 2 * SCATTERED
    return maximum(axis_i.T @ scatter.covariance(x, "end") @ axis_i - EXPECTED * noise, 0.0)


def _rate_of_motion(p: Any, x: Any) -> Any:
    """Variance ((rad/s)^2) of the Earth's horizontal rate that motion of both ends leaves over, 0 before the first fix."""
    whole = STRIDE * BLOCK_S * (START + minimum(x.fixes - 1.0, p.heading_memory / (STRIDE * BLOCK_S)))
    return 2 * x.end_motion / (x.gravity * whole) ** 2


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now, and the limit of biases and white noise; before the first fix the heading is unknown."""
    g = x.gravity
    interval = STRIDE * BLOCK_S
    drift_time, cube = noise_times(interval * (x.fixes - 1.0), p.heading_memory)
    noise = p.angle_random_walk**2 / drift_time + (p.velocity_random_walk / g) ** 2 / cube
    by_motion = _rate_of_motion(p, x)
    tilt, heading = p.accel_bias_sigma / g, ca.sqrt(frozen_frame.heading_variance(p, x, noise + by_motion))
    # a heading that moves with the base turns its acceleration to and fro
    moved = ca.sqrt(by_motion) / frozen_frame.horizontal_earth_rate(x)
    turned = (IN_PHASE * moved / g) ** 2 * x.shaking
    # at most the gyro drift since the time of the fix's vertical
    levelled = ca.sqrt(tilt**2 + x.tilt_variance + turned + (p.gyro_bias_sigma * (DELAY * BLOCK_S)) ** 2)
    unknown = x.fixes == 0
    levelled, heading = select(unknown, 0.2, levelled), select(unknown, PI, minimum(heading, PI))
    return {
        "q_nb": frozen_frame.q_nb(x, x.q_n0i),
        "attitude_sigma": ca.vertcat(levelled, levelled, heading),
        "motion_heading_sigma": moved,
    }


def _q_n0n_before(x: Any, blocks: Any) -> Any:
    """Earth's rotation from the start until some blocks before the end of the last one, with the mean length of a block."""
    s, c = sin_cos(geodesy.OMEGA_IE * (x.time - blocks * x.time / x.blocks) / 2)
    return frozen_frame.q_n0n(ca.vertcat(c, s), x.axis_n)


def _pushed(buffer: Any, vector: Any) -> Any:
    """A buffer (rows, newest first) with a new vector (3x1) in and its oldest out."""
    return ca.vertcat(vector.T, buffer[:-1, :])


def _every(count: int, blocks: Any) -> Any:
    """Whether `blocks` is a multiple of `count`."""
    return blocks == count * ca.floor((blocks + 0.5) / count)


def filtered(taps: tuple[float, ...], buffer: Any) -> Any:
    """Output (3x1) of a symmetric filter for its last inputs (rows of `buffer`, newest first), one product per pair."""
    last = len(taps) - 1
    total = taps[last // 2] * buffer[last // 2, :]
    for k in range(last // 2):
        total = total + taps[k] * (buffer[k, :] + buffer[last - k, :])
    return total.T


def _unit(vector: Any) -> Any:
    return vector / (ca.sqrt(ca.sumsqr(vector)) + 1e-300)


MODEL = Model(
    id="inertial-fir",
    title="alignment in place by gravity in the inertial frame behind FIR low-passes, then levelling",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=OUTPUTS,
    steps={
        "begin": frozen_frame.levelling(lambda p: 0.0),  # the heading until the first fix
        "sample": Step(sample),
        "level": Step(level, when="level_due"),
        "block": Step(block, when="block_due"),
        "first": Step(first, when="first_due"),
        "second": Step(second, when="second_due"),
        "third": Step(third, when="third_due"),
        "end": Step(end, when="end_due"),
        "fix": Step(fix, when="fix_due"),
    },
    output=output,
    start=frozen_frame.start,
)

_SLOW = declared(
    "slow-motion",
    "after the low-pass filters the specific force still oscillates, as on a base that moves with periods above "
    "15 s: this makes the heading {ratio} times as uncertain as the gyro biases do, which its stated sigma "
    "counts; fusion models such motion",
)


def findings(parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Whether slow motion of the base makes the heading worse than the unit does."""
    by_gyros = float(parameters["gyro_bias_sigma"]) / (geodesy.OMEGA_IE * max(cos(float(parameters["latitude"])), 1e-9))
    return (Finding("motion_heading_sigma", _SLOW, max(by_gyros, LEAST_HEADING)),)


ESTIMATOR = Estimator(
    MODEL,
    kind="alignment",
    prepare=frozen_frame.prepare,
    needs=lambda parameters: SPAN * BLOCK_S,  # until the first fix
    applicability=applicability.notes,
    on_turntable=applicability.TURNED,
    findings=findings,
)
