"""Estimators: one file a paper's idea, each a `Model`, found by id."""

from insenv.estimators.registry import Estimator, Knowledge, SensorNotes, get, registered

__all__ = ["Estimator", "Knowledge", "SensorNotes", "get", "registered"]
