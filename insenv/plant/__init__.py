"""Simulation: a vehicle and its sensors stepped together, the plant."""

from insenv.plant.assembly import plant_model
from insenv.plant.loop import loop_model

__all__ = ["loop_model", "plant_model"]
