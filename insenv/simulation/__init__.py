"""Simulation: a vehicle and its sensors stepped together, the plant."""

from insenv.simulation.loop import loop_model
from insenv.simulation.plant import plant_model

__all__ = ["loop_model", "plant_model"]
