"""`aqe-ekf`: large-misalignment alignment by the additive quaternion error, extended Kalman filter.

The model of `insenv.estimators.parts.quaternion_error` linearised at the estimate: of (9) only 2 Y^T(dQ) U(Q_hat) f is kept.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.estimators.parts.aqe_algebra import Nonlinear, sensitivity
from insenv.estimators.parts.quaternion_error import estimator


def linearised(q_hat: Any, P: Any, velocity: Any, distance: Any) -> Nonlinear:
    """The nonlinear part by its derivative at the estimate."""
    G = ca.vertcat(sensitivity(q_hat, velocity), sensitivity(q_hat, distance))
    return Nonlinear(G, ca.SX.zeros(6), ca.SX(6, 6), attitude.to_dcm(q_hat))


ESTIMATOR = estimator("aqe-ekf", "large misalignment: additive quaternion error, extended Kalman filter", linearised)
