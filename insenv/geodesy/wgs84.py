"""The WGS-84 ellipsoid, its normal gravity, and rounded constants for error models.

Constants of the ellipsoid: NIMA TR8350.2 (2000), tables 3.1, 3.3 and 3.4.
"""

from __future__ import annotations

import casadi as ca

from insenv.core.elementary import Scalar

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
STANDARD_GRAVITY = 9.80665
"""The unit g of data sheets, m/s^2, wherever the sensor is; exact by definition (3rd CGPM, 1901)."""
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
