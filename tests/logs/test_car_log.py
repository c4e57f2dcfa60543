"""The real car log checked against physics."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
from places import ROOT

from insenv.logs import load

needs_onavdata = pytest.mark.skipif(
    importlib.util.find_spec("onavdata") is None,
    reason="onavdata is not installed (pip install onavdata==0.2.5)",
)


@pytest.fixture(scope="module")
def car():
    return load(ROOT / "examples/n380-car.toml")


@needs_onavdata
def test_car_log_shape(car) -> None:
    assert car.imu_time.shape == (69144,) and car.gnss.time.shape == (673,) and car.reference.time.shape == (66946,)
    assert car.rate_hz == pytest.approx(100.0, abs=0.01) and car.duration_s == pytest.approx(691.4, abs=0.1)
    assert (car.gaps.count, car.gaps.samples) == (1, 1)
    assert car.gaps.intervals[0][0] == pytest.approx(38.188, abs=1e-3)
    np.testing.assert_allclose(np.median(car.gnss.position_sigma, axis=0), [0.51, 0.47, 1.04], atol=0.01)
    assert car.notes == ()
    assert car.description.estimator["loosely-coupled"]["arw_deg_sqrt_h"] == 0.3


def _gravity(latitude: float, height: float) -> float:
    """WGS-84 normal gravity [m/s2] with the free-air gradient."""
    s2 = math.sin(latitude) ** 2
    return 9.7803253359 * (1 + 0.00193185265241 * s2) / math.sqrt(1 - 0.00669437999013 * s2) - 3.086e-6 * height


@needs_onavdata
def test_car_log_gravity_at_rest(car) -> None:
    """A car at rest: specific force -g on the down axis (bias 2 mg found), pitch and roll from it as the unit
    says."""
    rest = (car.imu_time > 60) & (car.imu_time < 150)
    force = car.delta_velocity[rest].sum(axis=0) / car.dt[rest].sum()
    g = _gravity(car.reference.latitude[0], car.reference.height[0])
    assert g == pytest.approx(9.8057, abs=1e-4)
    assert np.linalg.norm(force) == pytest.approx(g, abs=0.025)
    assert force[2] < -9.8
    at = np.searchsorted(car.reference.time, 100.0)
    assert math.degrees(math.asin(force[0] / g)) == pytest.approx(math.degrees(car.reference.pitch[at]), abs=0.1)
    assert math.degrees(math.asin(-force[1] / g)) == pytest.approx(math.degrees(car.reference.roll[at]), abs=0.1)


@needs_onavdata
def test_car_log_turns_and_moves_as_its_reference(car) -> None:
    """Down-gyro increments sum to the heading change; positions change by the velocity; the stamp ends the
    interval."""
    ref, psi = car.reference, np.unwrap(car.reference.heading)
    rest = (car.imu_time > 60) & (car.imu_time < 150)
    bias = car.delta_angle[rest, 2].sum() / car.dt[rest].sum()
    angle = np.cumsum(car.delta_angle[:, 2] - bias * car.dt)
    for start, stop in ((165, 200), (300, 400), (500, 600)):
        turned = np.interp(stop, car.imu_time, angle) - np.interp(start, car.imu_time, angle)
        assert math.degrees(turned) == pytest.approx(
            math.degrees(np.interp(stop, ref.time, psi) - np.interp(start, ref.time, psi)), abs=0.6
        )
    # heading rate is the down-gyro rate of the same interval, not of the one before or after
    k = np.searchsorted(car.imu_time, ref.time)
    turn = np.diff(psi)
    moving = np.flatnonzero((ref.time[1:] > 165) & (ref.time[1:] < 700))
    rms = {lag: np.std(turn[moving] - car.delta_angle[k[1:][moving] + lag, 2]) for lag in (-1, 0, 1)}
    assert rms[0] < 0.7 * min(rms[-1], rms[1])
    for fix in (ref, car.gnss):
        north = (fix.latitude - fix.latitude[0]) * 6.3678e6
        east = (fix.longitude - fix.longitude[0]) * 6.3889e6 * math.cos(fix.latitude[0])
        mean = 0.5 * (fix.velocity_n[1:] + fix.velocity_n[:-1]) * np.diff(fix.time)[:, None]
        for axis, position in enumerate((north, east)):
            assert np.polyfit(mean[:, axis], np.diff(position), 1)[0] == pytest.approx(1.0, abs=0.01)
    down = -(ref.height - ref.height[0])
    assert np.corrcoef(np.diff(down), 0.5 * (ref.velocity_n[1:, 2] + ref.velocity_n[:-1, 2]))[0, 1] > 0.7


@needs_onavdata
def test_car_log_lever_arm(car) -> None:
    """Antenna minus IMU position in body axes, averaged over the drive, is the lever arm of the
    description."""
    ref, fix = car.reference, car.gnss
    use = (fix.time > 165) & (fix.time < 700)
    t = fix.time[use]
    lat, lon, h, psi = (np.interp(t, ref.time, x) for x in (ref.latitude, ref.longitude, ref.height, np.unwrap(ref.heading)))
    north, east = (fix.latitude[use] - lat) * 6.3678e6, (fix.longitude[use] - lon) * 6.3889e6 * np.cos(lat)
    forward = np.mean(north * np.cos(psi) + east * np.sin(psi))
    right = np.mean(-north * np.sin(psi) + east * np.cos(psi))
    np.testing.assert_allclose([forward, right, -np.mean(fix.height[use] - h)], car.lever_arm_b, atol=0.05)
