"""The section [vehicle] of a scenario, one class a kind, and the equations made of it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from insenv.scenario.aircraft import AircraftSection
from insenv.scenario.car import CarSection
from insenv.scenario.legs import Structure
from insenv.scenario.ship import ShipSection
from insenv.vehicles import Vehicle, aircraft, car, ship

VehicleSection = Annotated[ShipSection | CarSection | AircraftSection, Field(discriminator="kind")]


def make_vehicle(structure: Structure) -> Vehicle:
    """The vehicle of a structure."""
    kind, *rest = structure
    if kind == "ship":
        regular, wave_components, under_way, seeded = rest
        return ship(dict(regular), wave_components, under_way, seeded)
    return {"car": car, "aircraft": aircraft}[kind](*rest)
