"""Vehicles: laws of motion, the truth made of them, and the section [vehicle] of each kind."""

from insenv.vehicles.aircraft import aircraft
from insenv.vehicles.aircraft_section import AircraftSection
from insenv.vehicles.car import car
from insenv.vehicles.car_section import CarSection
from insenv.vehicles.multirotor import multirotor
from insenv.vehicles.multirotor_section import MultirotorSection
from insenv.vehicles.routes import car_route, flight_plan, ship_course, survey_pattern
from insenv.vehicles.section import StartSection, VehicleSection
from insenv.vehicles.ship import regular_sway, ship
from insenv.vehicles.ship_section import ShipSection
from insenv.vehicles.traits import StickCommand, VehicleTraits
from insenv.vehicles.truth import TRUTH_PARAMETERS, TRUTH_STATE, Vehicle, truth_instant, truth_part
from insenv.vehicles.waves import Hull, irregular_sea

__all__ = [
    "TRUTH_PARAMETERS",
    "TRUTH_STATE",
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
