"""Strapdown mechanization in the wander-azimuth frame: the one shared by every navigating estimator.

Frame w is NED turned about Down by the wander angle and is carried along with zero rate about Down, so nothing is singular
at the poles; position is the quaternion q_ew (w components to e components) and the height.  No trigonometry is evaluated.

Increments are compensated to third order in the sample interval (`insenv.estimators.parts.increments`), and Earth terms stand
at the
middle of the interval.  Source of the wander-azimuth form: Groves (2013), section 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import select
from insenv.core.tables import Row, Table
from insenv.estimators.parts.increments import MEMORY, compensated, remembered

START = Table(
    (
        Row("start_latitude", "Geodetic latitude at the start", "rad", lower=-1.5707963267948966, upper=1.5707963267948966),
        Row("start_longitude", "Longitude at the start", "rad", lower=-6.283185307179586, upper=6.283185307179586),
        Row("start_height", "Height over the ellipsoid at the start", "m", lower=-12e3, upper=1e6),
        Row("start_velocity_n", "Velocity at the start", "m/s", (3,), "n", lower=-1e4, upper=1e4),
        Row("start_roll", "Roll at the start", "rad", lower=-6.283185307179586, upper=6.283185307179586),
        Row("start_pitch", "Pitch at the start", "rad", lower=-6.283185307179586, upper=6.283185307179586),
        Row("start_heading", "Heading at the start", "rad", lower=-6.283185307179586, upper=6.283185307179586),
    )
)
"""The start that every navigating estimator is given."""

STATE = (
    Table(
        (
            Row("q_wb", "Attitude: takes b components to w components", "1", (4,), "w", start=(1, 0, 0, 0)),
            Row("velocity_w", "Velocity over the Earth", "m/s", (3,), "w"),
            Row("q_ew", "Position and wander angle: takes w components to e components", "1", (4,), "e", start=(1, 0, 0, 0)),
            Row("height", "Height over the ellipsoid", "m"),
        )
    )
    + MEMORY
)

OUTPUTS = Table(
    (
        Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", start=(1, 0, 0, 0)),
        Row("velocity_n", "Velocity over the Earth", "m/s", (3,), "n"),
        Row("latitude", "Geodetic latitude", "rad"),
        Row("longitude", "Longitude", "rad"),
        Row("height", "Height over the ellipsoid", "m"),
    )
)


@dataclass(frozen=True)
class Moved:
    """Result of one mechanization step: new state and what error models need.

    q_wb, velocity_w, q_ew, height: the new state.
    delta_velocity_w: integral of the specific force over the sample in w, m/s.  C_wb: attitude at the sample's start.
    omega_ie_w, omega_ew_w: Earth and transport rate at mid-sample, rad/s.
    """

    q_wb: Any
    velocity_w: Any
    q_ew: Any
    height: Any
    delta_velocity_w: Any
    C_wb: Any
    omega_ie_w: Any
    omega_ew_w: Any


def start_state(p: Any) -> dict[str, Any]:
    """State rows of a start given as in `START`; the wander angle is 0 there, so w is NED at the start."""
    return {
        "q_wb": attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading),
        "velocity_w": p.start_velocity_n,
        "q_ew": geodesy.q_ew_from_geodetic(p.start_latitude, p.start_longitude, 0),
        "height": p.start_height,
    }


def move(x: Any, delta_angle: Any, delta_velocity: Any, dt: Any) -> Moved:
    """One sample of the mechanization from state `x` (rows of `STATE`) with compensated increments (rad, m/s, b)."""
    rotation_b, increment_b = compensated(x, delta_angle, delta_velocity)
    C_wb = attitude.to_dcm(x.q_wb)
    increment_w = C_wb @ increment_b

    # Height, place (the Earth's axis as seen from it) and velocity at mid-sample, predicted from the sample's start
    axis = _axis_w(x.q_ew)
    rough_rate = ca.vertcat(x.velocity_w[1], -x.velocity_w[0], 0) * (1 / geodesy.A)
    axis = axis + ca.cross(axis, rough_rate) * (dt / 2)
    gravity_w = ca.vertcat(0, 0, geodesy.normal_gravity(-axis[2], x.height - x.velocity_w[2] * dt / 2))
    omega_ie = geodesy.OMEGA_IE * axis
    rough_coriolis = ca.cross(2 * omega_ie + rough_rate, x.velocity_w)
    middle = x.velocity_w + (increment_w + (gravity_w - rough_coriolis) * dt) / 2
    height_middle = x.height - (x.velocity_w[2] + middle[2]) * dt / 4
    omega_ew = geodesy.transport_rate_about_axis(middle, axis, height_middle)
    coriolis = ca.cross(2 * omega_ie + omega_ew, middle)

    # The w frame turns by `turn` in the sample: on average the increment is seen from half-way
    turn = (omega_ie + omega_ew) * dt
    change = increment_w - ca.cross(turn, increment_w) / 2 + (gravity_w - coriolis) * dt
    velocity = x.velocity_w + change
    mean_velocity = x.velocity_w + change / 2
    omega_ew = geodesy.transport_rate_about_axis(mean_velocity, axis, height_middle)
    turn = (omega_ie + omega_ew) * dt
    q_turn = ca.vertcat(1, -turn / 2)  # |turn| < 1e-5: the next term is below rounding
    q_wb = attitude.multiply(q_turn, attitude.multiply(x.q_wb, attitude.from_small_rotation_vector(rotation_b)))
    q_ew = attitude.multiply(x.q_ew, ca.vertcat(1, omega_ew * dt / 2))
    return Moved(
        q_wb=attitude.renormalize(q_wb),
        velocity_w=velocity,
        q_ew=attitude.renormalize(q_ew),
        height=x.height - mean_velocity[2] * dt,
        delta_velocity_w=increment_w,
        C_wb=C_wb,
        omega_ie_w=omega_ie,
        omega_ew_w=omega_ew,
    )


def moved_rows(moved: Moved, x: Any, delta_angle: Any, delta_velocity: Any) -> dict[str, Any]:
    """State rows after a step."""
    return {
        "q_wb": moved.q_wb,
        "velocity_w": moved.velocity_w,
        "q_ew": moved.q_ew,
        "height": moved.height,
        **remembered(x, delta_angle, delta_velocity),
    }


def navigation_outputs(x: Any) -> dict[str, Any]:
    """Rows of `OUTPUTS` from the state."""
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    q_nw = wander_quaternion(x.q_ew)
    return {
        "q_nb": attitude.multiply(q_nw, x.q_wb),
        "velocity_n": attitude.rotate(q_nw, x.velocity_w),
        "latitude": latitude,
        "longitude": longitude,
        "height": x.height,
    }


def C_nw(q_ew: Any) -> Any:
    """The turn about Down by the wander angle, 3x3: takes w components to n components (identity at a pole)."""
    cos_wander, sin_wander = _wander(q_ew)
    return ca.vertcat(ca.horzcat(cos_wander, -sin_wander, 0), ca.horzcat(sin_wander, cos_wander, 0), ca.horzcat(0, 0, 1))


def wander_quaternion(q_ew: Any) -> Any:
    """q_nw, the same turn as a quaternion."""
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
