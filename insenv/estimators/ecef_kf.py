"""`ecef-kf`: fine alignment in the Earth frame, a 12-state Kalman filter on the velocity of a vehicle in place.

Source: the ECEF fine-alignment paper (numbers of its equations), with the two-sample quaternion recursion (28)-(34) of
`insenv.estimators.parts.strapdown`. The first sample of a pair is held; outputs between the two samples are rotated on
by it.

States: velocity error (m/s, e), misalignment phi (rad, e), accelerometer bias (m/s^2, b), gyro bias (rad/s, b). Errors
are estimate minus truth, C_hat_eb = (I - [phi x]) C_eb; the biases are those still left in the measurements:

    d(dv)/dt  = -2 omega_ie x dv + f^e x phi + C_eb b_a          (12)
    d(phi)/dt = -omega_ie x phi - C_eb b_g                       (22)
    d(b)/dt   = -b / time + white noise (0 in the paper)         (25)

Correction to the paper: its observation z = -v_ins with H = [I 0 0 0] (26) contradicts the sign of its (8) and (12).
With dv = estimate minus truth, z is +v_ins (minus the velocity known from outside).

Start: from a coarse alignment by the q-method over the first `coarse_time` seconds (any attitude, any sway), or for longer
while motion of the base leaves it uncertain of heading, with the accuracy that it states and the correlation of its errors
with the biases; or, with `coarse_time` = 0, from the stated attitude. On a moving base always from the stated attitude.

Observation: the mean velocity over a window, which is zero (or the velocity itself, against that of a fix). Attitude,
velocity and biases are fed back at the end of a window only, so over T the mean error is H x with H = [I, -T/2 [f x],
-T/2 C_eb, 0] of the state at its end. A parked vehicle has windows of `update_interval` and a velocity of zero within
`velocity_sigma`. On a swaying base the velocity in excess of its prediction (`excess`, learnt as the filter runs) is
not white: the mean of a sway that stays in place falls as 1/T, so the windows are then `sway_interval` long, and the
sway counts with 2 (sway_time / T)^2 of its variance. After the coarse alignment the windows are long until the scatter
of the velocity about a straight line, which tilts and biases do not cause, shows that there is no sway. With a given
attitude (`coarse_time` = 0) a sway that starts gently may be taken for tilt: set `sway_sigma` where it is expected.

Jacobians: in place, the horizontal accelerometer biases cannot be separated from tilts, nor the east gyro's bias from
heading. Matrices that follow each correction would pretend that they can. So f^e is minus gravity, and C_eb is taken at
the heading of the start.

Moving base (`moving` = 1): the velocity of GNSS fixes in place of zero, used at its own time and corrected for the
lever arm; latitude, longitude and height are those of the fixes, propagated by the filter's velocity between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select, sin_cos
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import q_method
from insenv.estimators.contract import Estimator
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import applicability, inertial_vectors, lever_arm, rows
from insenv.estimators.parts.error_model import Aligned, aligned
from insenv.estimators.parts.kalman import decays, driven_variance, measure, propagate
from insenv.estimators.parts.strapdown import turned, velocity_change

COARSE = q_method.MODEL
AXIS_E = ca.SX([0, 0, geodesy.OMEGA_IE])  # rad/s
GATE = 3.0  # a velocity beyond this many standard deviations counts as sway at once
SWAYING = 5.0  # sway of this many times velocity_sigma selects the long windows
COARSE_TIME = 120.0  # s: the q-method's filters have settled after 80
COARSE_HEADING = 0.175  # rad: the coarse alignment goes on while motion of the base leaves more: the filter is of first order
COARSE_MORE = 5.0  # s: until it is asked again
UNKNOWN_VELOCITY = 1.0  # m/s: that of a sway, after the coarse alignment
LINE = 2.0  # a straight line takes up to half of the variance of a slow sway's velocity

N = 12
VELOCITY, TILT, ACCEL, GYRO = (slice(i, i + 3) for i in range(0, N, 3))


def _new(table: Table, others: Table) -> Table:
    """`table`, and those rows of `others` that have other names."""
    return table + Table(tuple(row for row in others if row.name not in table))


PARAMETERS = _new(
    rows.PLACE + rows.START_ATTITUDE + rows.START_VELOCITY
    + rows.chosen(rows.START_SIGMAS, "tilt_sigma", "heading_sigma", tilt_sigma=0.01, heading_sigma=0.05)
    + Table((
        Row("coarse_time", "Shortest duration of the coarse alignment; 0: start from the given attitude", "s", lower=0),
        Row("moving", "0: the velocity is known to be zero; 1: it is that of the fixes", lower=0, upper=1, flag=True),
        Row("velocity_sigma", "Standard deviation of the velocity from zero", "m/s", start=3e-4, lower=1e-9, upper=1e3),
        Row("velocity_sigma_start", "Standard deviation of the velocity at the start", "m/s", start=0.1, lower=1e-9, upper=1e3),
        Row("sway_sigma", "Standard deviation of an expected sway's velocity; detected sway is added", "m/s", lower=0),
        Row("sway_time", "Displacement of a sway over its velocity: a period over 2 pi", "s", start=1.5, lower=0, upper=1e3),
        Row("sway_interval", "Time between observations on a swaying base", "s", start=10.0, lower=0, upper=60.0),
        Row("learning_time", "Time over which the variance of sway is learnt", "s", start=60.0, lower=0.1, upper=1e6),
        Row("update_interval", "Time between observations; 0: every two samples", "s", start=0.1, lower=0, upper=1.0),
    )) + rows.chosen(
        rows.SENSORS, "angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma",
        "gyro_correlation_time", "accel_correlation_time", angle_random_walk=1e-6, velocity_random_walk=1e-4,
        gyro_bias_sigma=1e-7, accel_bias_sigma=1e-3, gyro_correlation_time=1e9, accel_correlation_time=1e9,
    ) + rows.LEVER_ARM,
    COARSE.parameters,
)  # fmt: skip

INPUTS = rows.SAMPLE_INPUTS + rows.chosen(
    rows.FIX_INPUTS, *[name for name in rows.FIX_INPUTS.names if name != "gnss_position_sigma"]
) + rows.STANDING_INPUT  # fmt: skip

WINDOW = Table((
    Row("window", "Time since the last observation", "s"),
    Row("window_moment_e", "Integral of velocity times the time in the window", "m s", (3,), "e"),
    Row("window_square", "Integral of the square of velocity", "m^2/s", (3,), "e"),
    Row("window_force_e", "Integral of specific force over it", "m/s", (3,), "e"),
    Row("window_velocity_e", "Integral of velocity over it", "m", (3,), "e"),
    Row("window_C_eb", "Integral of the attitude matrix over it", "s", (3, 3), "e"),
))  # fmt: skip

STATE = _new(Table((
    Row("q_eb", "Attitude after the last pair: takes b components to e components", "1", (4,), "e", (1, 0, 0, 0)),
    Row("velocity_e", "Velocity over the Earth after the last pair", "m/s", (3,), "e"),
    rows.BIASES["accel_bias"],
    rows.BIASES["gyro_bias"],
    Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
    Row("place", "Latitude, longitude, height", "rad, rad, m", (3,)),
    Row("gravity_e", "Gravity there", "m/s^2", (3,), "e"),
    Row("coarse", "1 during the coarse alignment"),
    Row("coarse_spent", "Time since its start", "s"),
    Row("coarse_over", "1 at its last sample"),
    Row("held_delta_angle", "Delta angle of a pair's first sample", "rad", (3,), "b"),
    Row("held_delta_velocity", "Its delta velocity", "m/s", (3,), "b"),
    Row("held_dt", "Its interval", "s"),
    Row("holding", "1 when a first sample waits for its second"),
    Row("pair_due", "1 when the sample completes a pair"),
    *WINDOW,
    Row("acceleration_e", "Acceleration in the last pair", "m/s^2", (3,), "e"),
    Row("rate_b", "Angular rate at its end, relative to e", "rad/s", (3,), "b"),
    Row("rate_change_b", "Angular acceleration there", "rad/s^2", (3,), "b"),
    Row("pairs", "Number of pairs so far"),
    *lever_arm.MEMORY,
    Row("filter_due", "1 when the filter is to run"),
    Row("fix_waiting", "1 when a fix waits for the filter"),
    Row("fix_age", "Its age when the filter runs", "s"),
    Row("fix_velocity_n", "Its velocity", "m/s", (3,), "n"),
    Row("fix_sigma", "Standard deviation of that velocity (root mean square of the components)", "m/s"),
    Row("carry_due", "1 when the place is to be propagated"),
    Row("misalignment_e", "Rotation that feedback has removed since the start of the filter", "rad", (3,), "e"),
    Row("excess", "Learnt variance of the velocity from zero", "m^2/s^2", (3,), "e"),
    Row("observing", "Time of all observations", "s"),
    Row("swaying", "1 when sway is detected"),
    Row("innovation", "Last innovation of velocity", "m/s", (3,), "e"),
)), COARSE.state)  # fmt: skip

ESTIMATES = ("misalignment_e", "gyro_bias", "accel_bias", "innovation")
"""State rows that are outputs."""


def outputs(state: Table) -> Table:
    """Output rows of a filter with these state rows."""
    covariance = Row("attitude_covariance", "Covariance of the attitude error", "rad^2", (3, 3), "n")
    return rows.ALIGNMENT + Table((covariance,)) + rows.chosen(state, *ESTIMATES)


def transition(duration: Any, delta_velocity_e: Any, C_integral: Any) -> Any:
    """A (12x12) = integral of F over an interval, (12) and (22).

    duration: s. delta_velocity_e: integral of the specific force (3, m/s, e). C_integral: integral of C_eb (3x3, s).
    """
    A = ca.SX(N, N)
    turn = ca.sparsify(skew(AXIS_E)) * duration
    A[VELOCITY, VELOCITY] = -2 * turn
    A[VELOCITY, TILT] = skew(delta_velocity_e)
    A[VELOCITY, ACCEL] = C_integral
    A[TILT, TILT] = -turn
    A[TILT, GYRO] = -C_integral
    return A


def observation(A: Any, lag: Any) -> Any:
    """H (3x12) of the mean velocity error over a window, for the state at its end: I - lag A, with A of the window.

    lag: 1/2 for the mean (the velocity error grows evenly), 0 for the velocity at the end.
    """
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    H[:, TILT] = -lag * A[VELOCITY, TILT]
    H[:, ACCEL] = -lag * A[VELOCITY, ACCEL]
    return H


def start(p: Any) -> dict[str, Any]:
    """The stated attitude, its covariance, and the place."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    coarse = (p.coarse_time > 0) * (1 - p.moving)
    return {
        **q_method.start(p),
        "place": ca.vertcat(p.latitude, p.longitude, p.height),
        "gravity_e": geodesy.normal_gravity_e(geodesy.C_en(p.latitude, p.longitude), p.height),
        "coarse": coarse,
        "swaying": ca.logic_or(p.sway_sigma > 0, coarse),
        "velocity_e": attitude.rotate(q_en, p.start_velocity_n),
        **start_attitude(p, q_en),
    }


def start_attitude(p: Any, q_en: Any) -> dict[str, Any]:
    """State rows of a filter that starts with the stated attitude, where n has attitude q_en."""
    tilt = ca.diag(ca.vertcat(p.tilt_sigma, p.tilt_sigma, p.heading_sigma) ** 2)
    q_nb = attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading)
    return _filter_start(p, q_en, q_nb, Aligned(tilt, ca.SX(3, 3), ca.SX(3, 3)), p.velocity_sigma_start)


def _filter_start(p: Any, q_en: Any, q_nb: Any, known: Aligned, velocity_sigma: Any) -> dict[str, Any]:
    """State rows of a filter that starts with attitude q_nb, known to `known`, where n has attitude q_en."""
    C_en, C_nb = attitude.to_dcm(q_en), attitude.to_dcm(q_nb)
    P = ca.SX(N, N)
    P[VELOCITY, VELOCITY] = ca.SX.eye(3) * velocity_sigma**2
    P[TILT, TILT] = C_en @ known.tilt @ C_en.T
    P[ACCEL, ACCEL] = ca.SX.eye(3) * p.accel_bias_sigma**2
    P[GYRO, GYRO] = ca.SX.eye(3) * p.gyro_bias_sigma**2
    for part, with_tilt in ((ACCEL, known.tilt_accel), (GYRO, known.tilt_gyro)):
        P[TILT, part] = C_en @ with_tilt @ C_nb
        P[part, TILT] = P[TILT, part].T
    return {"q_eb": attitude.normalize(attitude.multiply(q_en, q_nb)), "covariance": symmetric.triangle(P)}


def coarse(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One sample of the coarse alignment."""
    spent = x.coarse_spent + u.dt
    over = select(spent + u.dt / 2 > p.coarse_time, 1.0, 0.0)
    return {**q_method.sample(p, x, u), "coarse_spent": spent, "coarse_over": over}


def begin(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Start the filter from the result of the coarse alignment."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    rough = q_method.output(p, x)
    gravity = ca.sqrt(ca.sumsqr(x.gravity_e))
    known = aligned(rough["attitude_sigma"], p.latitude, gravity, p.gyro_bias_sigma, p.accel_bias_sigma)
    variance = rough["attitude_sigma"][2] ** 2
    by_sensors = q_method.sensor_variance(p, x)[2]  # less a longer alignment does not reach
    uncertain = ca.logic_and(variance > COARSE_HEADING**2, variance > 4.0 * by_sensors)
    return {
        **_filter_start(p, q_en, rough["q_nb"], known, UNKNOWN_VELOCITY),
        "velocity_e": ca.SX.zeros(3),
        "coarse": uncertain,
        "coarse_spent": x.coarse_spent - uncertain * COARSE_MORE,
        **dict.fromkeys(("coarse_over", "holding", "pair_due"), 0),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: held, if it is the first of a pair."""
    aligning, first = 1 - x.coarse, 1 - x.holding
    return {
        "held_delta_angle": select(first, u.delta_angle, x.held_delta_angle),
        "held_delta_velocity": select(first, u.delta_velocity, x.held_delta_velocity),
        "held_dt": select(first, u.dt, x.held_dt),
        "holding": first * aligning,
        "pair_due": x.holding * aligning,
        "filter_due": 0,
    }


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Hold a fix until the end of its pair."""
    use = p.moving * u.gnss_velocity_valid
    return {
        **lever_arm.lagged(u.gnss_age),
        "place": select(p.moving, ca.vertcat(u.gnss_latitude, u.gnss_longitude, u.gnss_height), x.place),
        "fix_waiting": use,
        "fix_age": u.gnss_age + x.holding * u.dt,
        "fix_velocity_n": u.gnss_velocity_n,
        "fix_sigma": ca.sqrt(ca.sumsqr(u.gnss_velocity_sigma) / 3),
    }


def pair(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Attitude and velocity over two samples."""
    duration = x.held_dt + u.dt
    C_eb = attitude.to_dcm(x.q_eb)
    drift = C_eb.T @ AXIS_E + x.gyro_bias  # (28), (29): one C_eb for both samples
    first, second = x.held_delta_angle - drift * x.held_dt, u.delta_angle - drift * u.dt
    velocities = x.held_delta_velocity - x.accel_bias * x.held_dt, u.delta_velocity - x.accel_bias * u.dt
    felt = C_eb @ velocity_change(first, second, *velocities)
    middle = x.velocity_e + (felt + x.gravity_e * duration) / 2
    change = felt + (x.gravity_e - 2 * ca.cross(AXIS_E, middle)) * duration
    middle_velocity = x.velocity_e + change / 2
    window = x.window + duration
    interval = select(x.swaying * (1 - p.moving), p.sway_interval, p.update_interval)
    due = select(ca.logic_or(window + duration / 2 > interval, x.fix_waiting), 1.0, 0.0)
    rate = (first + second) / duration
    followed = lever_arm.followed(x, rate, duration, x.pairs == 0)
    mean = SimpleNamespace(rate_lag=x.rate_lag, **followed)
    rate_change = lever_arm.angular_acceleration(mean, rate, duration)
    return {
        **followed,
        "pairs": x.pairs + 1,
        "q_eb": attitude.renormalize(turned(x.q_eb, first, second)),
        "velocity_e": x.velocity_e + change,
        "window": window,
        "window_velocity_e": x.window_velocity_e + middle_velocity * duration,
        "window_moment_e": x.window_moment_e + middle_velocity * (duration * (x.window + duration / 2)),
        "window_square": x.window_square + middle_velocity**2 * duration,
        "window_force_e": x.window_force_e + felt,
        "window_C_eb": x.window_C_eb + C_eb * duration,
        "acceleration_e": change / duration,
        "rate_b": rate + rate_change * (duration / 2),
        "rate_change_b": rate_change,
        "filter_due": due,
        "carry_due": due * p.moving,
    }


def carry(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the place by the velocity since the last time."""
    latitude, longitude, height = ca.vertsplit(x.place)
    sine, cosine = sin_cos(latitude)
    meridian, normal = geodesy.radii(sine)
    moved = attitude.rotate_inverse(geodesy.q_ew_from_geodetic(latitude, longitude, 0), x.velocity_e) * x.window
    east = moved[1] / ((normal + height) * maximum(cosine, 1e-6))
    place = ca.vertcat(latitude + moved[0] / (meridian + height), longitude + east, height - moved[2])
    return {"place": place, "gravity_e": geodesy.normal_gravity_e(geodesy.C_en(place[0], place[1]), place[2])}


def observe_window(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance over the window since the last observation, then observe and feed back."""
    gyro_decay, accel_decay = decays(p, x.window)
    noise = ca.vertcat(
        ca.repmat(p.velocity_random_walk**2 * x.window, 3, 1),
        ca.repmat(p.angle_random_walk**2 * x.window, 3, 1),
        ca.repmat(driven_variance(p.accel_bias_sigma, accel_decay), 3, 1),
        ca.repmat(driven_variance(p.gyro_bias_sigma, gyro_decay), 3, 1),
    )
    # Jacobians at the heading of the start, and in place with the known specific force: see the docstring of the module
    down = x.gravity_e / ca.sqrt(ca.sumsqr(x.gravity_e))
    back = attitude.to_dcm(attitude.from_small_rotation_vector(-ca.dot(down, x.misalignment_e) * down))
    moving = p.moving * (1 - u.standing)
    felt = select(moving, back @ x.window_force_e, -x.gravity_e * x.window)
    A = transition(x.window, felt, back @ x.window_C_eb)
    # exactly, where `transition` has a bias that stays
    A[ACCEL, ACCEL], A[GYRO, GYRO] = (accel_decay - 1) * ca.SX.eye(3), (gyro_decay - 1) * ca.SX.eye(3)
    carried = SimpleNamespace(**{**vars(x), "accel_bias": accel_decay * x.accel_bias, "gyro_bias": gyro_decay * x.gyro_bias})
    return observed(p, carried, moving, propagate(x.covariance, A, noise), A)


def observed(p: Any, x: Any, moving: Any, stored: Any, A: Any) -> dict[str, Any]:
    """State rows after the observation, component by component in e, at the end of a window.

    moving: 1 for the velocity of a fix, 0 for zero velocity. stored (78), A (12x12): covariance now, transition of the
    window.
    """
    predicted = ca.vertcat(*[stored[symmetric.place(i, i)] for i in range(3)])
    floor, time = p.velocity_sigma**2, x.observing + x.window
    beyond = maximum(x.velocity_e**2 - GATE**2 * (predicted + floor), 0.0)
    beyond = select(x.swaying, LINE * scatter(x), beyond)
    excess = x.excess + (beyond - x.excess) * (x.window / minimum(time, p.learning_time))
    sway = p.sway_sigma**2 + ca.sum1(maximum(excess, beyond))  # sway in one direction counts in all
    variance = floor + sway * minimum(2 * (p.sway_time / x.window) ** 2, 1.0) + (p.velocity_random_walk**2 / 3) * x.window
    variance = select(moving, ca.repmat(x.fix_sigma**2, 3, 1), variance)
    fix_innovation, fix_H = fix_observation(p, x)
    innovation = select(moving, fix_innovation, x.window_velocity_e / x.window)
    accept, correction = select(moving, x.fix_waiting, 1.0), ca.SX.zeros(N)
    H = select(moving, fix_H, observation(A, 0.5))
    for i in range(3):
        stored, correction, _ = measure(stored, correction, H[i, :], innovation[i], variance[i], accept)
    return {
        **corrected(x, correction),
        "covariance": stored,
        "excess": excess,
        "swaying": select(sway > SWAYING**2 * floor, 1.0, 0.0),
        "observing": time,
        "innovation": innovation,
        "fix_waiting": 0,
        **rows.at_start(WINDOW),
    }


def scatter(x: Any) -> Any:
    """Variance (3, m^2/s^2, e) of the velocity in the window about a straight line."""
    mean = x.window_velocity_e / x.window
    slope = (x.window_moment_e / x.window - mean * (x.window / 2)) * (12 / x.window**2)
    return maximum(x.window_square / x.window - mean**2 - slope**2 * (x.window**2 / 12), 0.0)


def fix_observation(p: Any, x: Any) -> tuple[Any, Any]:
    """Innovation (3, m/s, e) of the velocity of a fix, at its antenna and time, and its sensitivity (3x12)."""
    q_en = geodesy.q_ew_from_geodetic(x.place[0], x.place[1], 0)
    C_eb = attitude.to_dcm(x.q_eb)
    swing = C_eb @ lever_arm.then(x.rate_b, x.rate_change_b, p.antenna_lever_arm, x.fix_age)[1]
    innovation = x.velocity_e - x.acceleration_e * x.fix_age + swing - attitude.rotate(q_en, x.fix_velocity_n)
    force = x.acceleration_e - x.gravity_e
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    H[:, TILT] = skew(swing) - x.fix_age * skew(force)
    H[:, ACCEL] = -x.fix_age * C_eb
    H[:, GYRO] = C_eb @ lever_arm.by_rate(x.rate_b, p.antenna_lever_arm, x.fix_age)[1]
    return innovation, H


def corrected(x: Any, correction: Any) -> dict[str, Any]:
    """State rows with an estimated error state (12) taken out."""
    phi = correction[TILT]
    return {
        "velocity_e": x.velocity_e - correction[VELOCITY],
        "q_eb": attitude.normalize(attitude.multiply(attitude.from_small_rotation_vector(phi), x.q_eb)),
        "accel_bias": x.accel_bias + correction[ACCEL],
        "gyro_bias": x.gyro_bias + correction[GYRO],
        "misalignment_e": x.misalignment_e + phi,
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now and its covariance; during the coarse alignment those of the q-method."""
    rough = q_method.output(p, x)
    q_en = geodesy.q_ew_from_geodetic(x.place[0], x.place[1], 0)
    # a held sample rotates the attitude on
    ahead = x.held_delta_angle - (attitude.rotate_inverse(x.q_eb, AXIS_E) + x.gyro_bias) * x.held_dt
    q_eb = attitude.multiply(x.q_eb, attitude.from_small_rotation_vector(x.holding * ahead))
    fine = attitude.normalize(attitude.multiply(attitude.conjugate(q_en), q_eb))
    covariance = select(x.coarse, ca.diag(rough["attitude_sigma"] ** 2), covariance_n(x, q_en))
    return {
        "q_nb": select(x.coarse, rough["q_nb"], fine),
        "attitude_sigma": ca.sqrt(ca.diag(covariance)),
        "attitude_covariance": covariance,
        **rows.values_of(x, ESTIMATES),
    }


def covariance_n(x: Any, q_en: Any) -> Any:
    """Covariance of the misalignment about n (3x3, rad^2), where n has attitude q_en."""
    C_en = attitude.to_dcm(q_en)
    return C_en.T @ symmetric.full(x.covariance, N)[TILT, TILT] @ C_en


MODEL = Model(
    id="ecef-kf",
    title="fine alignment in the Earth frame, 12-state filter on zero velocity",
    parameters=PARAMETERS,
    state=STATE,
    inputs=INPUTS,
    outputs=outputs(STATE),
    steps={
        "sample": Step(sample),
        "coarse": Step(coarse, when="coarse"),
        **{name: step for name, step in COARSE.steps.items() if name != "sample"},
        "begin": Step(begin, when="coarse_over"),
        "fix": Step(fix, when="gnss_valid"),
        "pair": Step(pair, when="pair_due"),
        "carry": Step(carry, when="carry_due"),
        "filter": Step(observe_window, when="filter_due"),
    },
    output=output,
    start=start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known, with a coarse alignment."""
    values = {**known.rows_of(PARAMETERS), **inertial_vectors.prepare(known)}
    del values["velocity_sigma"]  # the row of that name is about a velocity of zero
    return values | {"coarse_time": COARSE_TIME, "velocity_sigma_start": float(known.velocity_sigma.max())}


def needs(parameters: Mapping[str, Any]) -> float:
    """Time (s) of data: that of the coarse alignment, whose result the filter takes in place."""
    return float(parameters["coarse_time"]) * (1.0 - float(parameters["moving"]))


ESTIMATOR = Estimator(
    MODEL,
    kind="alignment",
    moving_row="moving",
    fix_velocity=True,
    prepare=prepare,
    needs=needs,
    applicability=applicability.notes,
    on_turntable=applicability.TURNED,
)
