"""Alignment on the move without a heading: every heading at once, by the velocity of GNSS.

Level is known, or is taken from the specific force; of the heading nothing is.  The filter navigates in a level frame l, whose
direction is arbitrary: l turned by psi about down is n.  If that were known, a velocity v of GNSS would be

    v^l = (c v_N + s v_E,  -s v_N + c v_E,  v_D),    c = cos psi,  s = sin psi

and a Kalman filter of 12 errors, of velocity, level and biases, would take it.  Its dynamics, its sensitivities and the noise
of v^l, which is the same in all directions, do not depend on psi:

    d(dv)/dt = f x phi + C_lb b_a,   d(phi)/dt = -C_lb b_g

with dv estimate minus truth, phi the misalignment of l, C_hat_lb = (I - [phi x]) C_lb, b what is still left in the
measurements.  So the filters of all headings have one covariance and one gain.  What they measure is affine in c and s, and
so is all that they find: errors e = e_0 + c e_c + s e_s, innovations, and the sum of their squares over their variances,

    J(psi) = (1, c, s) M (1, c, s)^T

minus twice the logarithm of the likelihood of psi.  Three vectors and a matrix M (3x3) are a bank of filters with one heading
each (Magill 1965), for every heading of the circle.  Noise counts for none of them: along a straight line J is flat.

The heading is where J is least, its variance 2 / J''.  It is known where every heading apart is `MARGIN` worse.  Turns,
changes of speed and waves show it; a straight line at constant speed does not.  The mean of what all headings find, weighted by
their likelihood, is taken out of the navigation state.

The gyros' drift about down turns l.  While J is flat, l is taken as it lies at each fix, and what J has gathered fades with
the drift; from then on the drift is one of the errors.  To first order alone: a heading that does not show within `SOON` is
looked for anew.  An unknown drift also turns a level error in l, or else that error and a bias would seem to be told apart; its
variance is added (`error_model.by_unknown_drift`).

Level is that of the start if it is known to `KNOWN_LEVEL`.  Otherwise it is that of the mean specific force between two fixes,
as soon as their velocities differ by so little that it is known as well.

Sources: Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE Trans. AC-10 (1965); sine and cosine of an
unknown azimuth: Rogers, "IMU in-motion alignment without benefit of attitude initialization", Navigation 44 (1997).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import atan2, exp, maximum, minimum, select, sin_cos
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import lever_arm, rows
from insenv.estimators.parts.error_model import bias_sigma, by_unknown_drift, variances
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA
from insenv.estimators.parts.kalman import innovation_variance, measure, propagate
from insenv.sensors.gnss import ARM, GNSS_STATED

N = 12
VELOCITY, TILT, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, N, 3))
"""Errors: velocity (m/s, l), phi (rad, l), biases (rad/s, m/s^2, b)."""
COVARIANCE_S = 1.0
"""s: longest step of the covariance."""
KNOWN_LEVEL = math.radians(8.0)
"""rad: level with which the filter starts; the errors are of first order in it."""
LEAST_LEVEL = math.radians(3.0)
"""rad: least standard deviation of a level by the specific force, whose mean is that of the body, not of the fixes."""
LEVELLING = 0.9
"""s: of specific force for a level."""
UNKNOWN_SPEED = 300.0
"""m/s"""
MARGIN = 40.0
"""Twice the logarithm of the likelihood by which another heading must be worse: it is e^20 times less likely."""
APART = math.radians(25.0)
"""rad: headings that differ by less are one answer."""
FLAT = 100.0
"""Difference of the largest and the least J up to which nothing is known of the heading."""
FADED = 0.2
"""rad: of drift by which what J has gathered while it is flat has faded."""
PLAUSIBLE = 4.0
"""Mean squared innovation over its variance of the best heading, of 1 if all is as stated, beyond which none is right."""
SOON = 12.0
"""s: in which a turn must show the heading; after it the filters, which the drift turns, are no linear ones, and begin anew."""
OUTLYING = 5.0
"""Standard deviations: an innovation that is larger counts as one of a measurement with so large an error."""
GRID, NEWTON = 24, 4
"""Headings that are compared, and steps to the best."""

PARAMETERS = (
    rows.chosen(rows.START_ATTITUDE, "start_roll", "start_pitch")
    + rows.chosen(rows.START_SIGMAS, "tilt_sigma")
    + rows.NOISES
    + rows.MOTION_ERRORS
    + rows.chosen(rows.START_BIASES, "start_gyro_bias", "start_accel_bias", "start_gyro_bias_error")
    + rows.chosen(GNSS_STATED, ARM.name, "antenna_lever_arm_sigma", "gnss_delay_sigma")
)
SINCE_PROPAGATION = Table((
    Row("since_propagation", "Time since the last step of the covariance", "s"),
    Row("since_propagation_velocity", "Integral of the specific force over it", "m/s", (3,), "l"),
    Row("since_propagation_C_lb", "Integral of the attitude over it", "s", (3, 3), "l"),
    Row("since_propagation_angle", "Sum of the delta angles in it", "rad", (3,), "b"),
    Row("since_propagation_change", "Change of velocity in it", "m/s", (3,), "l"),
))  # fmt: skip
LEVEL = Table((
    Row("level_begun", "1 from the first fix on, while the level is unknown"),
    Row("level_time", "Time since the fix with which levelling began", "s"),
    Row("level_velocity_n", "Velocity of that fix", "m/s", (3,), "n"),
    Row("level_force", "Integral of the specific force since then", "m/s", (3,), "l"),
))  # fmt: skip
STATE = (
    Table((
        Row("q_lb", "Attitude: takes b components to l components", "1", (4,), "l", (1, 0, 0, 0)),
        Row("velocity_l", "Velocity over the Earth", "m/s", (3,), "l"),
        Row("found", "Errors that the filters find: e_0, and by cosine and sine e_c and e_s", "SI", (N, 3)),
        Row("cost", "M: J is the quadratic form of (1, c, s)", "1", (3, 3)),
        Row("cost_count", "Number of its squares", "1"),
        *rows.chosen(rows.BIASES, "gyro_bias", "accel_bias"),
        Row("covariance", "Of the errors: upper triangle", "SI", (symmetric.triangle_size(N),)),
        Row("rate_n", "Rate of n in space", "rad/s", (3,), "n"),
        Row("pull_n", "Gravity less the Coriolis acceleration", "m/s^2", (3,), "n", (0, 0, geodesy.NOMINAL_GRAVITY)),
        Row("time", "Time since the start", "s"),
        Row("since_fix", "Time since the last fix that was used", "s"),
        Row("since_flat", "Time since nothing was known of the heading", "s"),
        Row("rate_b", "Angular rate of the last sample", "rad/s", (3,), "b"),
        Row("force", "Its specific force", "m/s^2", (3,), "l"),
        Row("dt", "Its interval", "s", start=0.01),
        Row("levelled", "1 when the level is known"),
        Row("covariance_due", "1 when the covariance is to be propagated"),
        Row("level_due", "1 when a fix may show the level"),
        Row("update_due", "1 when a fix is to be used"),
    ))
    + lever_arm.MEMORY
    + SINCE_PROPAGATION
    + LEVEL
)  # fmt: skip


def by_circle(vector_n: Any) -> Any:
    """A vector (3) of n in l (3x3): what is there without a heading, and by its cosine and sine."""
    north, east, down = vector_n[0], vector_n[1], vector_n[2]
    return ca.horzcat(ca.vertcat(0, 0, down), ca.vertcat(north, east, 0), ca.vertcat(east, -north, 0))


def start(p: Any) -> dict[str, Any]:
    """The stated level, if it is known well enough, and no velocity and heading."""
    return {
        "q_lb": attitude.from_euler(p.start_roll, p.start_pitch, 0),
        "gyro_bias": p.start_gyro_bias,
        "accel_bias": p.start_accel_bias,
        "levelled": select(p.tilt_sigma <= KNOWN_LEVEL, 1.0, 0.0),
        "covariance": _unknown(p, p.tilt_sigma),
    }


def _unknown(p: Any, tilt_sigma: Any) -> Any:
    """Covariance triangle of a level that is known to `tilt_sigma` (rad), and nothing else."""
    level = ca.vertcat(tilt_sigma, tilt_sigma, 0)
    biases = ca.repmat(bias_sigma(p), 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1)
    sigma = ca.vertcat(ca.repmat(UNKNOWN_SPEED, 3, 1), level, *biases)
    return symmetric.triangle(ca.diag(sigma * sigma))


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: navigation in l, without what only a heading shows (`covariance` adds it)."""
    turn, push = u.delta_angle - x.gyro_bias * u.dt, u.delta_velocity - x.accel_bias * u.dt
    C_lb = attitude.to_dcm(x.q_lb)
    felt = C_lb @ (push + ca.cross(turn, push) / 2)
    moved = attitude.multiply(x.q_lb, attitude.from_small_rotation_vector(turn))
    turned = attitude.from_small_rotation_vector(ca.vertcat(0, 0, -x.rate_n[2]) * u.dt)
    change = felt + ca.vertcat(0, 0, x.pull_n[2]) * u.dt
    rate, since = turn / u.dt, x.since_propagation + u.dt
    due = ca.logic_or(u.gnss_velocity_valid, since + u.dt / 2 > COVARIANCE_S)
    return {
        **lever_arm.followed(x, rate, u.dt, x.time == 0),
        "q_lb": attitude.renormalize(attitude.multiply(turned, moved)),
        "velocity_l": x.velocity_l + change,
        "time": x.time + u.dt,
        "since_fix": x.since_fix + u.dt,
        "rate_b": rate,
        "force": felt / u.dt,
        "dt": u.dt,
        "since_propagation": since,
        "since_propagation_velocity": x.since_propagation_velocity + felt,
        "since_propagation_C_lb": x.since_propagation_C_lb + C_lb * u.dt,
        "since_propagation_angle": x.since_propagation_angle + u.delta_angle,
        "since_propagation_change": x.since_propagation_change + change,
        "covariance_due": select(due, 1.0, 0.0),
        "level_time": x.level_time + u.dt,
        "level_force": x.level_force + felt,
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate covariance and errors over the samples since the last time.

    The horizontal parts of the rate of n and of the Coriolis acceleration are no part of the navigation: without them the error
    grows as if by them.
    """
    A, duration = ca.SX(N, N), x.since_propagation
    A[VELOCITY, TILT] = skew(x.since_propagation_velocity)
    A[VELOCITY, ACCEL] = x.since_propagation_C_lb
    A[TILT, GYRO] = -x.since_propagation_C_lb
    by_rotation, by_thrust = variances(p, x.since_propagation_angle, x.since_propagation_change)
    turned = by_unknown_drift(x.covariance, attitude.to_dcm(x.q_lb)[2, :].T, TILT, GYRO)
    noise = ca.vertcat(
        ca.repmat(p.velocity_random_walk**2 * duration + by_thrust, 3, 1),
        ca.repmat(p.angle_random_walk**2 * duration + by_rotation, 3, 1) + turned * duration,
        ca.SX.zeros(N - 6),
    )
    found = ca.SX(x.found)
    for i in range(N):  # as `propagate`
        found[i, :] += A[i, :] @ found
    found[VELOCITY, 1:] -= by_circle(x.pull_n)[:, 1:] * duration
    found[TILT, 1:] -= by_circle(x.rate_n)[:, 1:] * duration
    return {"covariance": propagate(x.covariance, A, noise), "found": found, **rows.at_start(SINCE_PROPAGATION)}


def measured(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """A velocity: it is for the level first."""
    return {"level_due": 1 - x.levelled, "update_due": x.levelled}


def level(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The level by the mean specific force since an earlier fix, unless the velocity has changed too much since then.

    An acceleration a tilts the mean force by atan(a / g), in a direction that only the heading shows.
    """
    duration = maximum(x.level_time, u.dt)
    gained = u.gnss_velocity_n[:2] - x.level_velocity_n[:2]
    tilt = maximum(atan2(ca.norm_2(gained) / duration, geodesy.NOMINAL_GRAVITY), LEAST_LEVEL)
    long = ca.logic_and(x.level_begun, x.level_time + u.dt / 2 > LEVELLING)
    known = ca.logic_and(long, tilt < KNOWN_LEVEL)
    anew = ca.logic_or(1 - x.level_begun, long)
    return {
        "q_lb": select(known, attitude.multiply(upright(x.level_force), x.q_lb), x.q_lb),
        "covariance": select(known, _unknown(p, tilt), x.covariance),
        "velocity_l": select(known, ca.SX.zeros(3), x.velocity_l),
        "found": select(known, ca.SX.zeros(N, 3), x.found),
        "levelled": known,
        "level_begun": 1.0,
        "level_time": select(anew, 0.0, x.level_time),
        "level_velocity_n": select(anew, u.gnss_velocity_n, x.level_velocity_n),
        "level_force": select(anew, ca.SX.zeros(3), x.level_force),
        "level_due": 0.0,
        "update_due": known,
    }


def upright(force: Any) -> Any:
    """The shortest turn (4) that takes the direction of a specific force to up."""
    down = -force / maximum(ca.norm_2(force), 1e-9)
    over = down[2] < -1 + 1e-9  # upside down: half a turn about any level axis
    q = ca.vertcat(1 + down[2], down[1], -down[0], 0)
    return attitude.normalize(select(over, ca.SX([0, 1, 0, 0]), q))


def update(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """A velocity is used, and the mean of what the filters find is taken out of the state."""
    C_lb = attitude.to_dcm(x.q_lb)
    change = lever_arm.angular_acceleration(x, x.rate_b, x.dt)
    rate = x.rate_b + change * (x.dt / 2)
    swing = C_lb @ lever_arm.then(rate, change, p.antenna_lever_arm, u.gnss_age)[1]
    acceleration = x.force + ca.vertcat(0, 0, x.pull_n[2])
    seen = -by_circle(u.gnss_velocity_n)
    seen[:, 0] += x.velocity_l - acceleration * u.gnss_age + swing
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    H[:, TILT] = skew(swing) - u.gnss_age * skew(x.force)
    H[:, GYRO] = C_lb @ lever_arm.by_rate(rate, p.antenna_lever_arm, u.gnss_age)[1]
    H[:, ACCEL] = -u.gnss_age * C_lb
    horizontal = (u.gnss_velocity_sigma[0] ** 2 + u.gnss_velocity_sigma[1] ** 2) / 2
    misplaced = skew(rate) @ ca.diag(p.antenna_lever_arm_sigma**2) @ skew(rate).T
    variance = ca.vertcat(horizontal, horizontal, u.gnss_velocity_sigma[2] ** 2)
    variance += ca.diag(C_lb @ misplaced @ C_lb.T) + (acceleration * p.gnss_delay_sigma) ** 2

    best = point(least(x.cost))
    stored, found, cost = x.covariance, ca.SX(x.found), ca.SX(x.cost)
    for i in range(3):
        left = seen[i, :] - H[i, :] @ found
        robust = maximum(variance[i], (left @ best) ** 2 / OUTLYING**2 - innovation_variance(stored, H[i, :], 0.0))
        weight = 1 / innovation_variance(stored, H[i, :], robust)
        stored, gain, _ = measure(stored, ca.SX.zeros(N), H[i, :], 1.0, robust, 1)
        found += gain @ left
        cost += left.T @ left * weight
    flat, fading = flatness(cost) < FLAT, exp(-x.since_fix * bias_sigma(p) / FADED)
    stored, found = _as_it_lies(flat, stored, found)
    since_flat = select(flat, 0.0, x.since_flat + x.since_fix)
    anew = since_flat > SOON
    stored = select(anew, _unknown(p, LEAST_LEVEL), _relevelled(x.covariance, stored, C_lb))
    found, fading = select(anew, ca.SX.zeros(N, 3), found), select(anew, 0.0, select(flat, fading, 1.0))
    correction = found @ moments(cost)[0]
    found[:, 0] -= correction
    earth_rate = geodesy.earth_rate_n(u.gnss_latitude)
    transport = geodesy.transport_rate_n(u.gnss_velocity_n, u.gnss_latitude, u.gnss_height)
    gravity = ca.vertcat(0, 0, geodesy.normal_gravity(sin_cos(u.gnss_latitude)[0], u.gnss_height))
    return {
        **lever_arm.lagged(u.gnss_age),
        "velocity_l": x.velocity_l - correction[VELOCITY],
        "q_lb": attitude.normalize(attitude.multiply(attitude.from_rotation_vector(correction[TILT]), x.q_lb)),
        "gyro_bias": x.gyro_bias + correction[GYRO],
        "accel_bias": x.accel_bias + correction[ACCEL],
        "found": found,
        "cost": cost * fading,
        "cost_count": (x.cost_count + 3) * fading,
        "covariance": stored,
        "rate_n": earth_rate + transport,
        "pull_n": gravity - ca.cross(2 * earth_rate + transport, u.gnss_velocity_n),
        "since_fix": 0.0,
        "since_flat": select(anew, 0.0, since_flat),
        "update_due": 0.0,
    }


def _as_it_lies(flat: Any, stored: Any, found: Any) -> tuple[Any, Any]:
    """Covariance triangle and errors, without those about down where nothing is known of the heading: l is taken as it lies."""
    about_down, kept = TILT.stop - 1, select(flat, 0.0, 1.0)
    stored, found = ca.SX(stored), ca.SX(found)
    for i in range(N):
        stored[symmetric.place(*sorted((i, about_down)))] *= kept
    found[about_down, :] *= kept
    return stored, found


def _unseen(stored: Any) -> Any:
    """Variance of g phi^2 / 2, which a level phi off takes from the vertical specific force, and which is no first order."""
    tilted = stored[symmetric.place(3, 3)] + stored[symmetric.place(4, 4)]
    return (geodesy.NOMINAL_GRAVITY * tilted) ** 2 / 2


def _relevelled(before: Any, after: Any, C_lb: Any) -> Any:
    """Covariance triangle after an update that showed the level.

    The vertical bias was estimated with the level as it was before: its error has changed by what the level took.
    """
    down_b = C_lb[2, :].T
    added = maximum(_unseen(before) - _unseen(after), 0.0) * (down_b @ down_b.T)
    stored = ca.SX(after)
    for j in range(3):
        for i in range(j + 1):
            stored[symmetric.place(ACCEL.start + i, ACCEL.start + j)] += added[i, j]
    return stored


# The likelihood of the headings.


def point(heading: Any) -> Any:
    """(1, c, s) of a heading (rad)."""
    sine, cosine = sin_cos(heading)
    return ca.vertcat(1, cosine, sine)


_ANGLES = [2 * math.pi * k / GRID for k in range(GRID)]
_POINTS = [ca.DM([1, math.cos(angle), math.sin(angle)]) for angle in _ANGLES]


def _costs(M: Any) -> list[Any]:
    return [ca.dot(each, M @ each) for each in _POINTS]


def flatness(M: Any) -> Any:
    """Difference of the largest and the least J."""
    costs = _costs(M)
    return reduce(maximum, costs) - reduce(minimum, costs)


def moments(M: Any) -> tuple[Any, Any]:
    """Mean (3) and covariance (3x3) of (1, c, s), weighted by the likelihood."""
    costs = _costs(M)
    lowest = reduce(minimum, costs)
    weights = [exp((lowest - cost) / 2) for cost in costs]
    total = sum(weights)
    mean = sum(weight * each for weight, each in zip(weights, _POINTS, strict=True)) / total
    square = sum(weight * each @ each.T for weight, each in zip(weights, _POINTS, strict=True)) / total
    return mean, square - mean @ mean.T


def least(M: Any) -> Any:
    """The heading (rad) of the least J."""
    costs = _costs(M)
    lowest, best = costs[0], ca.SX(_ANGLES[0])
    for angle, cost in zip(_ANGLES[1:], costs[1:], strict=True):
        lowest, best = minimum(lowest, cost), select(cost < lowest, angle, best)
    for _ in range(NEWTON):
        slope, bend, steepest = _derivatives(M, best)
        best = best - slope / maximum(bend, steepest)
    return best


def _derivatives(M: Any, heading: Any) -> tuple[Any, Any, Any]:
    """J' / 2, J'' / 2 and a least value for that, where a step goes downhill all the same."""
    _, c, s = ca.vertsplit(point(heading))
    at, along, back = ca.vertcat(1, c, s), ca.vertcat(0, -s, c), ca.vertcat(0, -c, -s)
    bend = ca.dot(along, M @ along)
    return ca.dot(at, M @ along), bend + ca.dot(at, M @ back), bend / 2 + 1e-9


@dataclass(frozen=True)
class Answer:
    """The state with the most likely heading, or the mean of all while none is known.

    q_nb (4), velocity_l, gyro_bias, accel_bias (3).  heading_sigma: rad; `LARGEST_HEADING_SIGMA` where none is known.
    P: covariance (12x12) of velocity and psi (rad), the rotation from the estimated to the true attitude, about axes of l that
    do not turn with the error of the heading, and of both biases.  C_nl (3x3): takes these axes to n.
    """

    q_nb: Any
    velocity_l: Any
    gyro_bias: Any
    accel_bias: Any
    heading_sigma: Any
    P: Any
    C_nl: Any


def answer(x: Any) -> Answer:
    """The most likely heading, and the rest of the state with it."""
    best = least(x.cost)
    at = point(best)
    along = ca.vertcat(0, -at[2], at[1])
    _, bend, steepest = _derivatives(x.cost, best)
    lowest, other = ca.dot(at, x.cost @ at), ca.SX(1e30)
    for angle, cost in zip(_ANGLES, _costs(x.cost), strict=True):
        apart = math.cos(angle) * at[1] + math.sin(angle) * at[2] < math.cos(APART)
        other = minimum(other, select(apart, cost, 1e30))
    plausible = lowest < PLAUSIBLE * x.cost_count
    known = ca.logic_and(ca.logic_and(x.levelled, other > lowest + MARGIN), plausible)

    P = symmetric.full(x.covariance, N)
    mean, apart_by = moments(x.cost)
    moved = x.found @ select(known, at, mean)
    velocity = x.velocity_l - moved[VELOCITY]
    # the error of the heading, as an error of psi and of what is found with it
    by_heading = x.found @ along
    by_heading[0], by_heading[1] = by_heading[0] + velocity[1], by_heading[1] - velocity[0]
    by_heading[TILT.stop - 1] += 1
    variance = 1 / maximum(bend, steepest)
    outside = P + select(known, variance * (by_heading @ by_heading.T), x.found @ apart_by @ x.found.T)
    down_b = attitude.to_dcm(x.q_lb)[2, :].T
    outside[ACCEL, ACCEL] += _unseen(x.covariance) * (down_b @ down_b.T)
    heading = attitude.from_euler(0, 0, best)
    corrected = attitude.multiply(attitude.from_rotation_vector(moved[TILT]), x.q_lb)
    about_down = TILT.stop - 1
    return Answer(
        q_nb=attitude.normalize(attitude.multiply(heading, corrected)),
        velocity_l=velocity,
        gyro_bias=x.gyro_bias + moved[GYRO],
        accel_bias=x.accel_bias + moved[ACCEL],
        heading_sigma=select(known, ca.sqrt(outside[about_down, about_down]), LARGEST_HEADING_SIGMA),
        P=outside,
        C_nl=attitude.to_dcm(heading),
    )


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now, and its stated accuracy."""
    result = answer(x)
    level = result.C_nl @ result.P[TILT, TILT] @ result.C_nl.T
    tilt = ca.sqrt(ca.diag(level)[:2])
    return {
        "q_nb": result.q_nb,
        "attitude_sigma": ca.vertcat(select(x.levelled, tilt, ca.repmat(LARGEST_HEADING_SIGMA, 2, 1)), result.heading_sigma),
    }


MODEL = Model(
    id="every-heading",
    title="alignment on the move by the velocity of GNSS, for every heading at once",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS + rows.FIX_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={
        "sample": Step(sample),
        "covariance": Step(covariance, when="covariance_due"),
        "measured": Step(measured, when="gnss_velocity_valid"),
        "level": Step(level, when="level_due"),
        "update": Step(update, when="update_due"),
    },
    output=output,
    start=start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known."""
    return dict(known.rows_of(PARAMETERS))
