"""Estimators: one file an id, each an `Estimator` around a `Model`; `parts/` holds the equations that several share."""

from insenv.estimators.contract import Drive, Estimator, Knowledge, SensorNotes
from insenv.estimators.registry import get, register, registered

__all__ = ["Drive", "Estimator", "Knowledge", "SensorNotes", "get", "register", "registered"]
