"""The car: routes driven smoothly, its suspension."""

import numpy as np
import pytest
from lone_vehicle import DEG, history

from insenv.vehicles import car_route

ROUTE = [
    {"wait_s": 5, "load_roll_deg": 0.5, "load_down_m": 0.01}, {"accelerate_to_mps": 15, "acceleration_mps2": 2.5},
    {"drive_s": 5, "grade_percent": 4}, {"turn_deg": 90, "duration_s": 6}, {"turn_deg": -45, "radius_m": 60},
    {"drive_s": 3, "grade_percent": 0}, {"stop_s": 10},
]  # fmt: skip


def test_a_route_is_driven_smoothly() -> None:
    h = 0.01
    start = {"start_latitude": 0.6, "start_heading": 0.2, "sample_interval": h, "imu_lever_arm_b": [0.5, 0.3, -0.6]}
    rows = history("car", {"segments": car_route(ROUTE), **start}, 7000)
    assert rows["speed"].max() == pytest.approx(15, abs=1e-3)
    assert rows["speed"].min() > -1e-12 and abs(rows["speed"][-1]) < 1e-6
    assert rows["path_heading"][-1] == pytest.approx(0.2 + 45 * DEG, abs=0.3 * DEG)
    assert rows["height"].max() > 3 and np.abs(rows["velocity_n"][-1]).max() < 1e-5
    # rate and velocity are continuous, also between segments
    assert np.abs(np.diff(rows["velocity_n"], axis=0)).max() < 6 * h
    assert np.abs(np.diff(rows["rate_ib_b"], axis=0)).max() < 2 * h
    middle = np.diff(rows["height"]) / h
    np.testing.assert_allclose(middle, -0.5 * (rows["velocity_n"][1:, 2] + rows["velocity_n"][:-1, 2]), atol=1e-3)
    # people got in
    assert 2 * np.arcsin(rows["q_nb"][450]) @ [0, np.cos(0.1), np.sin(0.1), 0] == pytest.approx(0.5 * DEG, rel=1e-3)


def test_it_leans_out_of_a_turn_and_noses_up_when_accelerating() -> None:
    rows = history("car", {"segments": car_route([{"accelerate_to_mps": 12}, {"turn_deg": 180, "duration_s": 15}])}, 3400)
    assert rows["suspension_pitch"][300] > 0.005  # 1.5 s into the acceleration
    assert rows["suspension_roll"][-800:].min() < -0.01 and rows["curvature"].max() > 0.01


@pytest.mark.parametrize("stop_s", [3.0, 10.0])
def test_it_stands_as_long_as_its_leg_says(stop_s: float) -> None:
    """The time counts from standing still, not from the brake; the last 2 mm/s of the speed loop fade meanwhile."""
    legs = [{"accelerate_to_mps": 12.0, "acceleration_mps2": 3.0}, {"stop_s": stop_s}, {"accelerate_to_mps": 5.0}]
    speed = history("car", {"segments": car_route(legs), "sample_interval": 0.01}, 6000)["speed"]
    fastest = int(np.argmax(speed))
    stands = np.flatnonzero(speed[fastest : fastest + 2000] < 0.05)
    assert len(stands) * 0.01 == pytest.approx(stop_s, abs=1.0)
