"""kind = "waypoints": a plan of places, speeds and stops becomes a drive that keeps to it."""

import numpy as np
import pytest
from closed_track import truth_of

import insenv
from insenv.base.errors import InputError

PLACES = [
    {"latitude_deg": 45.0, "longitude_deg": 7.0, "height_m": 300.0, "speed_mps": 15.0},
    {"latitude_deg": 45.01, "longitude_deg": 7.0, "height_m": 310.0, "speed_mps": 10.0},
    {"latitude_deg": 45.01, "longitude_deg": 7.01, "height_m": 310.0, "speed_mps": 20.0, "stop_s": 20.0},
    {"latitude_deg": 45.02, "longitude_deg": 7.015, "height_m": 330.0, "speed_mps": 20.0},
]


def scenario(places=PLACES, vehicle=None, **more):
    vehicle = {"kind": "waypoints", "waypoints": places, **(vehicle or {})}
    return insenv.load({"title": "t", "rate_hz": 50.0, "vehicle": vehicle, **more})


def test_the_drive_keeps_to_the_plan():
    loaded = scenario(vehicle={"bank": "level", "acceleration_mps2": 0.8})
    time, shown = truth_of(loaded)
    velocity = shown["velocity_n"]
    latitude, longitude = (np.degrees(shown[name]).ravel() for name in ("latitude", "longitude"))
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    assert speed.max() == pytest.approx(20.0, abs=0.1)
    assert speed[time < 1.0].max() < 0.05 and speed[-1] < 0.05
    assert (latitude[-1], longitude[-1]) == (pytest.approx(45.02, abs=1e-6), pytest.approx(7.015, abs=1e-6))
    assert shown["height"].ravel()[-1] == pytest.approx(330.0, abs=0.05)
    at_stop = np.hypot(111e3 * (latitude - 45.01), 78.8e3 * (longitude - 7.01)) < 0.5
    assert 19.0 < at_stop.sum() / 50.0 < 24.0
    # the corner at the second place: an arc that leaves it some metres inside
    assert 1.0 < np.hypot(111e3 * (latitude - 45.01), 78.8e3 * (longitude - 7.0)).min() < 25.0
    push = np.linalg.norm(np.gradient(velocity[:, :2], time, axis=0), axis=1)
    assert push.max() < 2.4  # 2 m/s2 in the turn; splines add some at its ends
    along = np.gradient(speed, time)
    assert [along.min(), along.max()] == pytest.approx([-0.8, 0.8], abs=0.15)
    assert speed[np.searchsorted(time, 50.0)] == pytest.approx(15.0, abs=0.05)


def test_a_coordinated_turn_banks():
    _, shown = truth_of(scenario(rate_hz=20.0))
    roll = np.degrees(np.array(insenv.attitude.numeric.to_euler(shown["q_nb"]))[0])
    assert roll.max() == pytest.approx(np.degrees(np.arctan(2.0 / 9.80665)), abs=1.5)  # the turn to the right


def test_a_corner_between_any_two_directions_is_an_arc():
    shape = scenario([*PLACES[:2], {**PLACES[2], "stop_s": 0.0}, PLACES[3]]).vehicle.shape
    push = shape.spline.at(np.linspace(0.0, shape.duration_s, 2000), 2)[:, :2] * [6.37e6, 4.5e6]
    assert np.linalg.norm(push, axis=1).max() < 2.4


FIRST, SECOND = PLACES[:2]


@pytest.mark.parametrize(("places", "message"), [
    ([FIRST, FIRST], r"vehicle.waypoints\[1\]: 0 m from the place before"),
    ([FIRST, SECOND, FIRST], r"waypoints\[1\]: a turn of 180 deg"),
    ([{**FIRST, "stop_s": 86400.0}, SECOND], "the plan lasts 86474.* s or more"),
    ([{**FIRST, "latitude_deg": 89.9}, {**SECOND, "latitude_deg": 89.9, "longitude_deg": 187.0}], "latitude 89.95"),
])  # fmt: skip
def test_wrong_plans_are_refused(places, message):
    with pytest.raises(InputError, match=message):
        scenario(places)


def test_a_plan_across_the_date_line():
    places = [{"latitude_deg": 45.0, "longitude_deg": longitude, "speed_mps": 15.0} for longitude in (179.995, -179.995)]
    shape = scenario(places).vehicle.shape
    times = np.linspace(0.0, shape.duration_s, 500)
    assert np.abs(4.5e6 * shape.spline.at(times, 1)[:, 1]).max() < 16.0
    assert 4.5e6 * (shape.spline.at(times)[-1, 1] - shape.spline.at(times)[0, 1]) == pytest.approx(788.0, abs=5.0)


def test_a_plan_that_is_to_be_met_stands_at_its_end():
    """Without smoothing the knots cannot meet every point of the plan: the spline must not ring where the points end."""
    places = [(47.0, 11.0, 500.0, 15.0), (47.004, 11.0, 500.0, 15.0), (47.004, 11.006, 505.0, 10.0)]
    keys = ("latitude_deg", "longitude_deg", "height_m", "speed_mps")
    shape = scenario([dict(zip(keys, each, strict=True)) for each in places], {"smoothing_m": 0.0}).vehicle.shape
    time = np.linspace(shape.duration_s - 1.0, shape.duration_s, 1001)
    velocity, acceleration = (shape.spline.at(time, order)[:, :3] * [6.37e6, 4.35e6, 1.0] for order in (1, 2))
    assert np.linalg.norm(velocity, axis=1).max() < 0.05
    assert np.linalg.norm(acceleration, axis=1).max() < 0.1
