"""What `lssvm` sees: velocity and position of a free-running SINS less those of GNSS, and how they grow.

Frames: i is b at the start, frozen; n0 is n at the start, frozen.  Gyros carry q_ib, the Earth's known rate q_n0n, and the
constant q_n0i is the attitude at the start as the SINS takes it.  Its error, the misalignment R = C_hat C^T, is constant
but for what gyros do wrong, however large it is.  The vehicle stays within metres of the place it is told, so

    SINS:  velocity and position of it are the integrals A of the specific force, R beta
    GNSS:  those of it are the integrals B of the specific force at rest, and C_n0n times the displacement that GNSS shows
    difference:  A - B = (R - I) times the integrals of beta, to within what the displacement itself is misaligned by

(R - I) beta turns with the Earth: its value now is the tilt's, its rate ((R - I) (omega_ie x beta)) the heading's.  A Kalman
filter of a chain of integrators - difference of position, of velocity, acceleration and its rate - with the white noises of
the unit and of the fixes takes them out of the differences.  All axes share one covariance.  The filter is linear, so it
runs on A in i and on B in n0, each by itself with the same gains, and a correction of q_n0i turns all that is past with it.

A gyro bias about east makes the same rate as a heading error, and the same second rate.  What tells them apart is the sway: the
chain's innovations show the vehicle's own motion, by the SINS and by GNSS, turned by R against one another.  Their profile
matrix (sum of products, as in Wahba's problem) gives a second heading, noisy but free of the bias.  Its weight is its
information D against that of the other, (omega_ie cos L / gyro bias sigma)^2.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.elementary import select, sin_cos
from insenv.core.tables import Row, Table
from insenv.estimators.parts.frozen_frame import q_n0n, turned
from insenv.estimators.parts.increments import MEMORY, compensated, remembered

CHAIN = 4
FEATURES = 6
READY = 0.005
"""rad: the differences show the heading from the fix on at which noises leave less than that of it."""
LEAST_BIAS = 1e-12  # rad/s
_LARGEST_START = (100.0, 10.0, 25.0, 2e-3)  # of the differences: m, m/s, m/s^2, m/s^3; nothing is known of them

PARAMETERS = Table((
    Row("latitude", "Geodetic latitude", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("longitude", "Longitude", "rad", lower=-2 * math.pi, upper=2 * math.pi),
    Row("height", "Height over the ellipsoid", "m", lower=-12e3, upper=1e5),
    Row("start_roll", "Roll at the start", "rad", lower=-2 * math.pi, upper=2 * math.pi),
    Row("start_pitch", "Pitch at the start", "rad", lower=-2 * math.pi, upper=2 * math.pi),
    Row("start_heading", "Heading at the start", "rad", lower=-2 * math.pi, upper=2 * math.pi),
    Row("gyro_bias_sigma", "Standard deviation of the gyro bias", "rad/s", start=1e-6, lower=0.0, upper=1.0),
    Row("accel_bias_sigma", "Accelerometer bias that the stated accuracy counts with", "m/s^2", lower=0.0, upper=100.0),
    Row("angle_random_walk", "White noise of the gyros", "rad/s^0.5", start=1e-6, lower=0.0, upper=1.0),
    Row("velocity_random_walk", "White noise of the accelerometers", "m/s^1.5", start=1e-4, lower=0.0, upper=100.0),
    Row("antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3),
))  # fmt: skip

STATE = Table((
    Row("q_ib", "Attitude since the start: takes b components to components in b at the start", "1", (4,), "i", (1, 0, 0, 0)),
    Row("q_n0i", "Attitude at the start: takes i components to components in n at the start", "1", (4,), "n0", (1, 0, 0, 0)),
    Row("axis_n", "The Earth's axis", "1", (3,), "n"),
    Row("gravity", "Normal gravity", "m/s^2"),
    Row("half_turn", "Cosine and sine of half the angle that the Earth has turned since the start", "1", (2,), start=(1, 0)),
    Row("velocity_i", "Integral of the specific force", "m/s", (3,), "i"),
    Row("position_i", "Its integral", "m", (3,), "i"),
    Row("force_i", "Specific force of the last sample", "m/s^2", (3,), "i"),
    Row("rest_velocity", "Integral of the specific force at rest, to the last fix's epoch", "m/s", (3,), "n0"),
    Row("rest_position", "Its integral", "m", (3,), "n0"),
    Row("rest_half_turn", "As half_turn, at the last fix's epoch", "1", (2,), start=(1, 0)),
    Row("dt", "Interval of the last sample", "s", start=1.0),
    Row("stretch", "Time since the last fix's epoch", "s"),
    Row("chain_sins", "Chain of the SINS's position, velocity, acceleration and its rate", "SI", (CHAIN, 3), "i"),
    Row("chain_gnss", "The same of GNSS", "SI", (CHAIN, 3), "n0"),
    Row("chain_covariance", "Covariance of the chain of one axis, upper triangle by columns", "SI",
        (symmetric.triangle_size(CHAIN),)),
    Row("sway", "Sum of products of the two chains' innovations in position over their variance", "1", (3, 3), "i, n0"),
)) + MEMORY  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The start as told, and what the place determines."""
    sin_latitude, cos_latitude = sin_cos(p.latitude)
    sigma = ca.vertcat(*_LARGEST_START)
    return {
        "axis_n": ca.vertcat(cos_latitude, 0, -sin_latitude),
        "gravity": geodesy.normal_gravity(sin_latitude, p.height),
        "q_n0i": attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading),
        "chain_covariance": symmetric.triangle(ca.diag(sigma * sigma)),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: attitude since the start, and the SINS's velocity and position."""
    rotation, increment = compensated(x, u.delta_angle, u.delta_velocity)
    gained = attitude.rotate(x.q_ib, increment)
    return {
        "q_ib": attitude.renormalize(attitude.multiply(x.q_ib, attitude.from_small_rotation_vector(rotation))),
        "half_turn": turned(x.half_turn, u.dt),
        "velocity_i": x.velocity_i + gained,
        "position_i": x.position_i + (x.velocity_i + gained / 2) * u.dt,
        "force_i": gained / u.dt,
        "dt": u.dt,
        "stretch": x.stretch + u.dt,
        **remembered(x, u.delta_angle, u.delta_velocity),
    }


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix, at its own epoch: the chains of SINS and GNSS, carried there and corrected."""
    T, age = x.stretch - u.gnss_age, u.gnss_age
    rest_velocity, rest_position = _rest(x, T)
    half_turn = turned(x.half_turn, -age)
    q = q_n0n(half_turn, x.axis_n)
    offset = geodesy.ned_offset(u.gnss_latitude, u.gnss_longitude, u.gnss_height, p.latitude, p.longitude, p.height)
    shown = (
        rest_position + attitude.rotate(q, offset),
        rest_velocity + attitude.rotate(q, u.gnss_velocity_n + ca.cross(geodesy.OMEGA_IE * x.axis_n, offset)),
    )
    arm = p.antenna_lever_arm
    swing = ca.cross(x.previous_delta_angle / x.dt, arm)
    computed = (
        x.position_i - x.velocity_i * age + x.force_i * (age * age / 2) + attitude.rotate(x.q_ib, arm - swing * age),
        x.velocity_i - x.force_i * age + attitude.rotate(x.q_ib, swing),
    )

    Phi = _transition(T)
    P = Phi @ symmetric.full(x.chain_covariance, CHAIN) @ Phi.T + _noise(p, x, T)
    sins, gnss = Phi @ x.chain_sins, Phi @ x.chain_gnss
    sigmas = (u.gnss_position_sigma, u.gnss_velocity_sigma)
    settled = heading_sigma(x) < READY
    sway = x.sway
    for place, present in ((0, 1), (1, u.gnss_velocity_valid)):
        variance = (sigmas[place][0] ** 2 + sigmas[place][1] ** 2) / 2  # of a horizontal axis: that is where heading shows
        per_variance = 1 / (P[place, place] + variance)
        left = computed[place].T - sins[place, :], shown[place].T - gnss[place, :]
        if place == 0:
            sway = sway + select(settled, per_variance, 0.0) * (left[0].T @ left[1])
        gain = P[:, place] * (present * per_variance)
        sins, gnss = sins + gain @ left[0], gnss + gain @ left[1]
        P = P - gain @ P[place, :]
        P = symmetric.full(symmetric.triangle(P), CHAIN)
    return {
        "rest_velocity": rest_velocity,
        "rest_position": rest_position,
        "rest_half_turn": half_turn,
        "stretch": age,
        "chain_sins": sins,
        "chain_gnss": gnss,
        "chain_covariance": symmetric.triangle(P),
        "sway": sway,
    }


def features(p: Any, x: Any) -> Any:
    """The inputs of the machine (6), pure numbers of the size of the misalignment phi about n (rad) where it is small:

    acceleration difference over gravity, north, east, down (-phi_E, phi_N, 0); its rate over gravity and horizontal Earth
    rate, north (-phi_D (1 - w)) and east (0); heading by the sway (phi_D w), w the sway's share of the information.
    """
    back = attitude.conjugate(q_n0n(x.half_turn, x.axis_n))
    into_n = attitude.multiply(back, x.q_n0i)

    def difference(place: int) -> Any:
        return attitude.rotate(into_n, x.chain_sins[place, :].T) - attitude.rotate(back, x.chain_gnss[place, :].T)

    horizontal = _horizontal_rate(x)
    profile = attitude.to_dcm(into_n) @ x.sway @ attitude.to_dcm(back).T
    across, along = profile[1, 0] - profile[0, 1], profile[0, 0] + profile[1, 1]
    by_rate = (horizontal / (p.gyro_bias_sigma + LEAST_BIAS)) ** 2
    total = by_rate + ca.sqrt(across * across + along * along)
    rate = difference(3) / (x.gravity * horizontal)
    return ca.vertcat(difference(2) / x.gravity, rate[0] * by_rate / total, rate[1], across / total)


def heading_sigma(x: Any) -> Any:
    """What the noises leave of the heading in the features, rad."""
    place = symmetric.place(3, 3)
    return ca.sqrt(x.chain_covariance[place]) / (x.gravity * _horizontal_rate(x))


def tilt_sigma(x: Any) -> Any:
    """The same of roll and pitch, rad."""
    return ca.sqrt(x.chain_covariance[symmetric.place(2, 2)]) / x.gravity


def turned_back(x: Any, tilt: Any) -> Any:
    """q_n0i without a misalignment whose rotation vector in n now is `tilt` (3, rad), to third order."""
    turn = attitude.rotate(q_n0n(x.half_turn, x.axis_n), tilt)
    return attitude.normalize(attitude.multiply(ca.vertcat(1, -turn / 2), x.q_n0i))


def q_nb(x: Any) -> Any:
    """Attitude now."""
    back = attitude.conjugate(q_n0n(x.half_turn, x.axis_n))
    return attitude.normalize(attitude.multiply(back, attitude.multiply(x.q_n0i, x.q_ib)))


def _rest(x: Any, T: Any) -> tuple[Any, Any]:
    """Integrals of the specific force at rest in n0, carried over T (s) by its series in the Earth's turn."""
    q, rate = q_n0n(x.rest_half_turn, x.axis_n), geodesy.OMEGA_IE * x.axis_n
    terms = [ca.vertcat(0, 0, -x.gravity)]
    for _ in range(4):
        terms.append(ca.cross(rate, terms[-1]))
    velocity, position, power = ca.SX.zeros(3), ca.SX.zeros(3), T
    for order, term in enumerate(terms):
        velocity = velocity + term * power
        power = power * T / (order + 2)
        position = position + term * power
    return (
        x.rest_velocity + attitude.rotate(q, velocity),
        x.rest_position + x.rest_velocity * T + attitude.rotate(q, position),
    )


def _horizontal_rate(x: Any) -> Any:
    """Of the Earth, rad/s; at a pole, where there is no heading, a trace of it."""
    return geodesy.OMEGA_IE * (ca.fabs(x.axis_n[0]) + 1e-12)


def _transition(T: Any) -> Any:
    """Phi (4x4) over T: a chain of integrators."""
    Phi, factor = ca.SX.eye(CHAIN), ca.SX(1)
    for order in range(1, CHAIN):
        factor = factor * T / order
        for row in range(CHAIN - order):
            Phi[row, row + order] = factor
    return Phi


def _noise(p: Any, x: Any, T: Any) -> Any:
    """Covariance (4x4) that the white noises add over T: of the accelerometers in velocity, of the gyros in tilt."""
    force, tilt = p.velocity_random_walk**2, (x.gravity * p.angle_random_walk) ** 2
    Q = ca.SX(CHAIN, CHAIN)
    Q[0, 0] = force * T**3 / 3 + tilt * T**5 / 20
    Q[0, 1] = Q[1, 0] = force * T**2 / 2 + tilt * T**4 / 8
    Q[0, 2] = Q[2, 0] = tilt * T**3 / 6
    Q[1, 1] = force * T + tilt * T**3 / 3
    Q[1, 2] = Q[2, 1] = tilt * T**2 / 2
    Q[2, 2] = tilt * T
    return Q
