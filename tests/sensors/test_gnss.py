"""The GNSS receiver: each error against its stated parameter, the times of its fixes, its lever arm and delay."""

import math
from typing import Any

import numpy as np
import pymap3d
import pytest
from driven import columns_of
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from sensor_plant import CHANCE, LEVEL, assert_gauss_markov, assert_mean, assert_variance, simulate, starts

from insenv.scenario import build, load


def ned(out: dict[str, Any], fixes: Any = slice(None)) -> Any:
    """Fixes in metres north, east, down of the IMU position LEVEL."""
    fix = [out[f"gnss_{name}"][fixes] for name in ("latitude", "longitude", "height")]
    place = [LEVEL[name] for name in ("latitude", "longitude", "height")]
    return np.stack(pymap3d.geodetic2ned(*fix, *place, deg=False), axis=-1)


def test_fixes_come_at_their_rate_late_and_once() -> None:
    dt, n = 0.1, 105
    height = np.arange(1, n + 1) * dt  # encodes the time of measurement
    for latency in (0.0, 0.1, 0.3, 0.9):
        out = simulate(n, {"sample_interval": dt, "gnss_interval": 1.0, "gnss_latency": latency}, {"height": height})
        arrivals = np.flatnonzero(out["gnss_valid"]) + 1
        expected = [k for k in (10 * (i + 1) + round(latency / dt) for i in range(10)) if k <= n]
        assert arrivals.tolist() == expected
        fixes = arrivals - 1
        assert np.allclose(out["gnss_age"][fixes], latency, rtol=0, atol=1e-12)
        assert np.allclose(out["gnss_height"][fixes], arrivals * dt - latency, rtol=0, atol=1e-7)
        assert np.array_equal(out["gnss_velocity_valid"], out["gnss_valid"])
        assert set(np.flatnonzero(np.diff(out["gnss_height"])) + 2) <= set(arrivals)  # invisible before
    without = simulate(n, {"sample_interval": dt, "gnss_interval": 1.0, "gnss_has_velocity": 0.0})
    assert without["gnss_valid"].sum() == 10 and not without["gnss_velocity_valid"].any()


def test_lever_arm_and_an_epoch_between_samples() -> None:
    arm, rate = np.array([1.5, -0.7, -2.0]), np.array([0.3, -0.2, 0.5])
    velocity, acceleration, tau = np.array([20.0, -5.0, 1.0]), np.array([1.0, 2.0, -0.5]), 0.004
    change = np.array([0.1, -0.15, 0.1])  # rad/s^2: 1.5 mm/s in tau
    attitude = Rotation.from_rotvec([0.4, -0.2, 1.1])
    x, y, z, w = attitude.as_quat()
    truth = {"q_nb": (w, x, y, z), "rate_eb_b": rate, "rate_change_b": change, "velocity_n": velocity}
    truth["acceleration_n"] = acceleration

    def antenna(t: float) -> Any:
        turned = attitude * Rotation.from_rotvec(rate * t + change * (t * t / 2))
        return velocity * t + 0.5 * acceleration * t**2 + turned.apply(arm)

    for offset in (0.0, tau):
        rows = {"gnss_interval": 0.05, "antenna_lever_arm_b": arm, "gnss_epoch_offset": offset}
        out = simulate(10, rows, truth)
        assert out["gnss_age"][9] == offset
        assert np.allclose(ned(out)[9], antenna(-offset), rtol=0, atol=2e-8)
        h = 1e-3
        slope = (antenna(h - offset) - antenna(-h - offset)) / (2 * h)
        assert np.allclose(out["gnss_velocity_n"][9], slope, rtol=0, atol=1e-5)


def test_noise_wander_and_reported_sigmas() -> None:
    n, white, wander, time = 8000, np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0]), 0.5
    rows = {"sample_interval": 0.1, "gnss_interval": 0.1, "gnss_velocity_noise": (0.1, 0.2, 0.3), "seed": 9}
    out = simulate(n, {**rows, "gnss_position_noise": white})
    errors = ned(out)
    assert_variance(errors, white**2)
    assert_variance(out["gnss_velocity_n"], (0.01, 0.04, 0.09))
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 4.5 / math.sqrt(n)
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 4.5 / math.sqrt(n)
    assert np.allclose(out["gnss_position_sigma"][-1], white) and np.allclose(out["gnss_velocity_sigma"][-1], (0.1, 0.2, 0.3))
    out = simulate(n, {**rows, "gnss_wander_sigma": wander, "gnss_wander_time": time})
    assert_gauss_markov(ned(out) / wander, 1.0, time, 0.1)
    both = simulate(10, {**rows, "gnss_position_noise": white, "gnss_wander_sigma": wander})
    assert np.allclose(both["gnss_position_sigma"][-1], np.hypot(white, wander), rtol=1e-12)
    perfect = simulate(10, {"sample_interval": 0.1, "gnss_interval": 0.1})
    assert (perfect["gnss_position_sigma"] > 0).all() and (perfect["gnss_velocity_sigma"] > 0).all()


def test_outliers_are_as_many_and_as_large_as_stated() -> None:
    n, probability, size = 8000, 0.05, 40.0
    rows = {"sample_interval": 0.1, "gnss_interval": 0.1, "seed": 10}
    out = simulate(n, {**rows, "gnss_outlier_probability": probability, "gnss_outlier_size": size})
    errors = ned(out)
    length = np.linalg.norm(errors, axis=1)
    wrong = length > 1.0
    low, high = binom.ppf([CHANCE / 2, 1 - CHANCE / 2], n, probability)
    assert low <= wrong.sum() <= high
    assert np.allclose(length[wrong], size, rtol=1e-6)
    assert length[~wrong].max() < 1e-6
    for i in range(3):  # uniform over the sphere: each component of variance 1/3
        assert_mean(errors[wrong, i] / size, 0.0, 3**-0.5)


def test_outage_windows_take_the_epochs_inside_them() -> None:
    rows = {"sample_interval": 0.1, "gnss_interval": 0.5}
    rows |= {"gnss_outage_start": [3.0, 7.0, *[0.0] * 13, 9.0], "gnss_outage_end": [5.0, 7.5, *[0.0] * 13, 11.0]}
    for latency in (0.0, 0.4):
        arrivals = np.flatnonzero(simulate(140, {**rows, "gnss_latency": latency})["gnss_valid"]) + 1
        epochs = np.round(arrivals * 0.1 - latency, 6)
        lost = {3.0, 3.5, 4.0, 4.5, 7.0, 9.0, 9.5, 10.0, 10.5}
        expected = [t for t in np.arange(1, 28) * 0.5 if t not in lost]
        assert epochs.tolist()[: len(expected)] == expected
    # the epoch, half a sample earlier, counts
    early = simulate(140, {**rows, "gnss_epoch_offset": 0.05})
    times = (np.flatnonzero(early["gnss_valid"]) + 1) * 0.1
    assert 3.0 in np.round(times, 6) and 5.0 not in np.round(times, 6)


def car(**gnss: Any) -> Any:
    return load({
        "title": "Car", "duration_s": 60.0, "rate_hz": 100.0, "seed": 4,
        "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
        "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 15.0}, {"turn_deg": 90.0, "radius_m": 40}, {"drive_s": 60}]},
        "imu": {"grade": "tactical"}, "gnss": {"grade": "rtk", **gnss},
    })  # fmt: skip


def test_lever_arm_and_delay_differ_from_what_is_told() -> None:
    """With them fixes are made (above): what is told of both is the rest."""
    late = {"grade": "perfect", "latency_s": 0.2, "lever_arm_m": [1.0, 0.0, -1.0]}
    wrong = {**late, "lever_arm_error_m": [0.3, -0.2, 0.1], "delay_error_s": 0.137}
    true = columns_of(build(car(**wrong), duration_s=30.0))
    at = np.flatnonzero(true["gnss_valid"])
    np.testing.assert_allclose(true["gnss_delay_true"], 0.137, atol=1e-12)
    np.testing.assert_allclose(true["antenna_lever_arm_true"][0], [1.3, -0.2, -0.9])
    # the epoch is a whole second less the part of a sample; the age says 0.137 s less than it was
    np.testing.assert_allclose(true["gnss_age"][at], 0.2, atol=1e-9)
    arrival = (at + 1) * 0.01
    np.testing.assert_allclose(arrival - true["gnss_age"][at] - 0.137, np.round(arrival - 0.34) - 0.007, atol=1e-9)


def test_drawn_lever_arm_and_delay() -> None:
    given = car(latency_s=0.4, lever_arm_sigma_m=[0.1, 0.2, 0.3], delay_sigma_s=0.05)
    made = build(given)
    x = starts(made.parameters, 1500, made.model)
    assert_variance(x["gnss_delay_true"], 0.05**2)
    np.testing.assert_allclose(x["gnss_latency_true"] + x["gnss_epoch_offset_true"], 0.4 + x["gnss_delay_true"], atol=1e-12)
    assert (x["gnss_epoch_offset_true"] >= 0.0).all() and (x["gnss_epoch_offset_true"] < 0.01).all()
    assert_variance(x["antenna_lever_arm_true"], (0.01, 0.04, 0.09))
    told = made.knowledge.rows
    np.testing.assert_allclose(told["antenna_lever_arm_sigma"], [0.1, 0.2, 0.3])
    assert told["gnss_delay_sigma"] == 0.05
    known = car(latency_s=0.4, lever_arm_error_m=[0.3, 0.0, -0.4], lever_arm_sigma_m=[0.4, 0.2, 0.3], delay_error_s=-0.12,
                delay_sigma_s=0.05)  # fmt: skip
    told = build(known).knowledge.rows  # a filter is told of both parts
    np.testing.assert_allclose(told["antenna_lever_arm_sigma"], [0.5, 0.2, 0.5])
    assert told["gnss_delay_sigma"] == pytest.approx(0.13)


def test_no_fix_is_from_the_future_and_one_is_pending() -> None:
    """A drawn delay beyond that is cut (a stated one is refused: tests/cli/wrong_calls.toml)."""
    late = {"grade": "rtk", "latency_s": 0.1, "interval_s": 0.2}
    for delay in (-0.1, 0.09):
        found = columns_of(build(car(**late, delay_error_s=delay), duration_s=1.0))
        np.testing.assert_allclose(found["gnss_delay_true"][0], delay, atol=1e-12)
    drawn = car(**late, delay_sigma_s=10.0)
    delays = [columns_of(build(drawn, seed=seed, duration_s=1.0))["gnss_delay_true"][0] for seed in range(6)]
    np.testing.assert_allclose(sorted({round(float(delay), 9) for delay in delays}), [-0.1, 0.09])
