"""The multirotor: it follows its commands, leans as its thrust must, and its truth is exact."""

import numpy as np
import pytest
from lone_vehicle import DEG, history

import insenv
from insenv.errors import InputError
from insenv.evaluation.errors import POSITION
from insenv.scenario import load
from insenv.vehicles.multirotor import SCRIPT
from insenv.vehicles.multirotor_section import MultirotorLeg, flight

GRAVITY = 9.80665


def flown(legs: list, seconds: float, h: float = 0.02, **parameters):
    segments = SCRIPT.table(flight([MultirotorLeg(**leg) for leg in legs]))
    start = {"start_latitude": 0.8, "start_height": 100.0, "sample_interval": h, "segments": segments, **parameters}
    return history("multirotor", start, round(seconds / h))


def test_without_legs_and_gusts_it_stays_where_it_is() -> None:
    start = {"start_latitude": 0.8, "start_height": 100.0, "start_heading": 1.0, "sample_interval": 0.02}
    rows = history("multirotor", start, 500)
    assert np.all(rows["velocity_n"] == 0.0) and np.all(rows["height"] == 100.0)


def test_it_flies_turns_and_climbs_as_its_legs_say() -> None:
    legs = [{"hover_s": 5}, {"fly_s": 20, "forward_mps": 8.0}, {"turn_deg": 90, "duration_s": 6},
            {"fly_s": 20, "right_mps": -3.0}, {"fly_s": 10, "climb_mps": 2.0}, {"hover_s": 20}]  # fmt: skip
    rows = flown(legs, 81.0)
    time = np.arange(len(rows["yaw"])) * 0.02

    def at(t: float, name: str):
        return rows[name][np.searchsorted(time, t)]

    np.testing.assert_allclose(at(24.9, "velocity_n"), [8.0, 0.0, 0.0], atol=1e-3)
    # against the drag it leans forward, and the accelerometer feels the drag
    force = rows["true_delta_velocity"] / 0.02
    np.testing.assert_allclose(force[np.searchsorted(time, 24.9), 0], -GRAVITY * np.sin(0.15 * 8.0 / GRAVITY), rtol=2e-3)
    assert at(80.0, "yaw") == pytest.approx(90 * DEG, abs=1e-6)
    np.testing.assert_allclose(at(50.9, "velocity_n"), [3.0, 0.0, 0.0], atol=2e-3)  # to the left of east
    assert rows["height"][-1] == pytest.approx(120.0, abs=0.01)
    np.testing.assert_allclose(at(80.9, "velocity_n"), 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("legs", "said"),
    [
        ([{"hover_s": 5, "fly_s": 5}], "leg 1 has hover_s and fly_s: allowed is exactly one of hover_s, fly_s, turn_deg"),
        ([{"hover_s": 5}, {"turn_deg": 90}], "leg 2: turn_deg needs duration_s"),
        ([{"hover_s": 5, "forward_mps": 2.0}], "leg 1: forward_mps does not go with hover_s: allowed is nothing"),
        ([{"fly_s": 5, "forward_mps": 70.0}], "forward_mps = 70"),
        ([{"turn_deg": 3600, "duration_s": 10}], "segment 1: yaw_rate = 6.28"),
    ],
)
def test_bad_legs(legs: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        flown(legs, 1.0)


def test_a_perfect_unit_navigates_it_without_drift() -> None:
    """A flight with gusts and vibration, a perfect unit, an exact start: 1 mm in 25 s at 200 Hz."""
    given = load({
        "title": "Hover", "duration_s": 25.0, "rate_hz": 200.0,
        "start": {"latitude_deg": 47.0, "longitude_deg": 8.0, "height_m": 500.0, "heading_deg": 20.0},
        "vehicle": {
            "kind": "multirotor", "engine": [{"frequency_hz": 20.0, "roll_deg": 0.02, "pitch_deg": 0.02, "down_m": 1e-5}],
            "gust_roll_sigma_deg": 1.0, "gust_pitch_sigma_deg": 1.0, "gust_yaw_sigma_deg": 0.5, "gust_velocity_sigma_mps": 0.3,
            "legs": [{"hover_s": 3}, {"fly_s": 8, "forward_mps": 8.0}, {"turn_deg": 180, "duration_s": 6}, {"hover_s": 20}],
        },
        "knowledge": {"draw_errors": False},
    })  # fmt: skip
    errors = insenv.run(given, "wander-sins").results[0].errors
    for channel in POSITION:
        assert np.abs(errors[channel]).max() < 1e-3, channel
