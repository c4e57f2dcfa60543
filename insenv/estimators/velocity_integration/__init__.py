"""`velocity-integration`: alignment on the move, by measured velocities, from an unknown attitude.

`wahba`: the method.  `source`: what it takes of GNSS and of a Doppler log.  `estimator`: its parameters and its sentences.
"""

from insenv.estimators.velocity_integration.estimator import ESTIMATOR

__all__ = ["ESTIMATOR"]
