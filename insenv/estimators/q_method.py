"""`q-method`: alignment of a vehicle that stays in place, at any attitude and on any sway, as Wahba's problem in the
inertial frame.

Gyros carry the attitude from the start, C_b(0)b(t).  Seen from the frozen body axes, specific force is minus gravity, which the
Earth's rotation moves along a known cone, plus the vehicle's own accelerations:

    alpha(t) = C_b(t)^b(0) f^b(t),   beta(t) = -C_n(t)^n(0) g^n,   beta = C(Q) alpha

The constant quaternion Q minimises the integral of |beta - C(Q) alpha|^2: it is the eigenvector of the largest eigenvalue
of Davenport's 4x4 matrix, which is formed from the running integral B of beta alpha^T.  Source: the quaternion adaptive-
Kalman paper (q-method; its K is the integral of M^T M = (|alpha|^2 + |beta|^2) I - 2 Davenport); Davenport's matrix:
Markley and Crassidis (2014), section 5.3.

Against the accelerations of a swaying base both vectors pass the same low-pass, a cascade of four equal first-order
filters: it is linear and the same on both sides, so it costs no delay error.  What it cannot take away is the velocity that
the vehicle happens to have at the start: seen from then on, its acceleration has a mean.  The filters forget that within
some fifteen time constants, and vectors count little before (`_weight`).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import minimum, sin_cos
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.eigen import largest_eigenvector
from insenv.estimators.increments import MEMORY, SAMPLE_INPUTS, compensated, remembered
from insenv.estimators.registry import Estimator, Knowledge

FILTERS = 4
SETTLING = 16.0

PARAMETERS = Table((
    Row("latitude", "Geodetic latitude", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("height", "Height over the ellipsoid", "m", lower=-12e3, upper=1e5),
    Row("smoothing_time", "Time constant of each of the four low-passes", "s", start=5.0, lower=0.0, upper=1e4),
    Row("gyro_bias_sigma", "Gyro bias that the stated accuracy counts with", "rad/s", lower=0.0, upper=1.0),
    Row("accel_bias_sigma", "Accelerometer bias that the stated accuracy counts with", "m/s^2", lower=0.0, upper=100.0),
))  # fmt: skip

STATE = Table((
    Row("q_ib", "Attitude since the start: takes b components to components in b at the start", "1", (4,), "i", (1, 0, 0, 0)),
    Row("axis_n", "The Earth's axis", "1", (3,), "n"),
    Row("rest_force_n", "Specific force at rest", "m/s^2", (3,), "n"),
    Row("half_turn", "Cosine and sine of half the angle that the Earth has turned since the start", "1", (2,), start=(1, 0)),
    Row("alpha", "Measured specific force, after each low-pass", "m/s^2", (FILTERS, 3), "i"),
    Row("beta", "Expected specific force, likewise", "m/s^2", (FILTERS, 3), "n at the start"),
    Row("profile", "Attitude profile matrix: integral of beta alpha^T", "m^2/s^3", (3, 3)),
    Row("time", "Time since the start", "s"),
)) + MEMORY  # fmt: skip

OUTPUTS = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Stated accuracy about north, east, down: the limit that the sensors' biases set", "rad", (3,), "n"),
))  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """What the place determines."""
    sin_latitude, cos_latitude = sin_cos(p.latitude)
    return {
        "axis_n": ca.vertcat(cos_latitude, 0, -sin_latitude),
        "rest_force_n": ca.vertcat(0, 0, -geodesy.normal_gravity(sin_latitude, p.height)),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    rotation, increment = compensated(x, u.delta_angle, u.delta_velocity)
    measured = attitude.rotate(x.q_ib, increment) / u.dt
    # rest as it would be felt at mid-sample, turned from n then into n at the start
    quarter = _turned(x.half_turn, u.dt / 4)
    expected = attitude.rotate(_turn(quarter, x.axis_n), x.rest_force_n)

    gain = u.dt / (p.smoothing_time + u.dt)
    alpha, beta = _cascade(x.alpha, measured, gain), _cascade(x.beta, expected, gain)
    return {
        "q_ib": attitude.renormalize(attitude.multiply(x.q_ib, attitude.from_small_rotation_vector(rotation))),
        "half_turn": _turned(quarter, u.dt / 4),
        "alpha": alpha,
        "beta": beta,
        "profile": x.profile + (beta[FILTERS - 1, :].T @ alpha[FILTERS - 1, :]) * (_weight(p, x.time) * u.dt),
        "time": x.time + u.dt,
        **remembered(x, u.delta_angle, u.delta_velocity),
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now: C_nb = C_n(t)n(0) C(Q) C_b(0)b(t)."""
    q_start = largest_eigenvector(davenport(x.profile))
    back = attitude.conjugate(_turn(x.half_turn, x.axis_n))
    q_nb = attitude.multiply(back, attitude.multiply(q_start, x.q_ib))
    tilt = p.accel_bias_sigma / -x.rest_force_n[2]
    heading = p.gyro_bias_sigma / (geodesy.OMEGA_IE * x.axis_n[0])
    return {"q_nb": attitude.normalize(q_nb), "attitude_sigma": ca.vertcat(tilt, tilt, heading)}


def davenport(profile: Any) -> Any:
    """Davenport's symmetric 4x4 matrix (scalar first) of B = sum of beta alpha^T, whose eigenvector of the largest
    eigenvalue is the quaternion that takes the alphas to the betas.
    """
    B = profile
    vector = ca.vertcat(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1])
    block = B + B.T - ca.trace(B) * ca.SX.eye(3)
    return ca.vertcat(ca.horzcat(ca.trace(B), vector.T), ca.horzcat(vector, block))


def _turned(half_turn: Any, dt: Any) -> Any:
    """`half_turn` after the Earth has turned on for `2 dt` (an angle below 1e-3: the series end at rounding)."""
    angle = geodesy.OMEGA_IE * dt
    s, c = angle - angle**3 / 6, 1 - angle * angle / 2 + angle**4 / 24
    return ca.vertcat(half_turn[0] * c - half_turn[1] * s, half_turn[1] * c + half_turn[0] * s)


def _turn(half_turn: Any, axis_n: Any) -> Any:
    """The Earth's turn as a quaternion: takes components in n now to components in n at the start."""
    return ca.vertcat(half_turn[0], half_turn[1] * axis_n)


def _weight(p: Any, time: Any) -> Any:
    """Weight of the vectors at a time after the start: rises as its eighth power, to 1 after `SETTLING` filter time
    constants.
    """
    rise = minimum(time / (SETTLING * p.smoothing_time + 1e-3), 1.0)
    return ((rise**2) ** 2) ** 2


def _cascade(filters: Any, value: Any, gain: Any) -> Any:
    """New outputs (rows) of the low-passes in series, for an input (3)."""
    rows, value = [], value.T
    for i in range(FILTERS):
        value = filters[i, :] + gain * (value - filters[i, :])
        rows.append(value)
    return ca.vertcat(*rows)


MODEL = Model(
    id="q-method",
    title="alignment in place by many vectors in the inertial frame (Wahba's problem)",
    parameters=PARAMETERS,
    state=STATE,
    inputs=SAMPLE_INPUTS,
    outputs=OUTPUTS,
    steps={"sample": Step(sample)},
    output=output,
    start=start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known."""
    return {
        "latitude": known.latitude,
        "height": known.height,
        "gyro_bias_sigma": known.sensors.gyro_bias_sigma,
        "accel_bias_sigma": known.sensors.accel_bias_sigma,
    }


ESTIMATOR = Estimator(MODEL, kind="alignment", aided=False, prepare=prepare)
