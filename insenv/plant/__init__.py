"""The plant: a vehicle and its sensors as one model.  The loop: a plant and an estimator as one model."""

from insenv.plant.assembly import plant_model
from insenv.plant.loop import loop_model

__all__ = ["loop_model", "plant_model"]
