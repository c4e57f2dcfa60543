"""Figure and gravity of the Earth, frames and positions against published constants, closed forms, motion and pymap3d."""

import earth_fixed
import numpy as np
import pymap3d
import pytest

from insenv import attitude, geodesy
from insenv.geodesy import numeric

RNG = np.random.default_rng(3)
N = 2000
LATITUDE = np.r_[RNG.uniform(-np.pi / 2, np.pi / 2, N), np.pi / 2, -np.pi / 2, 0.0, np.pi / 2 - 1e-9]
LONGITUDE = np.r_[RNG.uniform(-np.pi, np.pi, N), 0.0, 0.0, np.pi, -np.pi + 1e-9]
HEIGHT = np.r_[RNG.uniform(-1e4, 1e5, N // 2), RNG.uniform(1e5, 1e6, N // 2), 0.0, 100.0, -1e4, 1e6]


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


def test_normal_gravity_on_the_ellipsoid_and_by_the_formula_of_the_paper():
    assert numeric.normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-15)
    assert numeric.normal_gravity([-1.0, 1.0], 0.0) == pytest.approx(9.8321849378, abs=3e-15)
    s = np.linspace(0, 1, 101)
    low = numeric.normal_gravity(s, 100.0) - numeric.normal_gravity_paper(s, 100.0)
    np.testing.assert_allclose(low, 9.78 * (0.0052790414 - 0.00527094) * s**2, rtol=0, atol=3e-6)  # its misprint


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


def test_frames_against_pymap3d():
    lat, lon, wander = 0.6, -2.0, 0.9
    C = numeric.C_en(lat, lon)
    uvw = [pymap3d.enu2uvw(*axis, np.degrees(lat), np.degrees(lon)) for axis in ((0, 1, 0), (1, 0, 0), (0, 0, -1))]
    np.testing.assert_allclose(C.T, uvw, atol=1e-15)
    # heading in n = heading in w + wander angle
    ahead = C.T @ numeric.C_ew(lat, lon, wander) @ [np.cos(0.3), np.sin(0.3), 0.0]
    np.testing.assert_allclose(ahead, [np.cos(1.2), np.sin(1.2), 0.0], atol=1e-15)


def test_wander_frame_round_trip():
    corners = np.array([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi])
    lat, lon, wander = (each.ravel() for each in np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, 13), corners, corners))
    q = numeric.q_ew_from_geodetic(lat, lon, wander)
    np.testing.assert_allclose(attitude.numeric.to_dcm(q), numeric.C_ew(lat, lon, wander), atol=2e-15)
    back = numeric.geodetic_from_q_ew(q)
    np.testing.assert_allclose(back[0], lat, rtol=0, atol=1e-15)
    assert not back[1][abs(lat) == np.pi / 2].any()
    again = attitude.numeric.to_dcm(numeric.q_ew_from_geodetic(*back))
    np.testing.assert_allclose(again, attitude.numeric.to_dcm(q), atol=3e-15)


def test_earth_rates_in_n_and_w_agree():
    rng, n = np.random.default_rng(3), 2000
    lat = rng.uniform(-1.5, 1.5, n)
    lon, wander = rng.uniform(-np.pi, np.pi, (2, n))
    q = numeric.q_ew_from_geodetic(lat, lon, wander)
    C_nw = np.einsum("nji,njk->nik", numeric.C_en(lat, lon), numeric.C_ew(lat, lon, wander))
    earth = np.einsum("nij,nj->ni", C_nw, numeric.earth_rate_w(q))
    np.testing.assert_allclose(earth, numeric.earth_rate_n(lat), rtol=0, atol=1e-19)


@pytest.mark.parametrize("lat", [0.0, 0.8, -1.3, np.pi / 2 - 1e-5, np.pi / 2, -np.pi / 2])
def test_transport_rates_against_motion(lat):
    """Rotation rate of the local vertical along a straight line through the point."""
    lon, wander, h, step = 0.7, -1.1, 2000.0, 2.0
    velocity_w = np.array([120.0, -75.0, 4.0])
    q = numeric.q_ew_from_geodetic(lat, lon, wander)
    C = attitude.numeric.to_dcm(q)
    centre = numeric.geodetic_to_ecef(lat, lon, h)
    before, after = (numeric.C_en(*numeric.ecef_to_geodetic(centre + side * C @ velocity_w)[:2]) for side in (-step, step))
    turning_w = C.T @ (after - before)[:, 2] / (2 * step)  # = omega x down
    omega_w = numeric.transport_rate_w(velocity_w, q, h)
    np.testing.assert_allclose(turning_w, np.cross(omega_w, [0, 0, 1]), rtol=0, atol=2e-13)
    if abs(lat) < 1.4:
        C_ne = numeric.C_en(lat, lon).T
        omega_n = numeric.transport_rate_n(C_ne @ C @ velocity_w, lat, h)
        np.testing.assert_allclose(C_ne @ (after - before) / (2 * step), attitude.numeric.skew(omega_n), rtol=0, atol=2e-12)


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
