"""Drawn errors of the optimal filter and smoother: against the limit, a closed form and what makes a smoother optimal."""

import numpy as np
import pytest
from changed_scenario import changed
from interpreted import interpreted  # noqa: F401
from yardsticks import error_paths

from insenv.evaluation.limits.bound import blocks_of, layout_of
from insenv.scenario import build, limit, load
from insenv.scenario.limits import prior_of

BEGIN, LONG, NOISE = 20.0, 60.0, 0.01  # s, s, m/s^1.5
DRIVE = {
    "title": "Straight on at a constant speed, only the accelerometers have noise",
    "duration_s": 100.0,
    "rate_hz": 20.0,
    "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "heading_deg": 30.0},
    "vehicle": {"kind": "car", "start_speed_mps": 20.0, "legs": [{"drive_s": 100.0}]},
    "imu": {"grade": "perfect", "accel_vrw_m_s_sqrt_h": 60 * NOISE},
    "gnss": {
        "grade": "perfect", "position_noise_m": [0.01] * 3, "velocity_noise_mps": [0.001] * 3, "interval_s": 1.0,
        "outages_s": [[BEGIN, BEGIN + LONG]],
    },
    "knowledge": {
        "tilt_sigma_deg": 1e-6, "heading_sigma_deg": 1e-6, "position_sigma_m": [0.01] * 3, "velocity_sigma_mps": 0.01,
    },
}  # fmt: skip


def drawn(scenario, windows, draws, duration_s=None):
    plant = build(scenario, seed=1, duration_s=duration_s)
    rows = plant.model.parameters.unpack(plant.model.parameters.pack(plant.parameters))
    layout = layout_of(rows, plant.sample_interval, False)
    blocks = blocks_of(plant.model, rows, plant.sample_interval, plant.samples, layout)
    return error_paths(blocks, layout, prior_of(scenario.knowledge), np.array(windows), draws, seed=3)


def test_errors_in_an_outage_are_the_integrals_of_white_noise_free_and_tied_at_both_ends():
    """Of noise N, t into T: filter N^2 t^3 / 3, smoother N^2 t^3 (T - t)^3 / (3 T^3)."""
    draws = 2000
    paths = drawn(load(DRIVE), [[BEGIN, BEGIN + LONG]], draws)
    t, T = paths.time - (BEGIN - 1.0), LONG + 1.0  # the last fix is 1 s before the outage
    free, tied = NOISE * np.sqrt(t**3 / 3), NOISE * np.sqrt(t**3 * (T - t) ** 3 / 3 / T**3)
    inside = (t > 10.0) & (t < T - 10.0)
    for axis in (0, 1):
        assert np.sqrt(np.mean(paths.filtered[inside, axis] ** 2, axis=1)) == pytest.approx(free[inside], rel=0.05)
        assert np.sqrt(np.mean(paths.smoothed[inside, axis] ** 2, axis=1)) == pytest.approx(tied[inside], rel=0.05)


def test_the_filters_errors_have_the_limit_and_the_smoothers_are_their_unpredictable_part():
    """What later measurements correct is independent of what they leave: the variances add.  With an odometer, fixes that are
    late, rest and every state of a unit."""
    windows, draws = [[10.0, 60.0], [70.0, 90.0]], 1000
    car = changed("car-odometer", rate_hz=20.0, vehicle={"engine": []})
    paths = drawn(car, windows, draws, duration_s=100.0)
    assert all(any(a <= t < b for a, b in windows) for t in paths.time)
    corrected = np.mean((paths.filtered - paths.smoothed) ** 2, axis=2)
    filtered, smoothed = (np.mean(errors**2, axis=2) for errors in (paths.filtered, paths.smoothed))
    assert np.mean((corrected + smoothed) / filtered, axis=0) == pytest.approx(1.0, rel=0.05)
    assert np.all(np.mean(smoothed, axis=0) < 0.9 * np.mean(filtered, axis=0))
    told = limit(car, duration_s=100.0).at(paths.time)
    for axis, name in enumerate(("north_m", "east_m", "down_m")):
        assert np.mean(filtered[:, axis]) == pytest.approx(np.mean(told[name] ** 2), rel=0.1)
