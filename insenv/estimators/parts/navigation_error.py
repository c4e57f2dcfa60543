"""The error of a navigation state in the wander-azimuth frame, against the truth."""

from __future__ import annotations

from typing import Any

from insenv import attitude, geodesy
from insenv.core.model import Values
from insenv.estimators.parts import strapdown


def navigation_error_w(x: Values, truth: Values) -> tuple[Any, Any, Any, Any]:
    """Errors of a state with the rows of `strapdown.STATE`, estimate minus truth, in w.

    Position (3, m), velocity (3, m/s), rotation of the estimate against the truth as seen from e (3, rad), and rotation of
    the computed frame that the position error causes (3, rad).
    """
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    offset_n = geodesy.ned_offset(latitude, longitude, x.height, truth.latitude, truth.longitude, truth.height)
    offset = attitude.rotate_inverse(strapdown.wander_quaternion(x.q_ew), offset_n)
    q_en = geodesy.q_ew_from_geodetic(truth.latitude, truth.longitude, 0.0)
    q_wn = attitude.multiply(attitude.conjugate(x.q_ew), q_en)  # from n at the true place to w at the computed one
    velocity = x.velocity_w - attitude.rotate(q_wn, truth.velocity_n)
    turn = attitude.error_rotation_vector(x.q_wb, attitude.multiply(q_wn, truth.q_nb))
    return offset, velocity, turn, geodesy.transport_rate_w(offset, x.q_ew, x.height)
