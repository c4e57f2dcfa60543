"""`ecef-kf`: fine alignment in the Earth frame, a 12-state Kalman filter on the velocity of a vehicle in place, with feedback.

Source: the ECEF fine-alignment paper: error model and observation (12), (22), (25), (26) (`insenv.estimators.ecef_model`),
two-sample quaternion recursion (28)-(34) (`insenv.estimators.parts.two_sample`); attitude, velocity and biases are fed back.
The first sample of a pair is held; outputs in between are turned on by it.

Start: from the attitude told, or, where none good enough for a linear filter is known, from a coarse alignment of its own, the
q-method over the first `coarse_time` seconds (any attitude, any sway).

Observation: the mean velocity over a window, which is zero (or the velocity itself, seen by a fix).  Feedback comes at a
window's end only, so over T the mean error is H x with H = [I, -T/2 [f x], -T/2 C_eb, 0] of the state at its end.  A parked
vehicle has windows of `update_interval` and keeps zero within `velocity_sigma`.  On a swaying base the velocity beyond its
own prediction (`excess`, learnt as it goes) is not white: the mean of a sway that stays in place falls as 1/T, so the windows
are then of `sway_interval`, and the sway counts as 2 (sway_time / T)^2 of its variance.  A sway too gentle to be seen at the
start may be taken for tilt: where sway is expected, say so by `sway_sigma`.

Jacobians: in place the horizontal biases and the tilts that go with them cannot be told apart, nor can the east gyro's bias and
heading.  Matrices that follow each correction would pretend that they can.  So f^e is minus gravity, and C_eb is taken about
the heading of the start.

Moving base (`moving` = 1): the velocity of GNSS fixes in place of zero, fused at its own time, lever arm taken off; latitude,
longitude and height are those of the fixes, carried on by the filter's velocity in between.
"""

from __future__ import annotations

from math import hypot
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select, sin_cos
from insenv.core.model import Model, Step
from insenv.estimators import q_method
from insenv.estimators.contract import Estimator, Knowledge
from insenv.estimators.ecef_model import ACCEL, GYRO, TILT, VELOCITY, N, observation, observe, propagate, transition
from insenv.estimators.ecef_tables import INPUTS, OUTPUTS, PARAMETERS, STATE
from insenv.estimators.parts import applicability, inertial_vectors, two_sample

COARSE = q_method.MODEL
_COARSE_START = COARSE.start or (lambda p: {})
AXIS_E = ca.SX([0, 0, geodesy.OMEGA_IE])  # rad/s
LARGE_TILT, LARGE_HEADING = 0.05, 0.1  # rad: a start attitude told no better than this is not used
GATE = 3.0  # a velocity beyond so many standard deviations is sway at once
SWAYING = 5.0  # a velocity of so many times its sigma asks for long windows
COARSE_TIME = 120.0  # s: the q-method's filters have settled in 80
COARSE_TILT, COARSE_HEADING = 0.0005, 0.005  # rad: what sway leaves of it


def start(p: Any) -> dict[str, Any]:
    """Attitude and covariance as told, and the place."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    return {
        **_COARSE_START(p),
        "place": ca.vertcat(p.latitude, p.longitude, p.height),
        "gravity_e": _gravity_e(p.latitude, p.longitude, p.height),
        "coarse": select(p.coarse_time > 0, 1.0, 0.0),
        "swaying": select(p.sway_sigma > 0, 1.0, 0.0),
        **_filter_start(p, q_en, attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading)),
    }


def _filter_start(p: Any, q_en: Any, q_nb: Any) -> dict[str, Any]:
    """Rows of a filter that starts with attitude q_nb where n has attitude q_en."""
    C_en = attitude.to_dcm(q_en)
    P = ca.SX(N, N)
    P[VELOCITY, VELOCITY] = ca.SX.eye(3) * p.velocity_sigma_start**2
    P[TILT, TILT] = C_en @ ca.diag(ca.vertcat(p.tilt_sigma, p.tilt_sigma, p.heading_sigma) ** 2) @ C_en.T
    P[ACCEL, ACCEL] = ca.SX.eye(3) * p.accel_bias_sigma**2
    P[GYRO, GYRO] = ca.SX.eye(3) * p.gyro_bias_sigma**2
    return {
        "q_eb": attitude.normalize(attitude.multiply(q_en, q_nb)),
        "velocity_e": C_en @ p.start_velocity_n,
        "covariance": symmetric.triangle(P),
    }


def coarse(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One sample of the coarse alignment."""
    spent = x.coarse_spent + u.dt
    over = select(spent + u.dt / 2 > p.coarse_time, 1.0, 0.0)
    return {**COARSE.steps["sample"].function(p, x, u), "coarse_spent": spent, "coarse_over": over}


def begin(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The filter starts where the coarse alignment ends."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    return {**_filter_start(p, q_en, COARSE.output(p, x)["q_nb"]), "coarse": 0, "coarse_over": 0, "holding": 0, "pair_due": 0}


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: held, if it is a pair's first."""
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
    """A fix waits for the end of its pair."""
    use = p.moving * u.gnss_velocity_valid
    return {
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
    felt = C_eb @ two_sample.velocity_change(first, second, *velocities)
    middle = x.velocity_e + (felt + x.gravity_e * duration) / 2
    change = felt + (x.gravity_e - 2 * ca.cross(AXIS_E, middle)) * duration
    window = x.window + duration
    interval = select(x.swaying * (1 - p.moving), p.sway_interval, p.update_interval)
    due = select(ca.logic_or(window + duration / 2 > interval, x.fix_waiting), 1.0, 0.0)
    return {
        "q_eb": attitude.renormalize(two_sample.turned(x.q_eb, first, second)),
        "velocity_e": x.velocity_e + change,
        "window": window,
        "window_velocity_e": x.window_velocity_e + (x.velocity_e + change / 2) * duration,
        "window_force_e": x.window_force_e + felt,
        "window_C_eb": x.window_C_eb + C_eb * duration,
        "acceleration_e": change / duration,
        "rate_b": (first + second) / duration,
        "filter_due": due,
        "carry_due": due * p.moving,
    }


def carry(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The place moves on by the velocity since the last time."""
    latitude, longitude, height = ca.vertsplit(x.place)
    sine, cosine = sin_cos(latitude)
    meridian, normal = geodesy.radii(sine)
    moved = attitude.rotate_inverse(geodesy.q_ew_from_geodetic(latitude, longitude, 0), x.velocity_e) * x.window
    east = moved[1] / ((normal + height) * maximum(cosine, 1e-6))
    place = ca.vertcat(latitude + moved[0] / (meridian + height), longitude + east, height - moved[2])
    return {"place": place, "gravity_e": _gravity_e(place[0], place[1], place[2])}


def filter(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Covariance over the window since the last observation, then the observation, and feedback."""
    noise = ca.vertcat(
        ca.repmat(p.velocity_random_walk**2, 3, 1),
        ca.repmat(p.angle_random_walk**2, 3, 1),
        ca.repmat(2 * p.accel_bias_sigma**2 / p.accel_correlation_time, 3, 1),
        ca.repmat(2 * p.gyro_bias_sigma**2 / p.gyro_correlation_time, 3, 1),
    )
    # Jacobians about the heading of the start, and in place about the known specific force: see the module's docstring
    down = x.gravity_e / ca.sqrt(ca.sumsqr(x.gravity_e))
    back = attitude.to_dcm(attitude.from_small_rotation_vector(-ca.dot(down, x.misalignment_e) * down))
    moving = p.moving * (1 - u.standing)
    felt = select(moving, back @ x.window_force_e, -x.gravity_e * x.window)
    A = transition(x.window, felt, back @ x.window_C_eb)
    return observed(p, x, moving, propagate(x.covariance, A, noise * x.window), A)


def observed(p: Any, x: Any, moving: Any, stored: Any, A: Any) -> dict[str, Any]:
    """The observation, component by component in e, at the end of a window.

    moving: 1 for the velocity of a fix, 0 for zero velocity.  stored (78), A (12x12): covariance now, transition of the window.
    """
    predicted = ca.vertcat(*[stored[symmetric.place(i, i)] for i in range(3)])
    floor, time = p.velocity_sigma**2, x.observing + x.window
    beyond = maximum(x.velocity_e**2 - GATE**2 * (predicted + floor), 0.0)
    excess = x.excess + (beyond - x.excess) * (x.window / minimum(time, p.learning_time))
    sway = p.sway_sigma**2 + ca.sum1(maximum(excess, beyond))  # in one direction there is sway in all
    variance = floor + sway * minimum(2 * (p.sway_time / x.window) ** 2, 1.0) + (p.velocity_random_walk**2 / 3) * x.window
    variance = select(moving, ca.repmat(x.fix_sigma**2, 3, 1), variance)
    fix_innovation, fix_H = fix_observation(p, x)
    innovation = select(moving, fix_innovation, x.window_velocity_e / x.window)
    accept, correction = select(moving, x.fix_waiting, 1.0), ca.SX.zeros(N)
    H = select(moving, fix_H, observation(A, 0.5))
    for i in range(3):
        stored, correction = observe(stored, correction, H[i, :], innovation[i], variance[i], accept)
    return {
        **corrected(x, correction),
        "covariance": stored,
        "excess": excess,
        "swaying": select(sway > SWAYING**2 * floor, 1.0, 0.0),
        "observing": time,
        "innovation": innovation,
        "fix_waiting": 0,
        "window": 0,
        "window_force_e": ca.SX.zeros(3),
        "window_velocity_e": ca.SX.zeros(3),
        "window_C_eb": ca.SX.zeros(3, 3),
    }


def fix_observation(p: Any, x: Any) -> tuple[Any, Any]:
    """Innovation (3, m/s, e) of the velocity at a fix's antenna and time, and its derivative (3x12) to the error state."""
    q_en = geodesy.q_ew_from_geodetic(x.place[0], x.place[1], 0)
    C_eb = attitude.to_dcm(x.q_eb)
    swing = C_eb @ ca.cross(x.rate_b, p.antenna_lever_arm)
    innovation = x.velocity_e - x.acceleration_e * x.fix_age + swing - attitude.rotate(q_en, x.fix_velocity_n)
    force = x.acceleration_e - x.gravity_e
    H = ca.SX(3, N)
    H[:, VELOCITY] = ca.SX.eye(3)
    H[:, TILT] = skew(swing) - x.fix_age * skew(force)
    H[:, ACCEL] = -x.fix_age * C_eb
    H[:, GYRO] = -C_eb @ skew(p.antenna_lever_arm)
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
    """Attitude now and its covariance; during the coarse alignment the q-method's."""
    rough = COARSE.output(p, x)
    q_en = geodesy.q_ew_from_geodetic(x.place[0], x.place[1], 0)
    # a sample that waits for its second turns the attitude on
    ahead = x.held_delta_angle - (attitude.rotate_inverse(x.q_eb, AXIS_E) + x.gyro_bias) * x.held_dt
    q_eb = attitude.multiply(x.q_eb, attitude.from_small_rotation_vector(x.holding * ahead))
    fine = attitude.normalize(attitude.multiply(attitude.conjugate(q_en), q_eb))
    C_en = attitude.to_dcm(q_en)
    covariance = C_en.T @ symmetric.full(x.covariance, N)[TILT, TILT] @ C_en
    covariance = select(x.coarse, ca.diag(rough["attitude_sigma"] ** 2), covariance)
    return {
        "q_nb": select(x.coarse, rough["q_nb"], fine),
        "attitude_sigma": ca.sqrt(ca.diag(covariance)),
        "attitude_covariance": covariance,
        "misalignment_e": x.misalignment_e,
        "gyro_bias": x.gyro_bias,
        "accel_bias": x.accel_bias,
        "innovation": x.innovation,
    }


def _gravity_e(latitude: Any, longitude: Any, height: Any) -> Any:
    """Gravity (3, m/s^2, e): along the ellipsoid's normal."""
    down = geodesy.C_en(latitude, longitude)[:, 2]
    return down * geodesy.normal_gravity(-down[2], height)


MODEL = Model(
    id="ecef-kf",
    title="fine alignment in the Earth frame, 12-state filter on zero velocity",
    parameters=PARAMETERS,
    state=STATE,
    inputs=INPUTS,
    outputs=OUTPUTS,
    steps={
        "sample": Step(sample),
        "coarse": Step(coarse, when="coarse"),
        "smooth": COARSE.steps["smooth"],
        "begin": Step(begin, when="coarse_over"),
        "fix": Step(fix, when="gnss_valid"),
        "pair": Step(pair, when="pair_due"),
        "carry": Step(carry, when="carry_due"),
        "filter": Step(filter, when="filter_due"),
    },
    output=output,
    start=start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known; a coarse alignment where the attitude told is too uncertain for a linear filter."""
    sensors = known.sensors
    earth = max(float(geodesy.numeric.earth_rate_n(known.latitude)[0]), 1e-3 * geodesy.OMEGA_IE)
    unknown = known.tilt_sigma > LARGE_TILT or known.heading_sigma >= LARGE_HEADING
    drift = sensors.gyro_bias_sigma * COARSE_TIME / 2  # the q-method's vertical is at most half as old as the alignment
    tilt = hypot(COARSE_TILT, sensors.accel_bias_sigma / geodesy.NOMINAL_GRAVITY, drift)
    heading = hypot(COARSE_HEADING, sensors.gyro_bias_sigma / earth)
    return {
        **inertial_vectors.prepare(known),
        "longitude": known.longitude,
        "start_roll": known.roll,
        "start_pitch": known.pitch,
        "start_heading": known.heading,
        "start_velocity_n": (0.0, 0.0, 0.0) if unknown else known.velocity_n,
        "tilt_sigma": tilt if unknown else known.tilt_sigma,
        "heading_sigma": min(heading, 1.0) if unknown else known.heading_sigma,
        "coarse_time": COARSE_TIME if unknown else 0.0,
        "velocity_sigma_start": 1.0 if unknown else float(known.velocity_sigma.max()),
        "angle_random_walk": sensors.angle_random_walk,
        "velocity_random_walk": sensors.velocity_random_walk,
        "gyro_bias_sigma": sensors.gyro_bias_sigma,
        "accel_bias_sigma": sensors.accel_bias_sigma,
        "gyro_correlation_time": sensors.gyro_correlation_time,
        "accel_correlation_time": sensors.accel_correlation_time,
        "antenna_lever_arm": known.antenna_lever_arm,
    }


ESTIMATOR = Estimator(MODEL, kind="alignment", moving_row="moving", prepare=prepare, applicability=applicability.notes)
