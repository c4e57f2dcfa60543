"""Samples of the inertial unit: stamps, gaps that are bridged, sums, calibrated errors by temperature, and the mounting."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from text_logs import RATE, G, N, imu_rows, increments, si

import insenv
from insenv.logs import load
from insenv.logs.inertial import Sampling, bridge, missing_samples, sampling


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
    assert any("subtracted, at 20 to 45 deg C" in note for note in log.notes)
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


def test_irregular_steps_are_no_gaps(folder):
    """Every sample covers the time since the one before, and none is invented; a longer gap among them is bridged."""
    rows = imu_rows()
    rows[:, 0] = 10.0 + np.cumsum(np.random.default_rng(2).uniform(0.004, 0.036, N))  # as of a phone
    folder.imu(rows)
    log, steps = folder.load(), np.diff(rows[:, 0])
    assert log.gaps.count == 0 and len(log.imu_time) == N
    np.testing.assert_allclose(log.dt[1:], steps, atol=1e-9)
    np.testing.assert_allclose(log.delta_angle[1:], si(imu_rows())[0][1:] * steps[:, None], rtol=1e-6, atol=1e-9)
    assert any("irregular time stamps" in note for note in log.notes)
    rows[60:, 0] += 0.4
    folder.imu(rows)
    log = folder.load()
    assert log.gaps.count == 1 and log.gaps.samples == pytest.approx(20, abs=8)


def merged(counts):
    """Increments at rest at 100 Hz, and the same added up over `counts` samples (k,), rows (k, 7) in SI."""
    total = int(counts.sum())
    noise = np.random.default_rng(5).normal(size=(total, 6)) * [1e-5] * 6
    full = np.column_stack([0.01 * np.arange(1, total + 1), noise + [0, 0, 0, 0, 0, -0.0980665]])
    last = np.cumsum(counts)
    sums = np.add.reduceat(full[:, 1:], np.concatenate([[0], last[:-1]]), axis=0)
    return full, np.column_stack([full[last - 1, 0], sums])


@pytest.mark.parametrize(("share", "longest"), [(0.3, 2), (0.8, 4)], ids=["regular", "irregular"])
def test_merged_increments_cover_their_time_and_show_the_rest(folder, share, longest):
    """Nothing is invented beside an increment of two samples, and the first, of unknown length, does not hide the rest."""
    rng = np.random.default_rng(3)
    counts = np.where(rng.random(3000) < share, rng.integers(2, longest + 1, 3000), 1)
    counts[0] = 2
    full, rows = merged(counts)
    folder.imu(rows)
    folder.hold_increments("rad")
    log = folder.load()
    assert log.gaps.count == 0 and len(log.imu_time) == len(rows) - 1
    np.testing.assert_allclose(log.dt, 0.01 * counts[1:], atol=1e-9)
    np.testing.assert_allclose(log.delta_velocity.sum(axis=0), full[2:, 4:].sum(axis=0), atol=1e-9)
    until = log.description.initial.static_until_s
    assert until is not None and full[-1, 0] - 3.0 < until <= full[-1, 0]  # whole windows of a hundred samples


def test_a_late_stamp_is_jitter_not_a_gap():
    steps = np.array([1, 1, 1.9, 0.1, 1, 1, 3.0, 1, 1, 1.7, 0.8, 0.8, 1, 2.0, 1.0]) * 0.01
    missing = missing_samples(np.concatenate(([0.0], np.cumsum(steps))), 0.01)
    assert missing.tolist() == [0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize("time",
    [np.concatenate([k * 0.1 + np.arange(16) * 1e-3 for k in range(50)]), np.cumsum(np.tile([0.005, 0.015], 200))])  # fmt: skip
def test_bursts_and_alternating_steps_are_no_gaps(time):
    found = sampling(time, None)
    assert found.gap_s is not None and found.missing(time).sum() == 0


@pytest.mark.parametrize("share", [0.0, 0.02, 0.1])
def test_a_regular_log_that_loses_samples_stays_regular(share):
    draw = np.random.default_rng(5)
    kept = np.flatnonzero(draw.random(2000) >= share)
    time = (kept + draw.uniform(-0.1, 0.1, kept.size)) / 100.0
    found = sampling(time, None)
    assert found.gap_s is None and found.missing(time).sum() == kept[-1] - kept[0] + 1 - kept.size
