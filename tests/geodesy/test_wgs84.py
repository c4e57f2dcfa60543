"""The Earth's figure and gravity: published constants, and the closed potential of the ellipsoid."""

import earth_fixed
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
    """Exact normal gravity, north and down (m/s^2), from the potential of the ellipsoid."""
    s = sin_lat.astype(np.longdouble)
    c, e2 = np.sqrt(1 - s * s), earth_fixed.FLATTENING * (2 - np.longdouble(earth_fixed.FLATTENING))
    R_N = earth_fixed.AXIS / np.sqrt(1 - e2 * s * s)
    outward, _, axial = earth_fixed.gravity(np.stack([(R_N + h) * c, 0 * s, ((1 - e2) * R_N + h) * s], axis=-1)).T
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
