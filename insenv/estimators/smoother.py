"""`smoother`: fixed-interval smoothing of a `loosely-coupled` run (`insenv.estimators.fusion.smoothing`).

Source: the airborne-navigation paper, which smooths by filters forward and backward.  `insenv.runs.smoothed` runs both passes.
"""

from __future__ import annotations

from dataclasses import replace

from insenv.estimators.fusion.smoothing import smoothing_of
from insenv.estimators.loosely_coupled import ESTIMATOR as OF_FILTER
from insenv.estimators.loosely_coupled import FILTER

SMOOTHING = smoothing_of(replace(FILTER, kept=None), "smoother")
ESTIMATOR = replace(OF_FILTER, model=SMOOTHING.forward, smooths=FILTER.id, smoothing=SMOOTHING)
