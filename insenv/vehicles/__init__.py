"""Vehicles: laws of motion, and the truth made of them."""

from insenv.vehicles.aircraft import AIRCRAFT_TRAITS, aircraft
from insenv.vehicles.car import CAR_TRAITS, car
from insenv.vehicles.routes import car_route, flight_plan, ship_course, survey_pattern
from insenv.vehicles.ship import SHIP_TRAITS, regular_sway, ship
from insenv.vehicles.traits import StickCommand, VehicleTraits
from insenv.vehicles.truth import TRUTH_PARAMETERS, TRUTH_STATE, Vehicle, truth_instant, truth_part
from insenv.vehicles.waves import Hull, irregular_sea

__all__ = [
    "TRUTH_PARAMETERS",
    "TRUTH_STATE",
    "Hull",
    "StickCommand",
    "Vehicle",
    "VehicleTraits",
    "aircraft",
    "car",
    "car_route",
    "flight_plan",
    "irregular_sea",
    "regular_sway",
    "ship",
    "ship_course",
    "survey_pattern",
    "traits_of",
    "truth_instant",
    "truth_part",
]

_TRAITS = {"ship": SHIP_TRAITS, "car": CAR_TRAITS, "aircraft": AIRCRAFT_TRAITS}


def traits_of(kind: str) -> VehicleTraits:
    """The traits of a kind of vehicle, as a scenario's ``vehicle.kind`` names it.  Raises `KeyError` for another name."""
    return _TRAITS[kind]
