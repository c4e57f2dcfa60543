"""`aqe-sukf-printed`: the simplified unscented Kalman filter of the large-misalignment paper, with its points and weights.

`aqe-sukf` is insenv's filter of the same error model; this one is for comparison with the paper. Its states are those of the
paper, dQ, dv and the biases (13), and the position error. The unscented transform of n = 13 states has 2 n + 1 = 27 points at
sqrt(n + kappa) times the columns of the Cholesky factor, with the weights 1 / (2 (n + kappa)), and kappa / (n + kappa) in the
centre. Points that do not differ in dQ give what the centre gives, since the rest of the model is linear, so with dQ first 8
points remain. The points are not normalised: dC is (9), of second order in dQ, so with q_i = Y^T(c_i) U(c_i) f of column c_i

    mean        - sum of q_i
    covariance  G P G^T + (n + kappa) sum of q_i q_i^T - (sum of q_i)(sum of q_i)^T

the sums of the 27 points in closed form. The text does not give kappa (`point_spread` = n + kappa, 13 here: the centre has no
weight), and its "N = 1000 particles" are none of such a filter. Nor does it say what becomes of the covariance when the
estimate is fed back: here it moves with the attitude as in `aqe-sukf`. With `covariance_kept` it stays as it is, which is right
for dQ but not for the heading that gravity cannot show: the filter then takes it for known while it levels, and diverges.

Source: the LS-SVM large misalignment paper, section 4, with the filter of its reference 14.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import maximum
from insenv.core.tables import Row, Table
from insenv.estimators import aqe
from insenv.estimators.parts.applicability import printed, together
from insenv.estimators.parts.quaternion_error import (
    Nonlinear,
    Spread,
    U,
    Y,
    sensitivity,
)

POINT_SPREAD = 13.0
PARAMETERS = Table((
    Row("point_spread", "n + kappa of the unscented transform, n = 13", "1", start=POINT_SPREAD, lower=1.0, upper=1e3),
    Row("covariance_kept", "1: feedback leaves the covariance as it is", lower=0, upper=1, flag=True),
))  # fmt: skip


def transform(p: Any) -> Spread:
    """The unscented transform of the nonlinear part, of second order in dQ."""

    def spread(q_hat: Any, P: Any, velocity: Any, distance: Any) -> Nonlinear:
        G = ca.vertcat(sensitivity(q_hat, velocity), sensitivity(q_hat, distance))
        L, _ = aqe.cholesky(P)
        total, squares, C = ca.SX.zeros(6), ca.SX(6, 6), attitude.to_dcm(q_hat)
        for i in range(4):
            second = Y(L[:, i]).T @ U(L[:, i])
            part = ca.vertcat(second @ velocity, second @ distance)
            total, squares, C = total + part, squares + part @ part.T, C + second
        return Nonlinear(G, -total, p.point_spread * squares - total @ total.T, C)

    return spread


_ONE = ca.SX([1, 0, 0, 0])
ESTIMATOR = aqe.estimator(
    "aqe-sukf-printed",
    "large misalignment: simplified unscented Kalman filter with the points and weights of its paper",
    aqe.Form(
        spread=transform,
        fix_variance=aqe.receiver_variance,
        turn=lambda p, q: _ONE + (1 - p.covariance_kept) * (q - _ONE),
        since_fix=lambda age: maximum(age, 0.0),
        parameters=PARAMETERS,
    ),
    together(printed("from a large misalignment its stated sigma can be too small", "aqe-sukf"), aqe.BOTH),
)
