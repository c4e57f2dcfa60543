"""The Earth against pymap3d and against differentiation; gravity against the ellipsoid's closed potential."""

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insenv import attitude, geodesy
from insenv.geodesy import numeric

RNG = np.random.default_rng(3)
N = 2000
LATITUDE = np.r_[RNG.uniform(-np.pi / 2, np.pi / 2, N), np.pi / 2, -np.pi / 2, 0.0, np.pi / 2 - 1e-9]
LONGITUDE = np.r_[RNG.uniform(-np.pi, np.pi, N), 0.0, 0.0, np.pi, -np.pi + 1e-9]
HEIGHT = np.r_[RNG.uniform(-1e4, 1e5, N // 2), RNG.uniform(1e5, 1e6, N // 2), 0.0, 100.0, -1e4, 1e6]

latitude = st.one_of(st.floats(-np.pi / 2, np.pi / 2), st.sampled_from([np.pi / 2, -np.pi / 2, 0.0]))
longitude = st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([np.pi, -np.pi, 0.0]))
height = st.floats(-1e4, 1e5)


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
    s = np.linspace(-1, 1, 201)
    np.testing.assert_allclose(numeric.normal_gravity(s, 0.0), exact_normal_gravity(s, 0.0)[1], rtol=0, atol=1e-10)


@pytest.mark.parametrize("h, bound", [(1e3, 1.1e-7), (1e4, 7.1e-7), (3e4, 4.7e-6)])
def test_normal_gravity_at_height(h, bound):
    s = np.linspace(-1, 1, 201)
    difference = np.abs(numeric.normal_gravity(s, h) - exact_normal_gravity(s, h)[1]).max()
    assert 0.9 * bound < difference < bound  # what the docstring states


def axis_n(sin_lat):
    return np.stack([np.sqrt(1 - sin_lat**2), 0 * sin_lat, -sin_lat], axis=-1)


@pytest.mark.parametrize("h, bound", [(0.0, 1e-17), (1e4, 6e-10), (3e4, 6e-9), (-1e4, 6e-10)])
def test_above_the_ellipsoid_normal_gravity_leans_towards_the_equator(h, bound):
    s = np.linspace(-1, 1, 201)
    found, (north, _) = numeric.normal_gravity_about_axis(axis_n(s), h), exact_normal_gravity(s, h)
    assert np.abs(found[:, 0] - north).max() < bound and not found[:, 1].any()
    np.testing.assert_array_equal(found[:, 2], numeric.normal_gravity(s, h))
    if h == 1e4:
        assert np.abs(north).max() > 8e-5
        assert (found[s > 0.01, 0][:-1] < 0).all() and (found[s < -0.01, 0][1:] > 0).all()


def test_normal_gravity_is_the_same_vector_in_every_local_level_frame():
    s, wander = np.linspace(-0.9, 0.9, 7), 1.3
    turn = np.array([[np.cos(wander), np.sin(wander), 0], [-np.sin(wander), np.cos(wander), 0], [0, 0, 1]])  # n to w
    in_n = numeric.normal_gravity_about_axis(axis_n(s), 6e3)
    np.testing.assert_allclose(numeric.normal_gravity_about_axis(axis_n(s) @ turn.T, 6e3), in_n @ turn.T, rtol=0, atol=1e-15)


def test_normal_gravity_is_a_gradient():
    """No work on a closed way in the meridian: up 9 km, north 0.3 rad, down and back, by Gauss's quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    low, high, south, north = 0.0, 9e3, 0.5, 0.8

    def along(h):
        latitude = south + (north - south) * (nodes + 1) / 2
        g = numeric.normal_gravity_about_axis(axis_n(np.sin(latitude)), h)[:, 0]
        return (g * (numeric.radii(np.sin(latitude))[0] + h)) @ weights * (north - south) / 2

    def up(latitude):
        h = low + (high - low) * (nodes + 1) / 2
        s = np.full(40, np.sin(latitude))
        return -numeric.normal_gravity_about_axis(axis_n(s), h)[:, 2] @ weights * (high - low) / 2

    work = up(south) + along(high) - up(north) - along(low)
    assert abs(work) < 1e-3 and abs(along(high)) > 80.0  # m^2/s^2, m/s^2 times 1900 km


def test_normal_gravity_paper():
    s = np.linspace(0, 1, 101)
    low = numeric.normal_gravity(s, 100.0) - numeric.normal_gravity_paper(s, 100.0)
    np.testing.assert_allclose(low, 9.78 * (0.0052790414 - 0.00527094) * s**2, rtol=0, atol=3e-6)  # its misprint


def test_ecef():
    r_e = numeric.geodetic_to_ecef(LATITUDE, LONGITUDE, HEIGHT)
    oracle = np.stack(pymap3d.geodetic2ecef(LATITUDE, LONGITUDE, HEIGHT, deg=False), -1)
    np.testing.assert_allclose(r_e, oracle, rtol=0, atol=3e-9)
    lat, lon, h = numeric.ecef_to_geodetic(r_e)
    assert np.isfinite(lat + lon + h).all()
    np.testing.assert_allclose(h, HEIGHT, rtol=0, atol=4e-9)
    np.testing.assert_allclose(lat, LATITUDE, rtol=0, atol=4e-16)
    np.testing.assert_allclose(np.cos(LATITUDE) * np.sin((lon - LONGITUDE) / 2), 0, atol=3e-16)


def test_ecef_at_the_poles_and_inside():
    lat, lon, h = numeric.ecef_to_geodetic([[0, 0, geodesy.B + 5], [0, 0, -geodesy.B + 5], [-geodesy.A, 0, 0]])
    np.testing.assert_allclose(lat, [np.pi / 2, -np.pi / 2, 0], rtol=0, atol=1e-16)
    np.testing.assert_allclose(lon, [0, 0, np.pi])
    np.testing.assert_allclose(h, [5, -5, 0], atol=2e-9)


def test_frames():
    lat, lon, wander = 0.6, -2.0, 0.9
    C = numeric.C_en(lat, lon)
    east = pymap3d.enu2uvw(1.0, 0.0, 0.0, np.degrees(lat), np.degrees(lon))
    north = pymap3d.enu2uvw(0.0, 1.0, 0.0, np.degrees(lat), np.degrees(lon))
    np.testing.assert_allclose(C[:, :2].T, [north, east], atol=1e-15)
    np.testing.assert_allclose(C[:, 2], np.cross(C[:, 0], C[:, 1]), atol=1e-15)
    # heading in n = heading in w + wander angle
    C_ew = numeric.C_ew(lat, lon, wander)
    ahead = C.T @ C_ew @ [np.cos(0.3), np.sin(0.3), 0.0]
    np.testing.assert_allclose(ahead, [np.cos(1.2), np.sin(1.2), 0.0], atol=1e-15)
    np.testing.assert_allclose(attitude.numeric.to_dcm(numeric.q_ew_from_geodetic(lat, lon, wander)), C_ew, atol=1e-15)


@settings(deadline=None)  # the first call traces
@given(latitude, longitude, longitude)
def test_wander_frame_round_trip(lat, lon, wander):
    q = numeric.q_ew_from_geodetic(lat, lon, wander)
    np.testing.assert_allclose(attitude.numeric.to_dcm(q), numeric.C_ew(lat, lon, wander), atol=2e-15)
    back = numeric.geodetic_from_q_ew(q)
    assert np.isfinite(back).all()
    assert back[0] == pytest.approx(lat, abs=1e-15)
    if abs(lat) == np.pi / 2:
        assert back[1] == 0.0
    again = attitude.numeric.to_dcm(numeric.q_ew_from_geodetic(*back))
    np.testing.assert_allclose(again, attitude.numeric.to_dcm(q), atol=3e-15)


def test_rates_in_n_and_w_agree():
    lat = RNG.uniform(-1.5, 1.5, N)
    lon, wander = RNG.uniform(-np.pi, np.pi, (2, N))
    h, velocity_n = HEIGHT[:N], RNG.normal(size=(N, 3)) * 100
    q = numeric.q_ew_from_geodetic(lat, lon, wander)
    C_nw = np.einsum("nji,njk->nik", numeric.C_en(lat, lon), numeric.C_ew(lat, lon, wander))
    velocity_w = np.einsum("nij,ni->nj", C_nw, velocity_n)
    in_n = numeric.transport_rate_n(velocity_n, lat, h)
    in_w = numeric.transport_rate_w(velocity_w, q, h)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", C_nw, in_w)[:, :2], in_n[:, :2], rtol=0, atol=1e-19)
    np.testing.assert_array_equal(in_w[:, 2], 0.0)
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
    down = [numeric.C_en(*numeric.ecef_to_geodetic(centre + sign * step * C @ velocity_w)[:2])[:, 2] for sign in (-1, 1)]
    turning_w = C.T @ (down[1] - down[0]) / (2 * step)  # = omega x down
    omega_w = numeric.transport_rate_w(velocity_w, q, h)
    np.testing.assert_allclose(turning_w, np.cross(omega_w, [0, 0, 1]), rtol=0, atol=2e-13)
    if abs(lat) < 1.4:
        velocity_n = numeric.C_en(lat, lon).T @ C @ velocity_w
        frames = [numeric.C_en(*numeric.ecef_to_geodetic(centre + sign * step * C @ velocity_w)[:2]) for sign in (-1, 1)]
        skewed = numeric.C_en(lat, lon).T @ (frames[1] - frames[0]) / (2 * step)
        expected = attitude.numeric.skew(numeric.transport_rate_n(velocity_n, lat, h))
        np.testing.assert_allclose(skewed, expected, rtol=0, atol=2e-12)


def test_ned_offset_against_pymap3d():
    lat, lon, h = LATITUDE[:N], LONGITUDE[:N], HEIGHT[:N]
    lat0, lon0, h0 = (
        lat + RNG.normal(size=N) * 1e-3,
        lon + RNG.normal(size=N) * 1e-3,
        h + RNG.normal(size=N) * 100,
    )
    oracle = np.stack(pymap3d.geodetic2ned(lat, lon, h, lat0, lon0, h0, deg=False), -1)
    np.testing.assert_allclose(numeric.ned_offset(lat, lon, h, lat0, lon0, h0), oracle, rtol=0, atol=6e-9)


def test_ned_offset_keeps_small_differences():
    """Steps of 2^-53 rad (7e-10 m) and 2^-40 m, exactly representable, are reproduced to 15 digits."""
    lat0, lon0, h0, step = 0.3, 0.4, 50.0, 2.0**-53
    R_M, R_N = numeric.radii(np.sin(lat0))
    offset = numeric.ned_offset(lat0 + step, lon0, h0, lat0, lon0, h0)
    assert offset[0] == pytest.approx((R_M + h0) * step, rel=1e-14)
    offset = numeric.ned_offset(lat0, lon0 + step, h0, lat0, lon0, h0)
    assert offset[1] == pytest.approx((R_N + h0) * np.cos(lat0) * step, rel=1e-14)
    offset = numeric.ned_offset(lat0, lon0, h0 + 2.0**-40, lat0, lon0, h0)
    np.testing.assert_allclose(offset, [0, 0, -(2.0**-40)], rtol=0, atol=1e-27)
    np.testing.assert_array_equal(numeric.ned_offset(lat0, lon0, h0, lat0, lon0, h0), 0.0)


def test_a_position_error_has_the_difference_of_the_heights():
    """At equal heights, 100 km away: the tangent plane is 800 m above the ellipsoid; nearby both are the same."""
    place = (0.5, 1.0, 20.0)
    far = (0.5, 1.0 + 0.0178, 25.0)
    offset, error = (f(*far, *place) for f in (numeric.ned_offset, numeric.position_error))
    assert np.array_equal(error[:2], offset[:2]) and error[2] == -5.0 and offset[2] > 700.0
    near = (0.5 + 1e-7, 1.0 - 1e-7, 21.0)
    np.testing.assert_allclose(numeric.position_error(*near, *place), numeric.ned_offset(*near, *place), atol=1e-6)


def test_ned_offset_over_the_date_line():
    offset = numeric.ned_offset(0.5, -np.pi + 1e-7, 0.0, 0.5, np.pi - 1e-7, 0.0)
    assert offset[1] == pytest.approx(2e-7 * numeric.radii(np.sin(0.5))[1] * np.cos(0.5), rel=1e-8)


@settings(deadline=None)  # the first call traces
@given(latitude, longitude, height, st.tuples(*[st.floats(-1e5, 1e5)] * 2), st.floats(-1e3, 1e3))
def test_ned_offset_round_trip(lat0, lon0, h0, horizontal, down):
    offset = np.array([*horizontal, down])
    lat, lon, h = numeric.geodetic_from_ned_offset(offset, lat0, lon0, h0)
    assert abs(lat) <= np.pi / 2 and abs(lon) <= np.nextafter(np.pi, 4) and np.isfinite(h)
    np.testing.assert_allclose(numeric.ned_offset(lat, lon, h, lat0, lon0, h0), offset, rtol=0, atol=6e-9)


def test_no_offset_is_no_change():
    lat, lon, h = numeric.geodetic_from_ned_offset(np.zeros(3), LATITUDE, LONGITUDE, HEIGHT)
    np.testing.assert_array_equal([lat, h], [LATITUDE, HEIGHT])
    np.testing.assert_array_equal(lon[abs(LATITUDE) < 1.57], LONGITUDE[abs(LATITUDE) < 1.57])
