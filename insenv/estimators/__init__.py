"""Estimators: one file an id, each an `Estimator` around a `Model`; `parts/` holds the equations that several share."""

from insenv.estimators.contract import Drive, Estimator, Knowledge, SensorNotes
from insenv.estimators.registry import EstimatorsLike, get, get_all, register, registered

__all__ = ["Drive", "Estimator", "EstimatorsLike", "Knowledge", "SensorNotes", "get", "get_all", "register", "registered"]
