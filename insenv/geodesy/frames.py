"""Frames n (north-east-down) and w (wander azimuth) on the ellipsoid, and their rates.

w is n rotated about down by the wander angle alpha: its x axis points alpha east of north, so C_nw is the rotation
about +down by +alpha, [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], and heading in n = heading in w + alpha. Frame w does
not rotate about its down axis relative to the Earth (omega_ew has no down component), so that its mechanization has no
singularity: every function below with an argument q_ew works at the poles.
"""

from __future__ import annotations

import casadi as ca

from insenv.attitude import split_half_angles, to_dcm
from insenv.core.elementary import PI, Scalar, atan2, sin_cos
from insenv.geodesy.wgs84 import E2, OMEGA_IE, radii


def earth_rate_n(latitude: Scalar) -> ca.SX:
    """omega_ie^n (3x1, rad/s). Groves 2013, eq. (2.123)."""
    s, c = sin_cos(latitude)
    return OMEGA_IE * ca.vertcat(c, 0.0, -s)


def transport_rate_n(velocity_n: ca.SX, latitude: Scalar, height: Scalar) -> ca.SX:
    """omega_en^n (3x1, rad/s) at velocity_n (3x1, m/s); singular at the poles. Groves 2013, eq. (5.44)."""
    s, c = sin_cos(latitude)
    R_M, R_N = radii(s)
    north, east = velocity_n[0], velocity_n[1]
    return ca.vertcat(east / (R_N + height), -north / (R_M + height), -east * s / (c * (R_N + height)))


def C_en(latitude: Scalar, longitude: Scalar) -> ca.SX:
    """Matrix (3x3) from n components to e components. Groves 2013, eq. (2.150), transposed."""
    (s, c), (sl, cl) = sin_cos(latitude), sin_cos(longitude)
    return ca.vertcat(
        ca.horzcat(-s * cl, -sl, -c * cl),
        ca.horzcat(-s * sl, cl, -c * sl),
        ca.horzcat(c, 0.0, -s),
    )


def C_ew(latitude: Scalar, longitude: Scalar, wander: Scalar) -> ca.SX:
    """Matrix (3x3) from w components to e components, C_en C_nw."""
    s, c = sin_cos(wander)
    C_nw = ca.vertcat(ca.horzcat(c, -s, 0.0), ca.horzcat(s, c, 0.0), ca.horzcat(0.0, 0.0, 1.0))
    return ca.mtimes(C_en(latitude, longitude), C_nw)


def q_ew_from_geodetic(latitude: Scalar, longitude: Scalar, wander: Scalar) -> ca.SX:
    """Quaternion (4x1) of C_ew: rotations about z by longitude, y by -(90 deg + latitude), z by wander angle."""
    s, c = sin_cos(0.5 * latitude + 0.25 * PI)
    sin_sum, cos_sum = sin_cos(0.5 * (longitude + wander))
    sin_difference, cos_difference = sin_cos(0.5 * (longitude - wander))
    return ca.vertcat(c * cos_sum, s * sin_difference, -s * cos_difference, c * sin_sum)


def geodetic_from_q_ew(q_ew: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Latitude in [-pi/2, pi/2], longitude and wander angle in (-pi, pi] (rad).

    Within 0.2 um of a pole the longitude is 0 and the wander angle takes the whole rotation.

    Half the sum and half the difference of longitude and wander angle are the arguments of two points in q_ew (see
    q_ew_from_geodetic) with radii cos and sin of (latitude + 90 deg)/2, one of which vanishes at each pole. The
    latitude keeps full accuracy there.
    """
    w, x, y, z = ca.vertsplit(q_ew)
    longitude, wander = split_half_angles(w, z, -y, x)
    c2, s2 = w * w + z * z, x * x + y * y
    return atan2(s2 - c2, 2.0 * ca.sqrt(s2 * c2)), longitude, wander


def transport_rate_w(velocity_w: ca.SX, q_ew: ca.SX, height: Scalar) -> ca.SX:
    """omega_ew^w (3x1, rad/s), its down component zero, at velocity_w (3x1, m/s). Valid at the poles.

    The horizontal curvature is 1/(R_N + h) in every direction plus 1/(R_M + h) - 1/(R_N + h) along north. That
    difference is e^2 cos^2(latitude) R_M / ((1 - e^2)(R_M + h)(R_N + h)), and cos(latitude) times the w components of
    north are elements of C_ew, so that neither the wander angle nor the latitude is needed.
    """
    return transport_rate_about_axis(velocity_w, to_dcm(q_ew)[2, :].T, height)


def transport_rate_about_axis(velocity_w: ca.SX, axis_w: ca.SX, height: Scalar) -> ca.SX:
    """`transport_rate_w` from the Earth's axis in w (3x1, unit), all that it needs of the position."""
    north_x, north_y, sin_latitude = axis_w[0], axis_w[1], -axis_w[2]
    R_M, R_N = radii(sin_latitude)
    per_metre = 1.0 / (R_N + height)
    along_north = north_x * velocity_w[0] + north_y * velocity_w[1]
    excess = E2 / (1.0 - E2) * R_M / (R_M + height) * per_metre * along_north
    return ca.vertcat(
        per_metre * velocity_w[1] + excess * north_y,
        -(per_metre * velocity_w[0] + excess * north_x),
        0.0,
    )


def earth_rate_w(q_ew: ca.SX) -> ca.SX:
    """omega_ie^w (3x1, rad/s): the Earth's rate along the last row of C_ew."""
    return OMEGA_IE * to_dcm(q_ew)[2, :].T
