"""Gusts have the given standard deviation and correlation time, on each vehicle that has them."""

import numpy as np
import pytest
from lone_vehicle import history


def test_a_parked_car_sways_in_the_wind_with_the_given_sigma_and_repeats_with_the_seed() -> None:
    parameters = {
        "wind_roll_sigma": 0.002, "wind_pitch_sigma": 0.001, "wind_time_constant": 0.5, "engine_angular_frequency": 157.0,
        "engine_down_amplitude": 1e-5, "sample_interval": 0.02, "seed": 5,
    }  # fmt: skip
    rows = history("car", parameters, 50_000)
    process = rows["wind_roll_target"]
    assert process.std() == pytest.approx(0.002, rel=0.05)
    assert np.corrcoef(process[:-25], process[25:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)
    a, b = 9.0, 2.0  # bandwidth, 1 / time constant: variance after two poles at a
    assert rows["wind_pitch"].std() == pytest.approx(0.001 * np.sqrt(a * (b + 2 * a) / 2) / (a + b), rel=0.05)
    np.testing.assert_allclose(rows["latitude"], 0.0, atol=1e-12)
    again, other = history("car", parameters, 200), history("car", parameters | {"seed": 6}, 200)
    assert np.array_equal(again["wind_roll"], rows["wind_roll"][:201]) and other["wind_roll"][100] != again["wind_roll"][100]


def test_gusts_move_attitude_and_velocity() -> None:
    sigmas = {f"gust_{name}_sigma": 0.01 for name in ("roll", "pitch", "yaw")}
    sigmas |= {f"gust_{name}_sigma": 0.5 for name in ("north", "east", "down")}
    rows = history("aircraft", {**sigmas, "start_speed": 80.0, "start_height": 1e3, "sample_interval": 0.02}, 20_000)
    assert 0.3 < rows["velocity_n"][:, 2].std() < 0.6 and 0.005 < rows["gust_yaw"].std() < 0.015
    found = np.corrcoef([rows[f"gust_{n}_target"] for n in ("roll", "pitch", "yaw", "north", "east", "down")])
    assert np.abs(found - np.eye(6)).max() < 0.3
    rows = history("multirotor", {**sigmas, "start_height": 100.0, "sample_interval": 0.02}, 20_000)
    assert 0.3 < rows["velocity_n"][:, 0].std() < 0.6 and 0.005 < rows["gust_roll"].std() < 0.015
