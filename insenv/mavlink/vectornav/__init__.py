"""A VectorNav VN-300 or VN-100 made of the streamed vehicle: binary outputs and the commands that set them."""

from insenv.mavlink.vectornav.unit import MODELS, Unit, UnitStream

__all__ = ["MODELS", "Unit", "UnitStream"]
