"""Wrong legs, segments, sway and seas are refused by name and number."""

import pytest

from insenv.base.errors import InputError
from insenv.vehicles import Hull, car_route, flight_plan, irregular_sea, regular_sway
from insenv.vehicles.car import SCRIPT
from insenv.vehicles.multirotor import SCRIPT as FLIGHT
from insenv.vehicles.multirotor import MultirotorLeg, flight
from insenv.vehicles.script import N_SEGMENTS


def multirotor(legs):
    return FLIGHT.table(flight([MultirotorLeg(**leg) for leg in legs]))


@pytest.mark.parametrize(("planned", "legs", "said"), [
    (car_route, [{"turn_deg": 90, "duration_s": 5}], r"legs\[0\]: turn_deg = 90"),  # at rest
    (car_route, [{"accelerate_to_mps": 5}, {"turn_deg": 90}], r"legs\[1\]: turn_deg needs either"),
    (flight_plan, [{"turn_deg": 90}], r"legs\[0\]: turn_deg = 90 at 0 m/s"),
    (flight_plan, [{"speed_mps": 20}, {"climb_to_m": 500}], r"legs\[1\]: climb_to_m = 500 at 20 m/s"),
    (flight_plan, [{"speed_mps": 80}, {"turn_deg": 5, "bank_deg": 30}], r"legs\[1\]: a turn by 5 deg .* is over before"),
    (flight_plan, [{"speed_mps": 50}, {"survey_lines": 3, "line_m": 900}, {"climb_mps": 5}], r"legs\[2\] has none"),
    (multirotor, [{"hover_s": 5}, {"turn_deg": 90}], r"legs\[1\]: turn_deg needs duration_s"),
    (multirotor, [{"turn_deg": 3600, "duration_s": 1}], "turn_deg = 3600 in 1 s is 3600 deg/s: allowed is up to 229"),
    (multirotor, [{"turn_deg": 3600, "duration_s": 10}], r"legs\[0\]: turn_deg = 3600 in 10 s is 360 deg/s"),
    (SCRIPT.table, [{"speed": 3.0}], "segment 1: duration is missing"),
    (SCRIPT.table, [{"duration": 1.0}, {"duration": 1.0, "speed": float("nan")}], "segment 2: speed = nan"),
    (SCRIPT.table, [{"duration": 1.0}] * (N_SEGMENTS + 1), "at most 64"),
    (regular_sway, [{"motion": "roll", "amplitude_deg": 1}], "sway 1: needs either period_s .s. or"),
    (lambda size: Hull(length=size), 0, "length = 0"),
    (lambda height: irregular_sea(height, 8.0), -1.0, "significant_height = -1"),
])  # fmt: skip
def test_wrong_plans(planned, legs, said):
    with pytest.raises(InputError, match=said):
        planned(legs)
