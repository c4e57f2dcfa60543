"""Simulation: a vehicle and its sensors stepped together, the plant."""

from insenv.simulation.plant import plant_model

__all__ = ["plant_model"]
