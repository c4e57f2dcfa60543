"""Estimators: one file an id, each an `Estimator` around a `Model`; `parts/` holds the equations that several share."""

from insenv.estimators.contract import Drive, Estimator
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts.finding import Finding
from insenv.estimators.registry import EstimatorsLike, get, get_all, register, registered
from insenv.sensors.data_sheet import ImuDataSheet

__all__ = [
    "Drive",
    "Estimator",
    "EstimatorsLike",
    "Finding",
    "ImuDataSheet",
    "Knowledge",
    "get",
    "get_all",
    "register",
    "registered",
]
