"""Many vectors in the inertial frame: what `q-method`, `qakf` and `qakf-improved` share.

Gyros carry the attitude from the start, C_b(0)b(t).  Seen from the frozen body axes, specific force is minus gravity, which the
Earth's rotation moves along a known cone, plus the vehicle's own accelerations:

    alpha(t) = C_b(t)^b(0) f^b(t),   beta(t) = -C_n(t)^n(0) g^n,   beta = C(Q) alpha

with Q the constant quaternion from b at the start to n at the start; the attitude now is C_n(0)^n(t) C(Q) C_b(t)^b(0).
Source: the quaternion adaptive-Kalman paper, section 2.1.  Its K, the integral of M^T M with M = [beta +] - [alpha -], is
(integral of |alpha|^2 + |beta|^2) I - 2 Davenport(B), B the integral of beta alpha^T (Markley and Crassidis 2014, section 5.3).

Against the accelerations of a swaying base two things are added to the paper's plain vectors (`smoothing_time` 0 and a large
`memory_time` give the plain ones).  Both are linear and the same on alpha and beta, so without errors they leave none.

Window (of `qakf`, `qakf-improved`; the q-method's weights are windows themselves): both vectors are faded in over `FADE_IN`
smoothing times (a polynomial with three vanishing derivatives at either end) and then pass a Butterworth low-pass of sixth
order.  Every filtered vector is so an average over a window that begins and ends smoothly, and the velocity that the vehicle
happens to have at the start leaves nothing for good.

Weights: gyro white noise (N) makes the frozen axes wander as a Brownian path, so the further two vectors lie apart the less
they say of the other's time.  The best estimate of heading, which is a slope, weighs time by sinh((t - T/2) / tau) with
tau = V / (g N), V the accelerometers' white noise: the ends of the run, each over tau (which gives the Cramer-Rao bound of
`insenv.evaluation.limits` to four digits).  Here B is the sum of an integral that fades out after the start and one that
forgets, both
with `memory_time` = tau; for tau well above T all weights are alike.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import maximum, minimum, polynomial, sin_cos
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Knowledge
from insenv.estimators.parts.increments import MEMORY, compensated, remembered

DAMPING = (0.9659258262890683, 0.7071067811865476, 0.25881904510252074)  # Butterworth, sixth order: cos 15, 45, 75 deg
SECTIONS = len(DAMPING)
FADE_IN = 7.5  # smoothing times
DELAY = 0.5 * FADE_IN + 2.0 * sum(DAMPING)  # smoothing times that both ends lose: middle of the fade-in, delay of the filter
LEAST_MEMORY = 30.0  # s: windows shorter than that would show waves
LEAST_SIGMA_TIME = 1e-3  # s
LARGEST_HEADING_SIGMA = math.pi / math.sqrt(3.0)  # rad: nothing known

PARAMETERS = Table((
    Row("latitude", "Geodetic latitude", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("height", "Height over the ellipsoid", "m", lower=-12e3, upper=1e5),
    Row("smoothing_time", "Inverse of the low-pass's cut-off (rad/s); 0: no low-pass", "s", start=4.0, lower=0.0, upper=1e4),
    Row("memory_time", "Time near the start and before now whose vectors count", "s", start=1e9, lower=1.0, upper=1e12),
    Row("gyro_bias_sigma", "Gyro bias that the stated accuracy counts with", "rad/s", lower=0.0, upper=1.0),
    Row("accel_bias_sigma", "Accelerometer bias that the stated accuracy counts with", "m/s^2", lower=0.0, upper=100.0),
    Row("angle_random_walk", "Gyro white noise that it counts with", "rad/s^0.5", lower=0.0, upper=1.0),
    Row("velocity_random_walk", "Accelerometer white noise that it counts with", "m/s^1.5", lower=0.0, upper=100.0),
))  # fmt: skip

CARRIED = Table((
    Row("q_ib", "Attitude since the start: takes b components to components in b at the start", "1", (4,), "i", (1, 0, 0, 0)),
    Row("axis_n", "The Earth's axis", "1", (3,), "n"),
    Row("rest_force_n", "Specific force at rest", "m/s^2", (3,), "n"),
    Row("half_turn", "Cosine and sine of half the angle that the Earth has turned since the start", "1", (2,), start=(1, 0)),
    Row("time", "Time since the start", "s"),
)) + MEMORY  # fmt: skip

STATE = CARRIED + Table((
    Row("alpha", "Measured specific force, after each section of the low-pass", "m/s^2", (SECTIONS, 3), "i"),
    Row("alpha_rate", "Its rate", "m/s^3", (SECTIONS, 3), "i"),
    Row("beta", "Expected specific force, likewise", "m/s^2", (SECTIONS, 3), "n at the start"),
    Row("beta_rate", "Its rate", "m/s^3", (SECTIONS, 3), "n at the start"),
))  # fmt: skip

PROFILE_STATE = Table((
    Row("early_profile", "Integral of beta alpha^T with weights that fade out after the start", "m^2/s^3", (3, 3)),
    Row("late_profile", "The same with weights that fade out before now", "m^2/s^3", (3, 3)),
    Row("early_weight", "Weight of a vector now in the early profile", "1", start=1.0),
))  # fmt: skip

OUTPUTS = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Stated accuracy about north, east, down", "rad", (3,), "n"),
))  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """What the place determines."""
    sin_latitude, cos_latitude = sin_cos(p.latitude)
    return {
        "axis_n": ca.vertcat(cos_latitude, 0, -sin_latitude),
        "rest_force_n": ca.vertcat(0, 0, -geodesy.normal_gravity(sin_latitude, p.height)),
    }


def carried(p: Any, x: Any, u: Any) -> tuple[dict[str, Any], Any, Any]:
    """Rows of `CARRIED` after one inertial sample; alpha and beta (3x1, m/s^2), means over it."""
    rotation, increment = compensated(x, u.delta_angle, u.delta_velocity)
    # rest as it would be felt at mid-sample, turned from n then into n at the start
    quarter = _turned(x.half_turn, u.dt / 4)
    rows = {
        "q_ib": attitude.renormalize(attitude.multiply(x.q_ib, attitude.from_small_rotation_vector(rotation))),
        "half_turn": _turned(quarter, u.dt / 4),
        "time": x.time + u.dt,
        **remembered(x, u.delta_angle, u.delta_velocity),
    }
    return rows, attitude.rotate(x.q_ib, increment) / u.dt, attitude.rotate(_turn(quarter, x.axis_n), x.rest_force_n)


def vectors(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Rows of `STATE` after one inertial sample; the vectors are the last rows of alpha and beta."""
    rows, measured, expected = carried(p, x, u)
    fade = fade_in(x.time + u.dt / 2, FADE_IN * p.smoothing_time)
    alpha, alpha_rate = low_pass(x.alpha, x.alpha_rate, fade * measured, p.smoothing_time, u.dt)
    beta, beta_rate = low_pass(x.beta, x.beta_rate, fade * expected, p.smoothing_time, u.dt)
    return {**rows, "alpha": alpha, "alpha_rate": alpha_rate, "beta": beta, "beta_rate": beta_rate}


def latest(rows: dict[str, Any]) -> tuple[Any, Any]:
    """alpha and beta (3x1, m/s^2) from the rows that `vectors` gave."""
    return rows["alpha"][SECTIONS - 1, :].T, rows["beta"][SECTIONS - 1, :].T


def profiles(p: Any, x: Any, alpha: Any, beta: Any, dt: Any) -> dict[str, Any]:
    """Rows of `PROFILE_STATE` after one sample."""
    keep = p.memory_time / (p.memory_time + dt)
    product = (beta @ alpha.T) * dt
    return {
        "early_profile": x.early_profile + x.early_weight * product,
        "late_profile": keep * x.late_profile + product,
        "early_weight": keep * x.early_weight,
    }


def davenport(profile: Any) -> Any:
    """Davenport's symmetric 4x4 matrix (scalar first) of B = sum of beta alpha^T, whose eigenvector of the largest
    eigenvalue is the quaternion that takes the alphas to the betas.
    """
    B = profile
    vector = ca.vertcat(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1])
    block = B + B.T - ca.trace(B) * ca.SX.eye(3)
    return ca.vertcat(ca.horzcat(ca.trace(B), vector.T), ca.horzcat(vector, block))


def attitude_now(x: Any, q_start: Any) -> Any:
    """q_nb (4x1) now, C_n(0)^n(t) C(Q) C_b(t)^b(0), from Q = `q_start`."""
    return attitude.normalize(attitude.multiply(earth_turn_back(x), attitude.multiply(q_start, x.q_ib)))


def earth_turn_back(x: Any) -> Any:
    """Quaternion that takes components in n at the start to components in n now."""
    return attitude.conjugate(_turn(x.half_turn, x.axis_n))


def stated_sigma(p: Any, x: Any, lost: Any, age: Any, mean_age: Any) -> Any:
    """Stated accuracy (3, rad): the limit that biases and white noise set (`insenv.evaluation.limits`) over the time that the
    windows
    leave (all but `lost`, s), and in tilt what the gyros have turned since the vertical was found: their bias over `age` (s),
    their noise over `mean_age` (s); of a Brownian path the mean over a time of 2 mean_age has a variance of a third of that.
    The middle term of heading's noise joins the two ends of Brownian path (N) and white noise (V) to within 5 %.
    """
    g, cosine = -x.rest_force_n[2], x.axis_n[0]
    time = maximum(x.time - lost, LEAST_SIGMA_TIME)
    N, V = p.angle_random_walk, p.velocity_random_walk / g
    tilt = p.accel_bias_sigma / g
    carried = (p.gyro_bias_sigma * age) ** 2 + N**2 * mean_age * (2.0 / 3.0)
    level = ca.sqrt(tilt**2 + 4 * V**2 / time + carried)
    slope = (N**2 + (1.2 * N * V + 12 * V**2 / time) / time) / time
    drift = p.gyro_bias_sigma**2 + slope + (geodesy.OMEGA_IE * x.axis_n[2] * tilt) ** 2
    heading = ca.sqrt(drift) / (geodesy.OMEGA_IE * cosine)
    return ca.vertcat(minimum(level, 1.0), minimum(level, 1.0), minimum(heading, LARGEST_HEADING_SIGMA))


def fade_in(time: Any, duration: Any) -> Any:
    """From 0 at time 0 to 1 at `duration` (s), three derivatives vanishing at either end; 1 where the duration is 0."""
    rise = minimum(time / (duration + 1e-9), 1.0)
    return rise**4 * polynomial(rise, (35.0, -84.0, 70.0, -20.0))


def low_pass(values: Any, rates: Any, value: Any, time_constant: Any, dt: Any) -> tuple[Any, Any]:
    """New outputs and rates (rows) of the sections in series for an input (3x1), by backward Euler: stable at any interval,
    and with time constant 0 the output is the input.
    """
    outputs, slopes, square = [], [], time_constant * time_constant
    value = value.T
    for i, damping in enumerate(DAMPING):
        per = 1 / (square + dt * (2 * damping * time_constant + dt))
        slope = (rates[i, :] * square + (value - values[i, :]) * dt) * per
        value = values[i, :] + dt * slope
        outputs.append(value)
        slopes.append(slope)
    return ca.vertcat(*outputs), ca.vertcat(*slopes)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Rows of `PARAMETERS` from what is known."""
    sensors = known.sensors
    memory = 1e9
    if sensors.angle_random_walk > 0.0:
        memory = sensors.velocity_random_walk / (geodesy.NOMINAL_GRAVITY * sensors.angle_random_walk)
    return {
        "latitude": known.latitude,
        "height": known.height,
        "memory_time": min(max(memory, LEAST_MEMORY), 1e9),
        "gyro_bias_sigma": sensors.gyro_bias_sigma,
        "accel_bias_sigma": sensors.accel_bias_sigma,
        "angle_random_walk": sensors.angle_random_walk,
        "velocity_random_walk": sensors.velocity_random_walk,
    }


def _turned(half_turn: Any, dt: Any) -> Any:
    """`half_turn` after the Earth has turned on for `2 dt` (an angle below 1e-3: the series end at rounding)."""
    angle = geodesy.OMEGA_IE * dt
    s, c = angle - angle**3 / 6, 1 - angle * angle / 2 + angle**4 / 24
    return ca.vertcat(half_turn[0] * c - half_turn[1] * s, half_turn[1] * c + half_turn[0] * s)


def _turn(half_turn: Any, axis_n: Any) -> Any:
    """The Earth's turn as a quaternion: takes components in n now to components in n at the start."""
    return ca.vertcat(half_turn[0], half_turn[1] * axis_n)
