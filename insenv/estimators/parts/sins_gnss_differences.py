"""The inputs of `lssvm`: velocity and position of a free-running SINS minus those of GNSS, and how they grow.

Frames (`insenv.estimators.parts.frozen_frame`): i is b at the start, n0 is n at the start, both frozen. The constant
q_n0i is the start attitude that the SINS assumes. Its error, the misalignment R = C_hat C^T, is constant except for
gyro errors, however large it is. The vehicle stays within metres of the known place, so

    SINS:  its velocity and position are the integrals A of the specific force, R beta
    GNSS:  its velocity and position are the integrals B of the specific force at rest, and C_n0n times the displacement
    difference: A - B = (R - I) times the integrals of beta, up to the misalignment of the displacement itself

(R - I) beta rotates with the Earth: its present value shows the tilt, its rate (R - I) (omega_ie x beta) the heading. A
Kalman filter of a chain of integrators - difference of position, of velocity, acceleration and its rate - with the
white noises of the inertial unit and of the fixes estimates them from the differences. All axes share one covariance.
The filter is linear, so it runs on A in i and on B in n0 separately with the same gains, and a correction of q_n0i
rotates its whole past.

A gyro bias about east causes the same rate as a heading error, and the same second rate. The sway separates them: the
innovations of the chains are the vehicle's own motion, by the SINS and by GNSS, rotated by R relative to one another.
Their profile matrix (sum of products, as in Wahba's problem) gives a second heading, noisy but free of the bias. Its
weight is its information relative to that of the other, (omega_ie cos L / gyro bias sigma)^2.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.core.tables import Row, Table
from insenv.estimators.parts import frozen_frame, rows
from insenv.estimators.parts.frozen_frame import horizontal_earth_rate, q_n0n, turned
from insenv.estimators.parts.strapdown import MEMORY

CHAIN = 4
FEATURES = 6
READY = 0.005
"""rad: the heading is in the features once the standard deviation from noise is below this."""
LEAST_BIAS = 1e-12  # rad/s
_LARGEST_START = (100.0, 10.0, 25.0, 2e-3)  # start sigmas of the differences, large: m, m/s, m/s^2, m/s^3

PARAMETERS = (
    rows.PLACE
    + rows.START_ATTITUDE
    + rows.chosen(rows.NOISES, gyro_bias_sigma=1e-6, angle_random_walk=1e-6, velocity_random_walk=1e-4)
    + rows.LEVER_ARM
)

STATE = frozen_frame.FRAME + Table((
    Row("velocity_i", "Integral of the specific force", "m/s", (3,), "i"),
    Row("position_i", "Its integral", "m", (3,), "i"),
    Row("force_i", "Specific force of the last sample", "m/s^2", (3,), "i"),
    Row("rest_velocity", "Integral of the specific force at rest, to the last fix's epoch", "m/s", (3,), "n0"),
    Row("rest_position", "Its integral", "m", (3,), "n0"),
    Row("rest_half_turn", "Row half_turn at the last fix's epoch", "1", (2,), start=(1, 0)),
    Row("dt", "Interval of the last sample", "s", start=1.0),
    Row("since_propagation", "Time since the last fix's epoch", "s"),
    Row("chain_sins", "Chain of the SINS: position, velocity, acceleration and its rate", "SI", (CHAIN, 3), "i"),
    Row("chain_gnss", "Chain of GNSS", "SI", (CHAIN, 3), "n0"),
    Row("chain_covariance", "Covariance of the chain of one axis, upper triangle by columns", "SI",
        (symmetric.triangle_size(CHAIN),)),
    Row("last_computed", "Position and velocity by the SINS at the last fix's epoch", "SI", (2, 3), "i"),
    Row("last_shown", "The same by GNSS", "SI", (2, 3), "n0"),
    Row("sway", "Sum of products of the two chains' innovations in position over their variance", "1", (3, 3), "i, n0"),
)) + MEMORY  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The given start attitude, and the rows that the place determines."""
    sigma = ca.vertcat(*_LARGEST_START)
    return {
        **frozen_frame.start(p),
        "q_n0i": attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading),
        "chain_covariance": symmetric.triangle(ca.diag(sigma * sigma)),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: attitude since the start, and velocity and position of the SINS."""
    changed, gained = frozen_frame.advanced(x, u)
    return {
        **changed,
        "velocity_i": x.velocity_i + gained,
        "position_i": x.position_i + (x.velocity_i + gained / 2) * u.dt,
        "force_i": gained / u.dt,
        "dt": u.dt,
        "since_propagation": x.since_propagation + u.dt,
    }


def measured(p: Any, x: Any, u: Any) -> SimpleNamespace:
    """Position and velocity at the epoch of a fix, `computed` by the SINS (i) and `shown` by GNSS (n0); and the rows of state
    that follow: `rest_velocity`, `rest_position`, `half_turn`."""
    T, age = x.since_propagation - u.gnss_age, u.gnss_age
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
    return SimpleNamespace(
        computed=computed, shown=shown, rest_velocity=rest_velocity, rest_position=rest_position, half_turn=half_turn
    )


def raw(x: Any, u: Any, at: SimpleNamespace, since_last: Any) -> Any:
    """The differences themselves, SINS minus GNSS (6): velocity (m/s) and position (m), n at the epoch of the fix.

    since_last: 1 for a SINS whose velocity and position are set to those of every fix, else 0.
    """
    back = attitude.conjugate(q_n0n(at.half_turn, x.axis_n))
    into_n = attitude.multiply(back, x.q_n0i)
    T, of_sins_and_gnss = x.since_propagation - u.gnss_age, []
    for q, (position, velocity), last in ((into_n, at.computed, x.last_computed), (back, at.shown, x.last_shown)):
        velocity_then = since_last * last[1, :].T
        moved = position - since_last * last[0, :].T - velocity_then * T
        of_sins_and_gnss.append(ca.vertcat(attitude.rotate(q, velocity - velocity_then), attitude.rotate(q, moved)))
    return of_sins_and_gnss[0] - of_sins_and_gnss[1]


def fix(p: Any, x: Any, u: Any, at: SimpleNamespace) -> dict[str, Any]:
    """One fix, at its own epoch: propagate the chains of SINS and GNSS to it and correct them.  at: `measured`."""
    T, age, computed, shown = x.since_propagation - u.gnss_age, u.gnss_age, at.computed, at.shown
    Phi = _transition(T)
    P = Phi @ symmetric.full(x.chain_covariance, CHAIN) @ Phi.T + _noise(p, x, T)
    sins, gnss = Phi @ x.chain_sins, Phi @ x.chain_gnss
    sigmas = (u.gnss_position_sigma, u.gnss_velocity_sigma)
    settled = heading_sigma(x) < READY
    sway = x.sway
    for place, present in ((0, 1), (1, u.gnss_velocity_valid)):
        variance = (sigmas[place][0] ** 2 + sigmas[place][1] ** 2) / 2  # of a horizontal axis, which shows the heading
        per_variance = 1 / (P[place, place] + variance)
        left = computed[place].T - sins[place, :], shown[place].T - gnss[place, :]
        if place == 0:
            sway = sway + select(settled, per_variance, 0.0) * (left[0].T @ left[1])
        gain = P[:, place] * (present * per_variance)
        sins, gnss = sins + gain @ left[0], gnss + gain @ left[1]
        P = P - gain @ P[place, :]
        P = symmetric.full(symmetric.triangle(P), CHAIN)
    return {
        "rest_velocity": at.rest_velocity,
        "rest_position": at.rest_position,
        "rest_half_turn": at.half_turn,
        "last_computed": ca.horzcat(*computed).T,
        "last_shown": ca.horzcat(*shown).T,
        "since_propagation": age,
        "chain_sins": sins,
        "chain_gnss": gnss,
        "chain_covariance": symmetric.triangle(P),
        "sway": sway,
    }


def features(p: Any, x: Any) -> Any:
    """The inputs of the machine (6), dimensionless; for a small misalignment phi about n (rad):

    acceleration difference over gravity, north, east, down (-phi_E, phi_N, 0); its rate over gravity and horizontal
    Earth rate, north (-phi_D (1 - w)) and east (0); heading by the sway (phi_D w), w the share of the sway in the
    information.
    """
    back = attitude.conjugate(q_n0n(x.half_turn, x.axis_n))
    into_n = attitude.multiply(back, x.q_n0i)

    def difference(place: int) -> Any:
        return attitude.rotate(into_n, x.chain_sins[place, :].T) - attitude.rotate(back, x.chain_gnss[place, :].T)

    horizontal = horizontal_earth_rate(x)
    profile = attitude.to_dcm(into_n) @ x.sway @ attitude.to_dcm(back).T
    across, along = profile[1, 0] - profile[0, 1], profile[0, 0] + profile[1, 1]
    by_rate = (horizontal / (p.gyro_bias_sigma + LEAST_BIAS)) ** 2
    total = by_rate + ca.sqrt(across * across + along * along)
    rate = difference(3) / (x.gravity * horizontal)
    return ca.vertcat(difference(2) / x.gravity, rate[0] * by_rate / total, rate[1], across / total)


def heading_sigma(x: Any) -> Any:
    """Standard deviation of the heading in the features from noise, rad."""
    place = symmetric.place(3, 3)
    return ca.sqrt(x.chain_covariance[place]) / (x.gravity * horizontal_earth_rate(x))


def tilt_sigma(x: Any) -> Any:
    """Standard deviation of roll and pitch in the features from noise, rad."""
    return ca.sqrt(x.chain_covariance[symmetric.place(2, 2)]) / x.gravity


def turned_back(x: Any, tilt: Any) -> Any:
    """q_n0i with a misalignment of rotation vector `tilt` in n now (3, rad) removed, to third order."""
    turn = attitude.rotate(q_n0n(x.half_turn, x.axis_n), tilt)
    return attitude.normalize(attitude.multiply(ca.vertcat(1, -turn / 2), x.q_n0i))


def _rest(x: Any, T: Any) -> tuple[Any, Any]:
    """Integrals of the specific force at rest in n0, extended over T (s) by its series in the Earth's rotation."""
    q, rate = q_n0n(x.rest_half_turn, x.axis_n), geodesy.OMEGA_IE * x.axis_n
    terms = [-x.gravity_n]
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


def _transition(T: Any) -> Any:
    """Phi (4x4) of a chain of integrators over T (s)."""
    Phi, factor = ca.SX.eye(CHAIN), ca.SX(1)
    for order in range(1, CHAIN):
        factor = factor * T / order
        for row in range(CHAIN - order):
            Phi[row, row + order] = factor
    return Phi


def _noise(p: Any, x: Any, T: Any) -> Any:
    """Covariance (4x4) that white noise adds over T (s): of the accelerometers in velocity, of the gyros in tilt."""
    force, tilt = p.velocity_random_walk**2, (x.gravity * p.angle_random_walk) ** 2
    Q = ca.SX(CHAIN, CHAIN)
    Q[0, 0] = force * T**3 / 3 + tilt * T**5 / 20
    Q[0, 1] = Q[1, 0] = force * T**2 / 2 + tilt * T**4 / 8
    Q[0, 2] = Q[2, 0] = tilt * T**3 / 6
    Q[1, 1] = force * T + tilt * T**3 / 3
    Q[1, 2] = Q[2, 1] = tilt * T**2 / 2
    Q[2, 2] = tilt * T
    return Q
