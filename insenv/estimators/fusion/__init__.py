"""Fusion filters: navigation with any instruments, composed from error states and aids.

`fusion` makes one from names or own parts; the estimator `fusion` chooses them by the unit, the instruments and the vehicle.
"""

from insenv.estimators.fusion.contract import Aid, ErrorState
from insenv.estimators.fusion.family import ESTIMATORS, fusion

__all__ = ["ESTIMATORS", "Aid", "ErrorState", "fusion"]
