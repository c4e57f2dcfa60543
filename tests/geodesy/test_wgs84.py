"""The Earth's figure and gravity: published constants, and the closed potential of the ellipsoid."""

import numpy as np
import pytest

from insenv import geodesy
from insenv.geodesy import numeric


def test_published_constants():
    assert pytest.approx(6356752.314245, abs=1e-6) == geodesy.B
    assert pytest.approx(6.69437999014e-3, abs=1e-14) == geodesy.E2
    assert pytest.approx(0.00193185265241, abs=1e-11) == geodesy.SOMIGLIANA
    assert pytest.approx(0.00344978650684, abs=1e-14) == geodesy.M
    R_M, R_N = numeric.radii(np.array([0.0, 1.0]))
    np.testing.assert_allclose(R_N, [geodesy.A, 6399593.6258], rtol=0, atol=1e-4)
    np.testing.assert_allclose(R_M, [6335439.3273, 6399593.6258], rtol=0, atol=1e-4)


def exact_normal_gravity(sin_lat, h):
    """Exact normal gravity, north and down (m/s^2), from the potential in ellipsoidal coordinates (u, beta).

    Heiskanen and Moritz 1967, eqs. (2-62), (2-66): needs neither Somigliana's formula nor its gammas.
    """
    LD = np.longdouble
    a, f, GM, omega = LD(6378137), 1 / LD("298.257223563"), LD("3.986004418e14"), LD("7.292115e-5")
    b = a * (1 - f)
    E = np.sqrt(a * a - b * b)
    s = np.asarray(sin_lat, LD)
    R_N = a * a / np.sqrt(a * a * (1 - s * s) + b * b * s * s)
    p, z = (R_N + h) * np.sqrt(1 - s * s), (b * b / (a * a) * R_N + h) * s
    k = p * p + z * z - E * E
    u = np.sqrt(k / 2 * (1 + np.sqrt(1 + 4 * E * E * z * z / (k * k))))
    v2 = u * u + E * E
    sin_beta, cos_beta = z / u, p / np.sqrt(v2)

    def q(t):
        return ((1 + 3 * t * t / (E * E)) * np.arctan(E / t) - 3 * t / E) / 2

    q_prime = 3 * (1 + u * u / (E * E)) * (1 - u / E * np.arctan(E / u)) - 1
    w = np.sqrt((u * u + E * E * sin_beta**2) / v2)
    centre = omega**2 * a * a
    along_u = GM / v2 + centre * E / v2 * q_prime / q(b) * (sin_beta**2 / 2 - LD(1) / 6) - omega**2 * u * cos_beta**2
    along_beta = (centre / np.sqrt(v2) * q(u) / q(b) - omega**2 * np.sqrt(v2)) * sin_beta * cos_beta
    # minus along_u and plus along_beta, along the unit vectors of u and beta, outward and towards the pole
    c, out, over = np.sqrt(1 - s * s), u * cos_beta / np.sqrt(v2), sin_beta
    outward = (-along_u * out / w - along_beta * over / w) / w
    axial = (-along_u * over / w + along_beta * out / w) / w
    return (c * axial - s * outward).astype(float), (-c * outward - s * axial).astype(float)


def test_normal_gravity_on_the_ellipsoid():
    assert numeric.normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-15)
    assert numeric.normal_gravity([-1.0, 1.0], 0.0) == pytest.approx(9.8321849378, abs=3e-15)


def axis_n(sin_lat):
    return np.stack([np.sqrt(1 - sin_lat**2), 0 * sin_lat, -sin_lat], axis=-1)


@pytest.mark.parametrize(
    ("h", "north", "down"),
    [(0.0, 1e-17, 1e-10), (1e3, 7e-12, 1.1e-7), (1e4, 6e-10, 7.1e-7), (3e4, 6e-9, 4.7e-6), (-1e4, 6e-10, 1.8e-6)],
)
def test_at_height_it_leans_towards_the_equator(h, north, down):
    s = np.linspace(-1, 1, 201)
    found = numeric.normal_gravity_about_axis(axis_n(s), h)
    differences = np.abs(found[:, [0, 2]] - np.stack(exact_normal_gravity(s, h), axis=-1)).max(axis=0)
    assert differences[0] < north and not found[:, 1].any()
    assert 0.9 * down * (h != 0.0) <= differences[1] < down  # what the docstring states
    np.testing.assert_array_equal(found[:, 2], numeric.normal_gravity(s, h))


def test_normal_gravity_is_the_same_vector_in_every_local_level_frame():
    s, wander = np.linspace(-0.9, 0.9, 7), 1.3
    turn = np.array([[np.cos(wander), np.sin(wander), 0], [-np.sin(wander), np.cos(wander), 0], [0, 0, 1]])  # n to w
    in_n = numeric.normal_gravity_about_axis(axis_n(s), 6e3)
    np.testing.assert_allclose(numeric.normal_gravity_about_axis(axis_n(s) @ turn.T, 6e3), in_n @ turn.T, rtol=0, atol=1e-15)


def test_normal_gravity_paper():
    s = np.linspace(0, 1, 101)
    low = numeric.normal_gravity(s, 100.0) - numeric.normal_gravity_paper(s, 100.0)
    np.testing.assert_allclose(low, 9.78 * (0.0052790414 - 0.00527094) * s**2, rtol=0, atol=3e-6)  # its misprint
