"""Rotations as Hamilton quaternions, scalar first, over CasADi symbols; `numeric` has the same functions of NumPy arrays.

``q_nb`` (4x1) and ``C_nb`` (3x3) transform b components to n components: v_n = C_nb v_b. Quaternions are assumed to
have unit length, except by ``normalize`` and ``from_dcm``. Angles are in radians; Euler angles are heading, pitch, roll
about D, E', N'' (3-2-1) from n = NED to b = FRD.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

from insenv.core.elementary import Scalar, atan2, atan_series, cos_half, select, sin_cos, sinc_half, split_half_angles
from insenv.core.numeric import vectorized

_SMALL_SQUARE = 0.25  # rad^2: up to here the series of cos_half and sinc_half are accurate to rounding


def skew(v: ca.SX) -> ca.SX:
    """(3x3) with skew(v) u = v x u."""
    return ca.skew(v)


def multiply(q: ca.SX, p: ca.SX) -> ca.SX:
    """Hamilton product (4x1): q_nb = q_na * q_ab."""
    w, v = q[0], q[1:]
    return ca.vertcat(w * p[0] - ca.dot(v, p[1:]), w * p[1:] + p[0] * v + ca.cross(v, p[1:]))


def conjugate(q: ca.SX) -> ca.SX:
    """Inverse of a unit quaternion (4x1): q_bn from q_nb."""
    return ca.vertcat(q[0], -q[1:])


def normalize(q: ca.SX) -> ca.SX:
    """q scaled to unit length (4x1)."""
    return q / ca.sqrt(ca.sumsqr(q))


def renormalize(q: ca.SX) -> ca.SX:
    """q of norm 1 + e scaled to norm 1 - 3/2 e^2 (4x1): one Newton step, for recursions in which e is rounding."""
    return q * (1.5 - 0.5 * ca.sumsqr(q))


def to_dcm(q: ca.SX) -> ca.SX:
    """C_nb (3x3) of q_nb. Groves 2013, sec. 2.2.3."""
    w, x, y, z = ca.vertsplit(q)
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    wx, wy, wz, xy, xz, yz = w * x, w * y, w * z, x * y, x * z, y * z
    return ca.vertcat(
        ca.horzcat(ww + xx - yy - zz, 2 * (xy - wz), 2 * (xz + wy)),
        ca.horzcat(2 * (xy + wz), ww - xx + yy - zz, 2 * (yz - wx)),
        ca.horzcat(2 * (xz - wy), 2 * (yz + wx), ww - xx - yy + zz),
    )


def from_dcm(C: ca.SX) -> ca.SX:
    """q_nb (4x1, unit, w >= 0) of C_nb (3x3), accurate at every attitude.

    Each row of 4 q q^T is a multiple of q; the row with the greatest diagonal element has a factor of at least 1.
    Shepperd 1978, "Quaternion from rotation matrix", J. Guidance and Control 1(3).
    """
    wx, wy, wz = C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]
    xy, xz, yz = C[0, 1] + C[1, 0], C[0, 2] + C[2, 0], C[1, 2] + C[2, 1]
    ww = 1 + C[0, 0] + C[1, 1] + C[2, 2]
    xx = 1 + C[0, 0] - C[1, 1] - C[2, 2]
    yy = 1 - C[0, 0] + C[1, 1] - C[2, 2]
    zz = 1 - C[0, 0] - C[1, 1] + C[2, 2]
    best, row = ww, ca.vertcat(ww, wx, wy, wz)
    for square, candidate in (
        (xx, ca.vertcat(wx, xx, xy, xz)),
        (yy, ca.vertcat(wy, xy, yy, yz)),
        (zz, ca.vertcat(wz, xz, yz, zz)),
    ):
        better = square > best
        best, row = select(better, square, best), select(better, candidate, row)
    return normalize(_positive(row))


def _positive(q: ca.SX) -> ca.SX:
    """q or -q, which are the same rotation, with a non-negative scalar part."""
    return (1.0 - 2.0 * (q[0] < 0.0)) * q


def rotate(q: ca.SX, v: ca.SX) -> ca.SX:
    """C_nb v_b (3x1) from q_nb and v_b, without the matrix."""
    t = 2 * ca.cross(q[1:], v)
    return v + q[0] * t + ca.cross(q[1:], t)


def rotate_inverse(q: ca.SX, v: ca.SX) -> ca.SX:
    """C_nb^T v_n (3x1) from q_nb and v_n."""
    return rotate(conjugate(q), v)


def from_rotation_vector(phi: ca.SX) -> ca.SX:
    """Quaternion (4x1) of a rotation vector (3x1, rad) of any length; exact and differentiable at 0.

    cos(|phi|/2), sin(|phi|/2) phi/|phi|: Groves 2013, sec. 2.2.4. Below 0.5 rad a series in |phi|^2 is used, which
    needs no square root.
    """
    square = ca.sumsqr(phi)
    small = square < _SMALL_SQUARE
    angle = ca.sqrt(select(small, 1.0, square))
    sin_half, cosine = sin_cos(0.5 * angle)
    near = select(small, square, 0.0)
    return ca.vertcat(
        select(small, cos_half(near), cosine),
        select(small, sinc_half(near), sin_half / angle) * phi,
    )


def from_small_rotation_vector(phi: ca.SX) -> ca.SX:
    """Quaternion (4x1) of a rotation vector up to 0.5 rad: polynomials in |phi|^2, accurate to rounding."""
    square = ca.sumsqr(phi)
    return ca.vertcat(cos_half(square), sinc_half(square) * phi)


def to_rotation_vector(q: ca.SX) -> ca.SX:
    """Shortest rotation vector (3x1, rad) of q; exact and differentiable at 0, of either sign at pi."""
    q = _positive(q)
    w, square = q[0], ca.sumsqr(q[1:])
    small = square < 0.05 * w * w  # tan^2 of half the angle, within the range of the series
    length = ca.sqrt(select(small, 1.0, square))
    w_near, square_near = select(small, w, 1.0), select(small, square, 0.0)
    near = atan_series(square_near / (w_near * w_near)) / w_near
    return 2.0 * select(small, near, atan2(length, w) / length) * q[1:]


def from_euler(roll: Scalar, pitch: Scalar, heading: Scalar) -> ca.SX:
    """q_nb (4x1) of roll, pitch and heading (rad). Groves 2013, sec. 2.2.3."""
    (sr, cr), (sp, cp), (sh, ch) = (sin_cos(0.5 * angle) for angle in (roll, pitch, heading))
    return ca.vertcat(
        cr * cp * ch + sr * sp * sh,
        sr * cp * ch - cr * sp * sh,
        cr * sp * ch + sr * cp * sh,
        cr * cp * sh - sr * sp * ch,
    )


def to_euler(q: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Roll in (-pi, pi], pitch in [-pi/2, pi/2], heading in (-pi, pi] (rad).

    At a pitch of +-90 deg, roll is 0 and heading takes the whole rotation.

    Half the sum and half the difference of roll and heading are the arguments of two points of squared radius 1 -
    sin(pitch) and 1 + sin(pitch): Bernardes and Viollet 2022, "Quaternion to Euler angles conversion", PLoS ONE 17(11).
    The product of the radii is cos(pitch). Pitch therefore keeps full accuracy near +-90 deg, where asin would lose
    half the digits and could receive an argument above 1, and at most one of the two points vanishes. Roll and heading
    are the true ones unless the attitude is within 1.4e-14 rad of vertical, though ill-conditioned near it; they always
    reproduce q to rounding.
    """
    w, x, y, z = ca.vertsplit(q)
    sum_x, sum_y, difference_x, difference_y = w - y, x + z, w + y, x - z
    roll, heading = split_half_angles(sum_x, sum_y, difference_x, difference_y)
    cos_pitch = ca.sqrt((sum_x**2 + sum_y**2) * (difference_x**2 + difference_y**2))
    return roll, atan2(2.0 * (w * y - x * z), cos_pitch), heading


def error_rotation_vector(q_estimate: ca.SX, q_true: ca.SX) -> ca.SX:
    """Rotation vector (3x1, rad, in n) of q_estimate * conj(q_true): it turns the truth into the estimate."""
    return to_rotation_vector(multiply(q_estimate, conjugate(q_true)))


numeric = SimpleNamespace(
    skew=vectorized(skew, 3),
    multiply=vectorized(multiply, 4, 4),
    conjugate=vectorized(conjugate, 4),
    normalize=vectorized(normalize, 4),
    to_dcm=vectorized(to_dcm, 4),
    from_dcm=vectorized(from_dcm, (3, 3)),
    rotate=vectorized(rotate, 4, 3),
    rotate_inverse=vectorized(rotate_inverse, 4, 3),
    from_rotation_vector=vectorized(from_rotation_vector, 3),
    from_small_rotation_vector=vectorized(from_small_rotation_vector, 3),
    to_rotation_vector=vectorized(to_rotation_vector, 4),
    from_euler=vectorized(from_euler, (), (), ()),
    to_euler=vectorized(to_euler, 4),
    error_rotation_vector=vectorized(error_rotation_vector, 4, 4),
)
"""The functions for NumPy arrays, broadcasting over leading axes: one namespace, ``attitude.numeric.to_dcm(q)``."""
