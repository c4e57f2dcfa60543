"""Strapdown mechanization in the wander-azimuth frame, shared by every navigating estimator.

Frame w is NED turned about Down by the wander angle and moves with the vehicle without rotation about Down, so nothing
is singular at the poles. Position is the quaternion q_ew (w components to e components) and the height. No trigonometry
is evaluated.

Increments are compensated to third order in the sample interval (`insenv.estimators.parts.strapdown`), and Earth terms
are those of the middle of the interval. Source of the wander-azimuth form: Groves (2013), section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import select
from insenv.core.model import Values
from insenv.core.tables import Row, Table

# Rotation and velocity change of an inertial sample: coning, sculling and rotation compensation.
#
# Rate and specific force of the body are taken as linear in time over the present sample and the one before; the results
# are of third order in the sample interval.
#
# Sources: Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21 (1998), part 1 for coning,
# part 2 for sculling and rotation compensation; the last product of rotation compensation is the second-order term of a
# constant rotation.

MEMORY = Table((
    Row("previous_delta_angle", "Bias-corrected delta angle of the previous sample", "rad", (3,), "b"),
    Row("previous_delta_velocity", "Bias-corrected delta velocity of the previous sample", "m/s", (3,), "b"),
    Row("samples", "Number of samples so far", "1"),
))  # fmt: skip
"""State rows: the previous sample."""


def compensated(x: Any, delta_angle: Any, delta_velocity: Any) -> tuple[Any, Any]:
    """Rotation vector of the sample and its velocity change in the body axes at its start (3, rad; 3, m/s; b).

    x: rows of `MEMORY`. delta_angle, delta_velocity: increments with known errors subtracted.
    """
    # the first sample has no predecessor, so the second counts twice: by the same linear fit to the two samples, coning
    # and sculling of the first equal those of the second
    weight = select(x.samples == 1, 2 / 12, 1 / 12)
    before_angle, before_velocity = x.previous_delta_angle, x.previous_delta_velocity
    rotation = delta_angle + weight * ca.cross(before_angle, delta_angle)
    turned = ca.cross(delta_angle, delta_velocity)
    sculling = ca.cross(before_angle, delta_velocity) + ca.cross(before_velocity, delta_angle)
    return rotation, delta_velocity + 0.5 * turned + (1 / 6) * ca.cross(delta_angle, turned) + weight * sculling


def remembered(x: Any, delta_angle: Any, delta_velocity: Any) -> dict[str, Any]:
    """Rows of `MEMORY` after the sample."""
    return {
        "previous_delta_angle": delta_angle,
        "previous_delta_velocity": delta_velocity,
        "samples": x.samples + 1,
    }


NAVIGATION_STATE = Table((
    Row("q_wb", "Attitude: takes b components to w components", "1", (4,), "w", start=(1, 0, 0, 0)),
    Row("velocity_w", "Velocity over the Earth", "m/s", (3,), "w"),
    Row("q_ew", "Position and wander angle: takes w components to e components", "1", (4,), "e", start=(1, 0, 0, 0)),
    Row("height", "Ellipsoidal height", "m"),
))  # fmt: skip
STATE = NAVIGATION_STATE + MEMORY


@dataclass(frozen=True)
class Moved:
    """Result of one sample of the mechanization: the new state and the terms of error models.

    rows: of the new state, those of `STATE`.
    delta_velocity_w: integral of the specific force over the sample in w, m/s. C_wb: attitude at its start.
    omega_ie_w, omega_ew_w: Earth and transport rate at mid-sample, rad/s.
    """

    rows: dict[str, Any]
    delta_velocity_w: Any
    C_wb: Any
    omega_ie_w: Any
    omega_ew_w: Any


def start_state(p: Any) -> dict[str, Any]:
    """State rows of a start with the rows `rows.START`; the wander angle is 0 there, so w is NED at the start."""
    return {
        "q_wb": attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading),
        "velocity_w": p.start_velocity_n,
        "q_ew": geodesy.q_ew_from_geodetic(p.start_latitude, p.start_longitude, 0),
        "height": p.start_height,
    }


def move(x: Any, delta_angle: Any, delta_velocity: Any, dt: Any) -> Moved:
    """One sample of the mechanization from state `x` (rows of `STATE`); increments (rad, m/s, b) less known errors."""
    rotation_b, increment_b = compensated(x, delta_angle, delta_velocity)
    C_wb = attitude.to_dcm(x.q_wb)
    increment_w = C_wb @ increment_b

    # height, the Earth's axis and velocity at mid-sample, predicted from the start of the sample
    axis = _axis_w(x.q_ew)
    rough_rate = ca.vertcat(x.velocity_w[1], -x.velocity_w[0], 0) * (1 / geodesy.A)
    axis = axis + ca.cross(axis, rough_rate) * (dt / 2)
    gravity_w = geodesy.normal_gravity_about_axis(axis, x.height - x.velocity_w[2] * dt / 2)
    omega_ie = geodesy.OMEGA_IE * axis
    rough_coriolis = ca.cross(2 * omega_ie + rough_rate, x.velocity_w)
    middle = x.velocity_w + (increment_w + (gravity_w - rough_coriolis) * dt) / 2
    height_middle = x.height - (x.velocity_w[2] + middle[2]) * dt / 4
    omega_ew = geodesy.transport_rate_about_axis(middle, axis, height_middle)
    coriolis = ca.cross(2 * omega_ie + omega_ew, middle)

    # frame w turns by `turn` in the sample: on average the increment is seen from half of that
    turn = (omega_ie + omega_ew) * dt
    change = increment_w - ca.cross(turn, increment_w) / 2 + (gravity_w - coriolis) * dt
    mean_velocity = x.velocity_w + change / 2
    omega_ew = geodesy.transport_rate_about_axis(mean_velocity, axis, height_middle)
    turn = (omega_ie + omega_ew) * dt
    q_turn = ca.vertcat(1, -turn / 2)  # |turn| < 1e-5: the next term is below rounding
    q_wb = attitude.multiply(q_turn, attitude.multiply(x.q_wb, attitude.from_small_rotation_vector(rotation_b)))
    q_ew = attitude.multiply(x.q_ew, ca.vertcat(1, omega_ew * dt / 2))
    state = {
        "q_wb": attitude.renormalize(q_wb),
        "velocity_w": x.velocity_w + change,
        "q_ew": attitude.renormalize(q_ew),
        "height": x.height - mean_velocity[2] * dt,
        **remembered(x, delta_angle, delta_velocity),
    }
    return Moved(state, increment_w, C_wb, omega_ie, omega_ew)


def corrected(x: Any, dr: Any, dv: Any, psi: Any) -> dict[str, Any]:
    """State rows of the navigation with an error (w) taken out: position (3, m), velocity (3, m/s), attitude psi (3, rad).

    The way over the ground is an angle at the height that is reached: of `geodesy.position_error` of the true position from the
    estimated one, which filters measure, 100 km and a height 100 km off leave metres, at the estimated height kilometres.
    """
    theta, placed = moved_back(x, dr)
    velocity = x.velocity_w - dv
    return {
        "q_wb": attitude.normalize(attitude.multiply(attitude.from_rotation_vector(psi + theta), x.q_wb)),
        "velocity_w": velocity + ca.cross(theta, velocity),
        **placed,
    }


def moved_back(x: Any, dr: Any) -> tuple[Any, dict[str, Any]]:
    """theta (3, rad, w), and state rows of the position, with an error dr (3, m, w) taken out.

    That turns the computed frame by -theta; platform and velocity are then referred to the new one.
    """
    height = x.height + dr[2]
    theta = geodesy.transport_rate_w(dr, x.q_ew, height)
    q_ew = attitude.multiply(x.q_ew, attitude.from_rotation_vector(-theta))
    return theta, {"q_ew": attitude.normalize(q_ew), "height": height}


def navigation_outputs(x: Any) -> dict[str, Any]:
    """Output rows `rows.NAVIGATION` from the state."""
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    q_nw = wander_quaternion(x.q_ew)
    return {
        "q_nb": attitude.multiply(q_nw, x.q_wb),
        "velocity_n": attitude.rotate(q_nw, x.velocity_w),
        "latitude": latitude,
        "longitude": longitude,
        "height": x.height,
    }


def navigation_error_w(x: Values, truth: Values) -> tuple[Any, Any, Any, Any]:
    """Errors of a state with the rows of `STATE`, estimate minus truth, in w.

    Position (3, m), velocity (3, m/s), rotation of the estimate relative to the truth as seen from e (3, rad), and
    rotation of the computed frame that the position error causes (3, rad).
    """
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    offset_n = geodesy.ned_offset(latitude, longitude, x.height, truth.latitude, truth.longitude, truth.height)
    offset = attitude.rotate_inverse(wander_quaternion(x.q_ew), offset_n)
    q_en = geodesy.q_ew_from_geodetic(truth.latitude, truth.longitude, 0.0)
    q_wn = attitude.multiply(attitude.conjugate(x.q_ew), q_en)  # from n at the true place to w at the computed one
    velocity = x.velocity_w - attitude.rotate(q_wn, truth.velocity_n)
    turn = attitude.error_rotation_vector(x.q_wb, attitude.multiply(q_wn, truth.q_nb))
    return offset, velocity, turn, geodesy.transport_rate_w(offset, x.q_ew, x.height)


def C_nw(q_ew: Any) -> Any:
    """Rotation about Down by the wander angle (3x3): takes w components to n components; the identity at a pole."""
    cos_wander, sin_wander = _wander(q_ew)
    return ca.vertcat(ca.horzcat(cos_wander, -sin_wander, 0), ca.horzcat(sin_wander, cos_wander, 0), ca.horzcat(0, 0, 1))


def wander_quaternion(q_ew: Any) -> Any:
    """q_nw, the same rotation as a quaternion."""
    return attitude.from_dcm(C_nw(q_ew))


def _wander(q_ew: Any) -> tuple[Any, Any]:
    """Cosine and sine of the wander angle: north is where the horizontal part of the Earth's axis points."""
    x, y = _axis_w(q_ew)[0], _axis_w(q_ew)[1]
    length = ca.sqrt(x * x + y * y)
    at_pole = length < 1e-14
    safe = length + at_pole
    return select(at_pole, 1, x / safe), select(at_pole, 0, -y / safe)


def _axis_w(q_ew: Any) -> Any:
    """The Earth's axis in w: third row of C_ew."""
    w, x, y, z = ca.vertsplit(q_ew)
    return ca.vertcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))


# Two gyro samples at once: quaternion recursion of third order and velocity change of the ECEF fine-alignment paper.
#
# The paper's quaternion is Jekeli's, the conjugate of ours: its (31) acts on conj(q_eb), and its (35) is then C_eb. The
# conjugate of ``B(w) conj(q)`` is the Hamilton product ``q (0, w)``, so (30) becomes one product q r with r built from
# three pure quaternions.


def turned(q: Any, first: Any, second: Any) -> Any:
    """q_eb (4) after two samples, of norm 1 within the recursion's error (fourth order): (30).

    first, second: delta angles relative to e (3, rad, b), with the Earth's rotation subtracted as in (28), (29). The rate is
    taken as linear in time: start, middle, end are that times the double interval, (32)-(34).
    """
    start, middle, end = (ca.vertcat(0, w) for w in (3 * first - second, first + second, 3 * second - first))
    product = attitude.multiply
    identity = ca.SX([1, 0, 0, 0])
    r = (
        identity
        + (end + 4 * middle + start) / 12
        + product(product(start, middle), identity + end / 4) / 12
        + product(middle - start / 2, end) / 12
    )
    return product(q, r)


def velocity_change(first: Any, second: Any, first_velocity: Any, second_velocity: Any) -> Any:
    """Integral of C(t) f over the two samples in the body axes at their start (3, m/s).

    first, second: delta angles (3, rad) relative to the target frame of C; the rest: delta velocities (3, m/s,
    b). Rates and specific force are taken as linear in time. Savage, J. Guidance 21 (1998), part 2: rotation
    compensation to second order and two-sample sculling.
    """
    angle, velocity = first + second, first_velocity + second_velocity
    swept = ca.cross(angle, velocity)
    sculling = ca.cross(first, second_velocity) + ca.cross(first_velocity, second)
    return velocity + swept / 2 + ca.cross(angle, swept) / 6 + sculling * (2 / 3)
