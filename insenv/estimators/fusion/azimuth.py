"""An unknown heading as an unknown direction of the Earth's rotation: linear, from any heading.

The horizontal part of the Earth's rotation shows the heading of a vehicle in place.  A filter with the heading among its errors
is linearised about an assumed heading: what it learns before it knows the heading is lost or wrong.  Here the assumed azimuth
of the axes w stays, and the error is that of the horizontal rotation in w, e.  Gravity, sway and gyros are measured in w, and e
enters the rate of the level as a gyro bias does, so the filter is linear at any heading.  The heading is the direction of the
estimate h = h_assumed + e; its standard deviation is that of the component across h, over the length of h.

The error of the attitude about the vertical is that of the vertical gyro alone, 0 at the start.

Source of the idea: Scherzinger, "Inertial navigator error models for large heading uncertainty", Proc. IEEE PLANS (1996), where
sine and cosine of the wander angle are states.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, radians
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.base.remarks import declared
from insenv.core.elementary import atan2, exp, maximum, minimum, sin_cos
from insenv.core.model import Values
from insenv.core.tables import Row
from insenv.estimators.fusion import omitted
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.moored import displacement
from insenv.estimators.parts import rows, strapdown
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY
from insenv.estimators.parts.finding import Finding, Reached
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA

WIDER = 2.0
"""Factor on the standard deviation along the assumed heading, which a small error of the heading changes to second order: the
square of a normal error is far from normal."""
LEAST_RATE_SHARE = 0.3
"""Of the horizontal part of the Earth's rotation: a shorter estimate of it counts as one of this length, since it shows no
heading."""
KNOWN_HEADING = radians(1.0)
"""rad: a heading that is known so well counts as found."""
ALLOWED = frozenset({"moored", "barometer"})
"""Aids that need no direction of north."""


def _moments(p: Any) -> tuple[Any, Any, Any]:
    """Mean along the assumed north, and standard deviations along it and across, of the normalised horizontal rotation."""
    variance = minimum(p.heading_sigma, 10.0) ** 2
    mean, square = exp(-variance / 2), exp(-2 * variance)
    along = minimum(WIDER**2 * maximum((1 + square) / 2 - mean**2, 0.0), 0.5)
    return mean, ca.sqrt(along), ca.sqrt(maximum(1 - square, 0.0) / 2)


def turned_variance(p: Any, vector_n: Any) -> Any:
    """Variance of each horizontal component that the unknown azimuth gives a vector (3, n) stated at the start."""
    return (1 - _moments(p)[0]) * ca.sumsqr(vector_n[:2])


def _horizontal_n(p: Any) -> Any:
    """Of the Earth's rotation at the start (rad/s)."""
    return geodesy.OMEGA_IE * sin_cos(p.start_latitude)[1]


def _started(p: Any) -> Any:
    return _horizontal_n(p) * ca.vertcat(_moments(p)[0] - 1, 0)


def _started_sigma(p: Any) -> Any:
    _, along, across = _moments(p)
    return _horizontal_n(p) * ca.vertcat(along, across)


STATE = ErrorState(
    Row("azimuth_rate", "Estimated horizontal Earth rate less that of the assumed azimuth", "rad/s", (2,), "w"),
    sigma="heading_sigma",
    rows=rows.chosen(rows.START_SIGMAS, "heading_sigma"),
    started=_started,
    started_sigma=_started_sigma,
    rate_w=lambda value: ca.vertcat(value, 0),
)


def folded(x: Any, P: Any, places: Mapping[str, slice]) -> tuple[Values, Any]:
    """The navigation state with the azimuth that the estimate shows, and the covariance (9 x 9, w) of its errors.

    x: state rows.  P: covariance (n x n).  The vectors in w stay; that w is turned, so the errors of position and velocity
    turn with that of the azimuth, the displacement about the place at the start.
    """
    assumed = geodesy.earth_rate_w(x.q_ew)
    h = assumed[:2] + x.azimuth_rate
    full, direction = ca.norm_2(assumed[:2]), atan2(h[1], h[0])
    turn = atan2(assumed[1], assumed[0]) - direction
    sine, cosine = sin_cos(turn / 2)
    q_ew = attitude.normalize(attitude.multiply(x.q_ew, ca.SX(ca.vertcat(cosine, 0, 0, sine))))
    displaced = displacement(x)
    back = strapdown.C_nw(q_ew).T @ strapdown.C_nw(x.q_ew) @ displaced - displaced
    turned = Values(**{**vars(x), "q_ew": q_ew})
    _, placed = strapdown.moved_back(turned, back)

    sine, cosine = sin_cos(direction)
    length = maximum(minimum(ca.norm_2(h), full), maximum(LEAST_RATE_SHARE * full, 1e-12))
    across = ca.horzcat(-sine, cosine) / length
    T = ca.SX(9, P.shape[0])
    T[:9, :9] = ca.SX.eye(9)
    vertical, place = ca.SX([0, 0, 1]), places[STATE.name]
    T[POSITION, place] = skew(vertical) @ displaced @ across
    T[VELOCITY, place] = skew(vertical) @ x.velocity_w @ across
    T[TILT, place] = -vertical @ across
    P = T @ P @ T.T
    second = omitted.moment(P[TILT, TILT][2, 2])
    for part, vector in ((POSITION, displaced), (VELOCITY, x.velocity_w)):
        P[part, part] = P[part, part] + second * ca.sumsqr(vector[:2]) * ca.diag([1, 1, 0])
    return Values(**{**vars(turned), **placed}), P


_HEADING_NOT_SHOWN = declared(
    "heading-not-shown",
    f"the heading is not found to {degrees(KNOWN_HEADING):.2g} deg (1 sigma): the rotation of the Earth shows it in minutes, "
    "to gyros with a bias far below its horizontal part",
)
_HEADING_SHOWN = declared(
    "heading-by-earth-rate", "heading found after {time} s, to {sigma} deg (1 sigma), by the rotation of the Earth"
)


def findings(parameters: Mapping[str, Any]) -> tuple[Finding | Reached, ...]:
    """Remarks on the heading: unknown at the end, or known from when on; none where it was known as well at the start."""
    if float(parameters["heading_sigma"]) <= KNOWN_HEADING:
        return ()
    scale = (np.inf, np.inf, KNOWN_HEADING)
    return Finding("attitude_sigma", _HEADING_NOT_SHOWN, scale=scale), Reached("attitude_sigma", _HEADING_SHOWN, scale)


def stated(sigma: Any) -> Any:
    """Standard deviations of the attitude (3, rad): of a heading that is unknown, at most that of a uniform one."""
    return ca.vertcat(sigma[:2], minimum(sigma[2], LARGEST_HEADING_SIGMA))
