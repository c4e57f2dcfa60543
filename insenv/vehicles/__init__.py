"""Vehicles: laws of motion, the truth made of them, and the section [vehicle] of each kind."""

from insenv.vehicles.aircraft import AircraftSection, aircraft, flight_plan, survey_pattern
from insenv.vehicles.car import CarSection, car, car_route
from insenv.vehicles.multirotor import MultirotorSection, multirotor
from insenv.vehicles.section import Actions, StartSection, StickCommand, VehicleSection, VehicleTraits
from insenv.vehicles.ship import ShipSection, regular_sway, ship, ship_course
from insenv.vehicles.truth import TRUTH_PARAMETERS, TRUTH_STATE, Vehicle, truth_instant, truth_part
from insenv.vehicles.waves import Hull, irregular_sea

__all__ = [
    "TRUTH_PARAMETERS",
    "TRUTH_STATE",
    "Actions",
    "AircraftSection",
    "CarSection",
    "Hull",
    "MultirotorSection",
    "ShipSection",
    "StartSection",
    "StickCommand",
    "Vehicle",
    "VehicleSection",
    "VehicleTraits",
    "aircraft",
    "car",
    "car_route",
    "flight_plan",
    "irregular_sea",
    "multirotor",
    "regular_sway",
    "ship",
    "ship_course",
    "survey_pattern",
    "truth_instant",
    "truth_part",
]
