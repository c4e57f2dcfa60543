"""Samples of the inertial unit: gaps that are bridged, calibrated errors by temperature, and the mounting."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from text_logs import RATE, G, imu_rows, increments, si

import insenv
from insenv.logs import load
from insenv.logs.inertial import Sampling, bridge


@settings(max_examples=30, deadline=None)
@given(st.sets(st.integers(3, 396), min_size=1, max_size=25), st.floats(0, 0.1), st.floats(0.1, 1.0), st.integers(0, 2**32 - 1))
def test_bridging_brings_back_smooth_signals(drop, jitter, frequency, seed):
    n, rate = 400, 100.0
    time = (np.arange(n) + jitter * np.random.default_rng(seed).uniform(-1, 1, n)) / rate
    omega = 2 * math.pi * frequency
    keep = np.setdiff1d(np.arange(n), list(drop))

    def signal(time):
        return np.column_stack([np.sin(omega * time), np.cos(omega * time), time])

    result = bridge(time[keep], signal(time)[keep], Sampling(1 / rate), 1.0)
    assert result.time.size == n and result.gaps.samples == len(drop)
    np.testing.assert_array_equal(np.flatnonzero(result.original), keep)
    np.testing.assert_array_equal(result.rates[result.original], signal(time)[keep])
    assert np.all(np.diff(result.time) > 0)
    longest = (result.gaps.longest_s + 2 / rate) * 1.2
    assert np.abs(result.rates - signal(result.time)).max() <= (omega * longest) ** 2 / 8 + 1e-12  # linear: h^2/8 max|f''|


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_gaps_in_a_file_are_bridged_and_counted(folder, kind):
    whole, rows = folder.load(), imu_rows()
    if kind == "increment":
        rows = increments(rows)
        folder.hold_increments("rad")
    folder.imu(np.delete(rows, [20, 21, 22, 60], axis=0))
    log = folder.load()
    assert (log.gaps.count, log.gaps.samples) == (2, 4) and log.gaps.longest_s == pytest.approx(0.06)
    assert np.flatnonzero(log.bridged).tolist() == [20, 21, 22, 60]
    np.testing.assert_allclose(log.imu_time, whole.imu_time, rtol=1e-9)
    np.testing.assert_allclose(log.delta_angle, whole.delta_angle, atol=2e-6)
    np.testing.assert_allclose(log.delta_velocity, whole.delta_velocity, atol=5e-5)
    folder.change(("[imu]", "[imu]\nmax_gap_s = 0.05"))
    folder.error("between 10.400000 s and 10.480000 s", "imu.max_gap_s = 0.05 s")


BIAS, SCALE = np.array([30.0, -20.0, 10.0]), np.array([100.0, 200.0, -50.0])
KEYS = """[imu]
temperature = "temp"
temperature_reference_degc = 25.0
gyro_temperature_slope_deg_h_k = [30.0, -20.0, 10.0]
gyro_scale_factor_slope_ppm_k = [100.0, 200.0, -50.0]
accel_temperature_slope_ug_k = 150.0
accel_scale_factor_slope_ppm_k = 40.0
"""


def heated():
    """The rows of a unit that goes from 20 to 45 deg C, as its sensors read them (deg/s, g)."""
    rows = imu_rows()
    celsius = np.linspace(20.0, 45.0, len(rows))
    warmth = celsius[:, None] - 25.0
    gyro = rows[:, 1:4] * (1 + 1e-6 * SCALE * warmth) + BIAS / 3600.0 * warmth
    accel = rows[:, 4:7] * (1 + 40e-6 * warmth) + 150e-6 * warmth
    return np.column_stack([rows[:, 0], gyro, accel, celsius])


@pytest.fixture
def warm(folder):
    """A log with the temperature and the slopes of its unit."""
    folder.imu(heated(), ",temp")
    folder.change(("[imu]\n", KEYS))
    return folder


@pytest.mark.parametrize(("axes", "kind"), [("FRD", "rate"), ("FLU", "increment")])
def test_the_calibrated_errors_are_taken_off(warm, axes, kind, tmp_path):
    """Whatever the axes, the slopes are the sensor's, and rates and increments give the same; a log is written without them."""
    if kind == "increment":
        rows = heated()
        rows[:, 1:4] = np.radians(rows[:, 1:4]) / RATE
        rows[:, 4:7] *= G / RATE
        warm.hold_increments("rad")
        warm.imu(rows, ",temp")
    warm.change(('"FRD"', f'"{axes}"'))
    log = warm.load()
    signs = np.array([1.0, -1.0, -1.0]) if axes == "FLU" else 1.0
    gyro, accel = (signs * values / RATE for values in si(imu_rows()))
    np.testing.assert_allclose(log.delta_angle, gyro, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, accel, atol=1e-10)
    assert any("taken off, at 20 to 45 deg C" in note for note in log.notes)
    (description, *_) = insenv.write(log, tmp_path / "again", ["log"])
    again = load(description)
    np.testing.assert_array_equal(again.temperature, log.temperature)
    np.testing.assert_allclose(again.delta_angle, log.delta_angle, rtol=1e-15)


def test_a_gap_is_bridged_with_the_temperature_of_its_time(warm):
    warm.imu(np.delete(heated(), slice(40, 45), axis=0), ",temp")
    log = warm.load()
    assert log.gaps.samples == 5
    np.testing.assert_allclose(log.delta_angle, si(imu_rows())[0] / RATE, atol=1e-5)


def test_mounting_angles_turn_the_named_axes_into_those_of_the_body(folder):
    folder.change(("[imu]\n", "[imu]\nmounting_angles_deg = [3.0, -2.0, 90.0]\n"), ('"FRD"', '"FLU"'))
    log = folder.load()
    C_bs = Rotation.from_euler("ZYX", [90.0, -2.0, 3.0], degrees=True).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    gyro, accel = (values @ C_bs.T / RATE for values in si(imu_rows()))
    np.testing.assert_allclose(log.delta_angle, gyro, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, accel, atol=1e-12)
