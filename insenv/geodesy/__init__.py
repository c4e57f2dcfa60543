"""Functions of the Earth over CasADi symbols, and its constants; `numeric` has the functions of NumPy arrays.

Frames: n = north-east-down, e = Earth-centred Earth-fixed, w = wander azimuth. Latitude, longitude and wander angle are in
radians, heights above the WGS-84 ellipsoid and positions in metres.

w is n rotated about down by the wander angle alpha: its x axis points alpha east of north, so C_nw is the rotation
about +down by +alpha, [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], and heading in n = heading in w + alpha. Frame w does
not rotate about its down axis relative to the Earth (omega_ew has no down component), so that its mechanization has no
singularity: every function below with an argument q_ew works at the poles.

Constants of the ellipsoid: NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca

from insenv.base.units import STANDARD_GRAVITY as STANDARD_GRAVITY
from insenv.core.elementary import PI, Scalar, atan2, sin_cos, split_half_angles, wrap_angle
from insenv.core.numeric import vectorized
from insenv.core.tables import Row

A = 6378137.0
"""Semi-major axis, m."""
F = 1.0 / 298.257223563
"""Flattening."""
B = A * (1.0 - F)
"""Semi-minor axis, m."""
E2 = F * (2.0 - F)
"""First eccentricity squared."""
POLAR_RADIUS = A * A / B
"""Radius of curvature at the poles, the largest of a meridian, m."""
OMEGA_IE = 7.292115e-5
"""Rotation rate of the Earth, rad/s."""
GM = 3.986004418e14
"""Gravitational constant of the Earth and its atmosphere, m^3/s^2."""
GAMMA_EQUATOR = 9.7803253359
"""Normal gravity on the ellipsoid at the equator, m/s^2."""
GAMMA_POLE = 9.8321849378
"""Normal gravity on the ellipsoid at the poles, m/s^2."""
SOMIGLIANA = B * GAMMA_POLE / (A * GAMMA_EQUATOR) - 1.0
"""k of Somigliana's formula."""
M = OMEGA_IE * OMEGA_IE * A * A * B / GM
"""m = omega^2 a^2 b / GM, about the ratio of centrifugal to gravitational acceleration at the equator."""
NOMINAL_GRAVITY = 9.8
"""Gravity to two digits, m/s^2: for error models, in which 0.3 % does not matter."""
MEAN_RADIUS = 6371e3
"""Mean radius of the Earth, m: for error models and distances of a few kilometres."""


def radii(sin_latitude: Scalar) -> tuple[Scalar, Scalar]:
    """Radii of curvature (m) of the meridian and the prime vertical. Groves 2013, eqs. (2.105), (2.106)."""
    square = 1.0 - E2 * sin_latitude * sin_latitude
    R_N = A / ca.sqrt(square)
    return R_N * (1.0 - E2) / square, R_N


def normal_gravity(sin_latitude: Scalar, height: Scalar) -> Scalar:
    """Magnitude of normal gravity (m/s^2) at a height (m) above the ellipsoid, including the centrifugal part.

    Somigliana's formula, exact on the ellipsoid, with the second-order height term: NIMA TR8350.2, eqs.
    (4-1), (4-3); Heiskanen and Moritz 1967, eqs. (2-78), (2-123). Error against the
    gradient of the exact ellipsoidal potential: 6e-11 m/s^2 at height 0, 1.0e-7 at 1 km, 7e-7 at 10 km, 4.6e-6 at 30
        km.
    """
    square = sin_latitude * sin_latitude
    at_surface = GAMMA_EQUATOR * (1.0 + SOMIGLIANA * square) / ca.sqrt(1.0 - E2 * square)
    relative = height / A
    slope = 2.0 * (1.0 + F + M) - 4.0 * F * square
    return at_surface * (1.0 - relative * (slope - 3.0 * relative))


def normal_gravity_about_axis(axis: ca.SX, height: Scalar) -> ca.SX:
    """Normal gravity (3x1, m/s^2), including the centrifugal part, in a local-level frame with the Earth's axis `axis`.

    axis (3x1, unit): (cos L, 0, -sin L) in n; in frame w the last row of C_ew. height: m above the ellipsoid.

    Down: `normal_gravity`. Above the ellipsoid the plumb line bends, and gravity has a horizontal part towards the equator.
    The field is conservative, so that part follows from the other one along the normal: d((R_M + h) g_N)/dh = dg_U/dL with
    g_N = 0 on the ellipsoid (Heiskanen and Moritz 1967, section 5-4). Its series to second order in e^2 and in h / a is

        g_N = -sin L cos L (h / a) (n_0 + n_1 sin^2 L + n_2 h / a)

    Error of g_N against the gradient of the exact ellipsoidal potential: 6e-10 m/s^2 at 10 km, 6e-9 at 30 km.
    """
    sin_latitude = -axis[2]
    relative = height / A
    factors = _NORTH[0] + _NORTH[1] * (sin_latitude * sin_latitude) + _NORTH[2] * relative
    per_cosine = sin_latitude * relative * factors
    return ca.vertcat(-per_cosine * axis[0], -per_cosine * axis[1], normal_gravity(sin_latitude, height))


def normal_gravity_e(C_en: ca.SX, height: Scalar) -> ca.SX:
    """Normal gravity (3x1, m/s^2, e) where C_en (3x3) takes n to e components; height: m above the ellipsoid."""
    return C_en @ normal_gravity_about_axis(C_en[2, :].T, height)


GRAVITY_CHANGE = 2.0 * SOMIGLIANA + E2
"""Twice the relative change of normal gravity with sin^2 L, at the equator: dg/dL is GRAVITY_CHANGE g sin L cos L to 1 %."""
_NORTH = (
    GAMMA_EQUATOR * GRAVITY_CHANGE / (1.0 - E2),
    -GAMMA_EQUATOR * SOMIGLIANA * E2 / (1.0 - E2),
    GAMMA_EQUATOR * (4.0 * F - (2.0 + F + M) * GRAVITY_CHANGE),
)
"""n_0, n_1, n_2 of `normal_gravity_about_axis`, m/s^2."""


def normal_gravity_paper(sin_latitude: Scalar, height: Scalar) -> Scalar:
    """Gravity (m/s^2) by formula (5) of the airborne navigation paper: a series in sin^2(latitude), linear in height
    (m).

    The digits are those printed. The coefficient 0.00527094 seems to be the 0.00527904 of the series of 1980 with two
    digits exchanged: the result is 8e-5 m/s^2 below normal_gravity at the poles and agrees with it at the equator.
    """
    square = sin_latitude * sin_latitude
    return 9.7803267714 * (1.0 + 0.00527094 * square + 0.0000232718 * square * square) - 0.3086e-5 * height


# Frames n and w on the ellipsoid, and their rates.


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


def axis_w(q_ew: ca.SX) -> ca.SX:
    """The Earth's axis in w (3x1, unit, towards north): the last row of C_ew. Groves 2013, sec. 2.2.3."""
    w, x, y, z = ca.vertsplit(q_ew)
    return ca.vertcat(2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z)


def transport_rate_w(velocity_w: ca.SX, q_ew: ca.SX, height: Scalar) -> ca.SX:
    """omega_ew^w (3x1, rad/s), its down component zero, at velocity_w (3x1, m/s). Valid at the poles.

    The horizontal curvature is 1/(R_N + h) in every direction plus 1/(R_M + h) - 1/(R_N + h) along north. That
    difference is e^2 cos^2(latitude) R_M / ((1 - e^2)(R_M + h)(R_N + h)), and cos(latitude) times the w components of
    north are elements of C_ew, so that neither the wander angle nor the latitude is needed.
    """
    return transport_rate_about_axis(velocity_w, axis_w(q_ew), height)


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
    """omega_ie^w (3x1, rad/s)."""
    return OMEGA_IE * axis_w(q_ew)


# Positions: geodetic, Earth-centred, and in metres from a reference point without loss of digits.

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

_BOUNDS = ((-PI / 2, PI / 2), (-2 * PI, 2 * PI), (-12e3, 1e6))
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


numeric = SimpleNamespace(
    radii=vectorized(radii, ()),
    normal_gravity=vectorized(normal_gravity, (), ()),
    normal_gravity_about_axis=vectorized(normal_gravity_about_axis, 3, ()),
    normal_gravity_paper=vectorized(normal_gravity_paper, (), ()),
    earth_rate_n=vectorized(earth_rate_n, ()),
    transport_rate_n=vectorized(transport_rate_n, 3, (), ()),
    C_en=vectorized(C_en, (), ()),
    C_ew=vectorized(C_ew, (), (), ()),
    q_ew_from_geodetic=vectorized(q_ew_from_geodetic, (), (), ()),
    geodetic_from_q_ew=vectorized(geodetic_from_q_ew, 4),
    transport_rate_w=vectorized(transport_rate_w, 3, 4, ()),
    earth_rate_w=vectorized(earth_rate_w, 4),
    geodetic_to_ecef=vectorized(geodetic_to_ecef, (), (), ()),
    ecef_to_geodetic=vectorized(ecef_to_geodetic, 3),
    ned_offset=vectorized(ned_offset, (), (), (), (), (), ()),
    geodetic_from_ned_offset=vectorized(geodetic_from_ned_offset, 3, (), (), ()),
    position_error=vectorized(position_error, (), (), (), (), (), ()),
)
"""The functions for NumPy arrays, broadcasting over leading axes: ``geodesy.numeric.ned_offset(...)``."""
