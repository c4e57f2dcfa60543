"""The limit: the posterior Cramer-Rao bound along the true trajectory.

The limit of a channel at a time is the standard deviation of the optimal filter, linearised on the truth, which knows the
statistics of all error sources and of the initial errors, every fix delivered by then, and when the vehicle is at rest or
sways about a place.  It depends on no estimator, and it is one number over the ensemble of units, noises and start
errors: the same for every seed of a scenario.  docs/limits.md has the definition, how it is checked, and values.
"""

from insenv.evaluation.limits.bound import FLOOR, Limit, bound, ratio, ratio_bounds
from insenv.evaluation.limits.recursion import Prior

__all__ = ["FLOOR", "Limit", "Prior", "bound", "ratio", "ratio_bounds"]
