"""The ship: regular sway as its description says, phasors that keep their radius, way and turns."""

import numpy as np
import pytest
from lone_vehicle import DEG, history

from insenv.vehicles import regular_sway, ship_course


def test_regular_sway_from_a_description() -> None:
    counts, values = regular_sway([
        {"motion": "roll", "amplitude_deg": 10, "period_s": 8},
        {"motion": "roll", "amplitude_deg": 1, "frequency_hz": 0.5, "phase_deg": 90},
        {"motion": "down", "amplitude_m": 1, "period_s": 8},
    ])  # fmt: skip
    assert counts == {"roll": 2, "down": 1}
    rows = history("two sines", values, 400, 40)
    t = np.arange(11) * 0.2
    roll = 10 * DEG * np.sin(2 * np.pi * t / 8) + DEG * np.cos(np.pi * t)
    np.testing.assert_allclose(2 * np.arcsin(rows["q_nb"][:, 1]), roll, atol=1e-14)


def test_under_way_it_keeps_speed_and_turns() -> None:
    course = ship_course([{"speed_mps": 6, "duration_s": 100}, {"turn_deg": -120, "duration_s": 100}, {"hold_s": 60}])
    _, values = regular_sway([{"motion": "roll", "amplitude_deg": 5, "period_s": 9}])
    start = {"segments": course, "start_heading": 1.0, "start_speed": 2.0, "start_latitude": 0.5, "sample_interval": 0.05}
    rows = history("under way", {**values, **start}, 5_200, 10)
    way = rows["way_heading"]
    assert rows["speed"][-1] == pytest.approx(6.0, abs=1e-3)
    assert way[-1] == pytest.approx(1.0 - 120 * DEG, abs=1e-3)
    along = np.column_stack([np.cos(way), np.sin(way)])
    np.testing.assert_allclose(rows["velocity_n"][:, :2], rows["speed"][:, None] * along, atol=1e-12)


def test_phasors_keep_their_radius_with_phases_of_the_seed_too() -> None:
    _, values = regular_sway([{"motion": "roll", "amplitude_deg": 10, "frequency_hz": 1.7}])
    rows = history("ship", values, 50_000, 5_000)
    np.testing.assert_allclose(np.hypot(rows["roll_sine"], rows["roll_cosine"]), 10 * DEG, rtol=1e-15)
    exact = 10 * DEG * np.sin(2 * np.pi * 1.7 * np.arange(11) * 25.0)
    np.testing.assert_allclose(rows["roll_sine"][:, 0], exact, rtol=0, atol=5e-12)
    _, values = regular_sway([{"motion": "pitch", "amplitude_deg": 5, "period_s": 7}])
    first, other = (history("seeded", values | {"seed": seed}, 10) for seed in (1, 2))
    for run in (first, other):
        np.testing.assert_allclose(np.hypot(run["pitch_sine"], run["pitch_cosine"]), 5 * DEG, rtol=1e-15)
    assert abs(first["pitch_sine"][0, 0] - other["pitch_sine"][0, 0]) > 1e-3
