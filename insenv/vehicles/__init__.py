"""Vehicles: laws of motion, and the truth computed from them."""

from insenv.vehicles.aircraft import aircraft
from insenv.vehicles.car import car
from insenv.vehicles.routes import car_route, flight_plan, ship_course, survey_pattern
from insenv.vehicles.ship import regular_sway, ship
from insenv.vehicles.truth import TRUTH_PARAMETERS, TRUTH_STATE, Vehicle, truth_instant, truth_part
from insenv.vehicles.waves import Hull, irregular_sea

__all__ = [
    "TRUTH_PARAMETERS",
    "TRUTH_STATE",
    "Hull",
    "Vehicle",
    "aircraft",
    "car",
    "car_route",
    "flight_plan",
    "irregular_sea",
    "regular_sway",
    "ship",
    "ship_course",
    "survey_pattern",
    "truth_instant",
    "truth_part",
]
