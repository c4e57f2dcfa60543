"""Frames and their rates against pymap3d, against one another and against motion along a straight line."""

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insenv import attitude
from insenv.geodesy import numeric

latitude = st.one_of(st.floats(-np.pi / 2, np.pi / 2), st.sampled_from([np.pi / 2, -np.pi / 2, 0.0]))
longitude = st.one_of(st.floats(-np.pi, np.pi), st.sampled_from([np.pi, -np.pi, 0.0]))


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
    rng, n = np.random.default_rng(3), 2000
    lat, h = rng.uniform(-1.5, 1.5, n), rng.uniform(-1e4, 1e6, n)
    lon, wander = rng.uniform(-np.pi, np.pi, (2, n))
    velocity_n = rng.normal(size=(n, 3)) * 100
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
