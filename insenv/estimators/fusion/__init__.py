"""Fusion filters: navigation with any instruments, composed from error states and aids.

`fusion` makes one from names or own parts; the estimator `fusion` chooses them by the unit, the instruments and the vehicle.
An own aid is an `Aid`, an own error a `constant` or `drifting` one (docs/write-your-own.md).
"""

from insenv.estimators.fusion.aid import Aid, gate_row
from insenv.estimators.fusion.error_state import ErrorState, constant, drifting, sigma_row
from insenv.estimators.fusion.family import ESTIMATORS, fusion

__all__ = ["ESTIMATORS", "Aid", "ErrorState", "constant", "drifting", "fusion", "gate_row", "sigma_row"]
