"""Positions: geodetic, Earth-centred, and in metres from a reference point without loss of digits."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import casadi as ca

from insenv.core.elementary import Scalar, atan2, sin_cos, wrap_angle
from insenv.core.tables import Row
from insenv.geodesy.wgs84 import E2, A, B, F, radii

_BOWRING_ITERATIONS = 2
_OFFSET_ITERATIONS = 3


def geodetic_to_ecef(latitude: Scalar, longitude: Scalar, height: Scalar) -> ca.SX:
    """r_e (3x1, m). Groves 2013, eq. (2.112)."""
    (s, c), (sl, cl) = sin_cos(latitude), sin_cos(longitude)
    R_N = radii(s)[1]
    p = (R_N + height) * c
    return ca.vertcat(p * cl, p * sl, ((1.0 - E2) * R_N + height) * s)


def ecef_to_geodetic(r_e: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Latitude, longitude in [-pi, pi] (0 at the poles) and height of r_e (3x1, m), from -10 km up.

    Bowring's iteration (1976, "Transformation from spatial to geographical coordinates") on the direction (cos, sin) of
    the reduced latitude rather than its tangent, so that the poles are regular points. The error is at rounding level
    up to 1000 km.
    """
    x, y, z = r_e[0], r_e[1], r_e[2]
    p = ca.sqrt(x * x + y * y)
    along, across = _unit(p * (1.0 - F), z)  # reduced latitude: exact on the ellipsoid, approximate elsewhere
    for _ in range(_BOWRING_ITERATIONS):
        c, s = _unit(p - E2 * A * along * along * along, z + E2 / (1.0 - E2) * B * across * across * across)
        along, across = _unit(c, (1.0 - F) * s)
    R_N = radii(s)[1]
    height = (p - R_N * c) * c + (z - (1.0 - E2) * R_N * s) * s
    return atan2(s, c), atan2(y, x), height


def _unit(x: Scalar, y: Scalar) -> tuple[Scalar, Scalar]:
    length = ca.sqrt(x * x + y * y)
    return x / length, y / length


def _meridian_offset(
    s0: Scalar, c0: Scalar, height0: Scalar, delta_latitude: Scalar, delta_height: Scalar
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Change of (distance from the axis, z) (m) along a meridian, free of cancellation; sine and cosine at its end.

    s0, c0: sine and cosine of the latitude at the start. Differences of sines and cosines are products with the sine of
    half the difference; the difference of R_N follows from R_N - R_N0 = a e^2 (s^2 - s0^2) / (W W0 (W + W0)) with W =
    sqrt(1 - e^2 s^2) = a / R_N.
    """
    sin_half, cos_half = sin_cos(0.5 * delta_latitude)
    delta_s = 2.0 * sin_half * (c0 * cos_half - s0 * sin_half)
    delta_c = -2.0 * sin_half * (s0 * cos_half + c0 * sin_half)
    s, c = s0 + delta_s, c0 + delta_c
    R_N, R_N0 = radii(s)[1], radii(s0)[1]
    delta_R_N = E2 / (A * A) * delta_s * (s + s0) * (R_N * R_N) * (R_N0 * R_N0) / (R_N + R_N0)
    delta_p = (delta_R_N + delta_height) * c + (R_N0 + height0) * delta_c
    delta_z = ((1.0 - E2) * delta_R_N + delta_height) * s + ((1.0 - E2) * R_N0 + height0) * delta_s
    return delta_p, delta_z, s, c


def ned_offset(
    latitude: Scalar,
    longitude: Scalar,
    height: Scalar,
    latitude0: Scalar,
    longitude0: Scalar,
    height0: Scalar,
) -> ca.SX:
    """C_en(latitude0, longitude0)^T (r_e - r_e0) (3x1, m): a position in the tangent frame of a reference.

    Exact at any distance. Near the reference the resolution is that of latitude and longitude themselves (1e-9 m),
    whereas each of two ECEF positions has a rounding error of 1e-9 m. The shorter difference of longitude is taken.
    """
    s0, c0 = sin_cos(latitude0)
    delta_p, delta_z, _, _ = _meridian_offset(s0, c0, height0, latitude - latitude0, height - height0)
    p = (radii(s0)[1] + height0) * c0 + delta_p
    sin_half, cos_half = sin_cos(0.5 * wrap_angle(longitude - longitude0))
    outward = delta_p - 2.0 * p * sin_half * sin_half  # in the meridian plane of the reference, away from the axis
    return ca.vertcat(
        c0 * delta_z - s0 * outward,
        2.0 * p * sin_half * cos_half,
        -(c0 * outward + s0 * delta_z),
    )


def position_error(
    latitude: Scalar,
    longitude: Scalar,
    height: Scalar,
    latitude0: Scalar,
    longitude0: Scalar,
    height0: Scalar,
) -> ca.SX:
    """North, east, down (3x1, m) of a position less a reference: down is the difference of the heights.

    North and east are those of `ned_offset`. Its down leaves the ellipsoid with the square of the distance: 0.8 m at
    3.2 km, 800 m at 100 km, at equal heights.
    """
    offset = ned_offset(latitude, longitude, height, latitude0, longitude0, height0)
    return ca.vertcat(offset[0], offset[1], height0 - height)


def geodetic_from_ned_offset(
    offset: ca.SX, latitude0: Scalar, longitude0: Scalar, height0: Scalar
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Latitude, longitude (rad), height (m) of a position (3x1, m) in the frame of a reference; inverse of ned_offset.

    For offsets up to 100 km (error below 1e-9 m), also across a pole or the date line. The longitude has a closed form;
    in the meridian plane Newton's iteration on the local normal and radius of curvature converges quadratically.
    """
    north, east, down = offset[0], offset[1], offset[2]
    s0, c0 = sin_cos(latitude0)
    p0 = (radii(s0)[1] + height0) * c0
    outward = -s0 * north - c0 * down
    # the distance p from the axis, as a difference: p^2 - p0^2 = 2 p0 outward + outward^2 + east^2
    p = ca.sqrt((p0 + outward) * (p0 + outward) + east * east)
    sum_p = p + p0
    delta_p = (outward * (2.0 * p0 + outward) + east * east) / (sum_p + (sum_p == 0.0))
    delta_z = c0 * north - s0 * down

    s, c, delta_latitude, delta_height, rest_p, rest_z = s0, c0, 0.0, 0.0, delta_p, delta_z
    for _ in range(_OFFSET_ITERATIONS):
        radius = radii(s)[0] + height0 + delta_height
        delta_latitude = delta_latitude + (c * rest_z - s * rest_p) / radius
        delta_height = delta_height + (c * rest_p + s * rest_z)
        reached_p, reached_z, s, c = _meridian_offset(s0, c0, height0, delta_latitude, delta_height)
        rest_p, rest_z = delta_p - reached_p, delta_z - reached_z
    longitude = wrap_angle(longitude0 + atan2(east, p0 + outward))
    return latitude0 + delta_latitude, longitude, height0 + delta_height


# The rows of a place: latitude, longitude and ellipsoidal height, in every table that has one.

_BOUNDS = ((-pi / 2, pi / 2), (-2 * pi, 2 * pi), (-12e3, 1e6))
"""Of latitude (rad), longitude (rad) and height (m), where a user gives them."""


def place_rows(prefix: str = "", of: str = "") -> tuple[Row, Row, Row]:
    """Rows ``PREFIXlatitude``, ``PREFIXlongitude`` (rad) and ``PREFIXheight`` (m) without bounds; `of` ends the meanings."""
    return (
        Row(f"{prefix}latitude", f"Geodetic latitude{of}", "rad"),
        Row(f"{prefix}longitude", f"Longitude{of}", "rad"),
        Row(f"{prefix}height", f"Height above the WGS-84 ellipsoid{of}", "m"),
    )


def bounded_place_rows(prefix: str = "", of: str = "") -> tuple[Row, Row, Row]:
    """`place_rows` with the bounds of places that a user may give."""
    latitude, longitude, height = (
        replace(row, lower=lower, upper=upper) for row, (lower, upper) in zip(place_rows(prefix, of), _BOUNDS, strict=True)
    )
    return latitude, longitude, height
