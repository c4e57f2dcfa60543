"""Wrong legs of routes and flight plans are named with their numbers."""

import pytest

from insenv.errors import InputError
from insenv.vehicles import car_route, flight_plan


@pytest.mark.parametrize(
    ("planned", "legs", "said"),
    [
        (car_route, [{"turn_deg": 90, "duration_s": 5}], "leg 1: turn_deg = 90: a stationary car cannot turn"),
        (car_route, [{"accelerate_to_mps": 5}, {"turn_deg": 90}], "leg 2: turn_deg needs either"),
        (car_route, [{"drive_s": 5, "wait_s": 5}], "exactly one of"),
        (car_route, [{"drive": 5}], "did you mean 'drive_s'"),
        (car_route, [{"drive_s": -5}], "drive_s = -5"),
        (car_route, [{"stop_s": "long"}], "stop_s = 'long'"),
        (car_route, [{"accelerate_to_mps": 5, "acceleration_mps2": 0}], "acceleration_mps2 = 0"),
        (flight_plan, [{"turn_deg": 90}], "leg 1: turn_deg = 90 at 0 m/s"),
        (flight_plan, [{"speed_mps": 20}, {"climb_to_m": 500}], "leg 2: climb_to_m = 500 at 20 m/s: allowed is above 45"),
        (flight_plan, [{"speed_mps": 80}, {"turn_deg": 5, "bank_deg": 30}], "before the bank has settled"),
        (flight_plan, [{"speed_mps": 80}, {"turn_deg": 90, "bank_deg": 60}], "bank 1.0472 rad"),
        (flight_plan, [{"speed_mps": -1}], "speed_mps = -1"),
    ],
)
def test_bad_legs(planned, legs: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        planned(legs)
