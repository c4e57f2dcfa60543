"""The aircraft: from the ground to survey lines, in coordinated turns."""

import numpy as np
import pytest
from lone_vehicle import DEG, history

from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles import flight_plan, survey_pattern


def test_flight_from_the_ground_to_survey_lines() -> None:
    h = 0.05
    legs = [
        {"wait_s": 20}, {"speed_mps": 8}, {"turn_deg": 90, "bank_deg": 4}, {"speed_mps": 80, "acceleration_mps2": 3},
        {"climb_to_m": 300}, {"climb_to_m": 600, "climb_mps": 10}, *survey_pattern(3, 4000),
    ]  # fmt: skip
    plan = flight_plan(legs, start_height_m=100)
    start = {"start_latitude": 0.7, "start_height": 100.0, "sample_interval": h, "segments": plan}
    rows = history("aircraft", start, round(plan[:, 0].sum() / h))
    assert rows["height"][-1] == pytest.approx(600, abs=1.0)
    assert rows["track"][-1] == pytest.approx(90 * DEG, abs=0.1 * DEG)
    assert rows["track"].max() == pytest.approx(270 * DEG, abs=0.1 * DEG)
    assert rows["speed"].min() > -1e-12 and rows["speed"][-1] == pytest.approx(80, abs=1e-6)
    on_ground = rows["airborne"] == 0.0
    assert on_ground.sum() * h > 30 and np.abs(rows["height"][on_ground] - 100).max() < 1e-4
    # coordinated: the rate follows from bank and speed, with no force across the wings
    flying = rows["airborne"] > 0.999
    expected = STANDARD_GRAVITY * np.tan(rows["bank"]) / rows["speed"].clip(1)
    np.testing.assert_allclose(rows["turn_rate"][flying], expected[flying], atol=1e-12)
    force = rows["true_delta_velocity"] / h
    assert np.abs(force[flying, 1]).max() < 0.1 and rows["bank"].max() > 19 * DEG and rows["bank"].min() < -19 * DEG
    assert np.abs(np.diff(rows["rate_ib_b"], axis=0)).max() < 1.0 * h and np.abs(np.diff(force, axis=0)[2:]).max() < 8 * h
    begun_in_flight = history("aircraft", {"start_height": 600.0, "start_speed": 80.0, "sample_interval": h}, 100)
    assert begun_in_flight["speed"] == pytest.approx(80.0)  # no leg slows it
