"""Frames and their rates against pymap3d, against one another and against motion along a straight line."""

import numpy as np
import pymap3d
import pytest

from insenv import attitude
from insenv.geodesy import numeric


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
