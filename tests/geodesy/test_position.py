"""Positions against pymap3d, at the poles, over the date line, and over the smallest distances."""

import numpy as np
import pymap3d
import pytest

from insenv import geodesy
from insenv.geodesy import numeric

RNG = np.random.default_rng(3)
N = 2000
LATITUDE = np.r_[RNG.uniform(-np.pi / 2, np.pi / 2, N), np.pi / 2, -np.pi / 2, 0.0, np.pi / 2 - 1e-9]
LONGITUDE = np.r_[RNG.uniform(-np.pi, np.pi, N), 0.0, 0.0, np.pi, -np.pi + 1e-9]
HEIGHT = np.r_[RNG.uniform(-1e4, 1e5, N // 2), RNG.uniform(1e5, 1e6, N // 2), 0.0, 100.0, -1e4, 1e6]


def test_ecef_also_at_the_poles_and_inside():
    r_e = numeric.geodetic_to_ecef(LATITUDE, LONGITUDE, HEIGHT)
    oracle = np.stack(pymap3d.geodetic2ecef(LATITUDE, LONGITUDE, HEIGHT, deg=False), -1)
    np.testing.assert_allclose(r_e, oracle, rtol=0, atol=3e-9)
    lat, lon, h = numeric.ecef_to_geodetic(r_e)
    assert np.isfinite(lat + lon + h).all()
    np.testing.assert_allclose(h, HEIGHT, rtol=0, atol=4e-9)
    np.testing.assert_allclose(lat, LATITUDE, rtol=0, atol=4e-16)
    np.testing.assert_allclose(np.cos(LATITUDE) * np.sin((lon - LONGITUDE) / 2), 0, atol=3e-16)
    lat, lon, h = numeric.ecef_to_geodetic([[0, 0, geodesy.B + 5], [0, 0, -geodesy.B + 5], [-geodesy.A, 0, 0]])
    np.testing.assert_allclose(lat, [np.pi / 2, -np.pi / 2, 0], rtol=0, atol=1e-16)
    np.testing.assert_allclose(lon, [0, 0, np.pi])
    np.testing.assert_allclose(h, [5, -5, 0], atol=2e-9)


def test_ned_offset_against_pymap3d():
    lat, lon, h = LATITUDE[:N], LONGITUDE[:N], HEIGHT[:N]
    lat0, lon0 = lat + RNG.normal(size=N) * 1e-3, lon + RNG.normal(size=N) * 1e-3
    h0 = h + RNG.normal(size=N) * 100
    oracle = np.stack(pymap3d.geodetic2ned(lat, lon, h, lat0, lon0, h0, deg=False), -1)
    np.testing.assert_allclose(numeric.ned_offset(lat, lon, h, lat0, lon0, h0), oracle, rtol=0, atol=6e-9)


def test_ned_offset_keeps_small_differences():
    """Steps of 2^-53 rad (7e-10 m) and 2^-40 m, exactly representable, are reproduced to 15 digits."""
    lat0, lon0, h0, step = 0.3, 0.4, 50.0, 2.0**-53
    R_M, R_N = numeric.radii(np.sin(lat0))
    north = numeric.ned_offset(lat0 + step, lon0, h0, lat0, lon0, h0)[0]
    assert north == pytest.approx((R_M + h0) * step, rel=1e-14)
    east = numeric.ned_offset(lat0, lon0 + step, h0, lat0, lon0, h0)[1]
    assert east == pytest.approx((R_N + h0) * np.cos(lat0) * step, rel=1e-14)
    up = numeric.ned_offset(lat0, lon0, h0 + 2.0**-40, lat0, lon0, h0)
    np.testing.assert_allclose(up, [0, 0, -(2.0**-40)], rtol=0, atol=1e-27)
    np.testing.assert_array_equal(numeric.ned_offset(lat0, lon0, h0, lat0, lon0, h0), 0.0)
    lat, lon, h = numeric.geodetic_from_ned_offset(np.zeros(3), LATITUDE, LONGITUDE, HEIGHT)
    np.testing.assert_array_equal([lat, h], [LATITUDE, HEIGHT])
    np.testing.assert_array_equal(lon[abs(LATITUDE) < 1.57], LONGITUDE[abs(LATITUDE) < 1.57])
    over_the_date_line = numeric.ned_offset(0.5, -np.pi + 1e-7, 0.0, 0.5, np.pi - 1e-7, 0.0)
    assert over_the_date_line[1] == pytest.approx(2e-7 * numeric.radii(np.sin(0.5))[1] * np.cos(0.5), rel=1e-8)


def test_a_position_error_has_the_difference_of_the_heights():
    """At equal heights, 100 km away: the tangent plane is 800 m above the ellipsoid; nearby both are the same."""
    place = (0.5, 1.0, 20.0)
    far = (0.5, 1.0 + 0.0178, 25.0)
    offset, error = (f(*far, *place) for f in (numeric.ned_offset, numeric.position_error))
    assert np.array_equal(error[:2], offset[:2]) and error[2] == -5.0 and offset[2] > 700.0
    near = (0.5 + 1e-7, 1.0 - 1e-7, 21.0)
    np.testing.assert_allclose(numeric.position_error(*near, *place), numeric.ned_offset(*near, *place), atol=1e-6)


def test_ned_offset_round_trip():
    offset = np.column_stack([RNG.uniform(-1e5, 1e5, (len(LATITUDE), 2)), RNG.uniform(-1e3, 1e3, len(LATITUDE))])
    h0 = np.minimum(HEIGHT, 1e5)
    lat, lon, h = numeric.geodetic_from_ned_offset(offset, LATITUDE, LONGITUDE, h0)
    assert np.abs(lat).max() <= np.pi / 2 and np.abs(lon).max() <= np.nextafter(np.pi, 4)
    np.testing.assert_allclose(numeric.ned_offset(lat, lon, h, LATITUDE, LONGITUDE, h0), offset, rtol=0, atol=6e-9)
