"""`loosely-coupled`: strapdown navigation with GNSS positions and velocities, a 15-state filter with full feedback; `smoother`.

A filter of `insenv.estimators.fusion` with no states but navigation and biases, and two aids: GNSS, and zero velocity at each
sample of a vehicle known to be at rest. `smoother` is the fixed-interval smoothing of its run
(`insenv.estimators.fusion.smoothing`); `insenv.runs.smoothed` runs both passes.

Source: the airborne-navigation paper: its GPS/SINS filter (15 states, first-order Gauss-Markov drift and bias), smoothed by
filters forward and backward.
"""

from __future__ import annotations

from dataclasses import replace

from insenv.core.tables import Row
from insenv.estimators.contract import Estimator
from insenv.estimators.fusion import history, navigation
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.error_state import ACCEL_BIAS, GYRO_BIAS
from insenv.estimators.fusion.gnss import WHITE
from insenv.estimators.fusion.restart import restarts
from insenv.estimators.fusion.smoothing import smoothing_of
from insenv.estimators.fusion.surprising import surprising
from insenv.estimators.fusion.zero_velocity import AT_EACH_SAMPLE
from insenv.estimators.parts import applicability

FILTER = Composition(
    "loosely-coupled",
    "GNSS/INS, 15 states, position and velocity of GNSS loosely coupled",
    (GYRO_BIAS, ACCEL_BIAS),
    (WHITE, AT_EACH_SAMPLE),
    Row(
        "covariance_kept",
        "1: feedback leaves the covariance as it is, the conventional filter of small angles",
        lower=0,
        upper=1,
        flag=True,
    ),
)
_OF_UNIT = applicability.unmodelled_motion, applicability.noiseless
_FILTER = Estimator(
    FILTER.model,
    kind="navigation",
    sensors=("gnss",),
    error=FILTER.consistency_error,
    without=navigation.without,
    applicability=applicability.together(applicability.linear_start, *_OF_UNIT),
    findings=lambda parameters: (*surprising(FILTER.states, parameters), *restarts(FILTER.aids)),
    causes=FILTER.causes,
    max_measurement_age_s=history.OLDEST,
)

SMOOTHING = smoothing_of(replace(FILTER, covariance_held=None), "smoother")
_SMOOTHER = replace(
    _FILTER,
    model=SMOOTHING.forward,
    smooths=FILTER.id,
    smoothing=SMOOTHING,
    applicability=applicability.together(applicability.smoothed_start, *_OF_UNIT),
)
ESTIMATORS = (_FILTER, _SMOOTHER)
