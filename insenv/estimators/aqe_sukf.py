"""`aqe-sukf`: large-misalignment alignment by the additive quaternion error, simplified unscented Kalman filter.

The observation is linear, so only the time update uses sigma points (the simplification).  Of them only those matter that
differ in dQ: with the state's Cholesky factor begun at dQ, which has three dimensions on the tangent of the unit sphere,
that is 6 of the 27 points of the paper's 13 states, and the centre; along the others the model is linear.

Points at +-sqrt(3) of the factor's columns (n + kappa = 3, which matches a normal distribution's fourth moment).  The axes
are chosen such that the last is the turn about the specific force: it alone moves no velocity, so the regression keeps
exactly what is unobservable.  The covariance of what the regression leaves comes from second differences, as in Norgaard,
Poulsen and Ravn, "New developments in state estimation for nonlinear systems", Automatica 36 (2000): no negative weight, so
it stays positive.  To the points on the axes come three between them, for the products of two errors, of which points on
the axes see nothing: a tilt seen from an unknown heading.  Without these the filter becomes sure of its heading while it
levels.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import select
from insenv.estimators.parts.aqe_algebra import Nonlinear, U
from insenv.estimators.parts.quaternion_error import estimator

SPREAD = 3.0  # n + kappa
_ROOT = 1.7320508075688772


def cholesky(P: Any) -> tuple[Any, list[Any]]:
    """Lower factor (nxn) of a positive semidefinite matrix and the inverses of its diagonal; 0 for a vanishing pivot."""
    n = P.shape[0]
    L, inverse = ca.SX(n, n), []
    for j in range(n):
        pivot = P[j, j] - ca.sumsqr(L[j, :j]) if j else P[j, j]
        regular = pivot > 1e-12 * P[j, j]
        inverse.append(select(regular, 1 / ca.sqrt(select(regular, pivot, 1.0)), 0.0))
        for i in range(j, n):
            L[i, j] = (P[i, j] - (L[i, :j] @ L[j, :j].T if j else 0)) * inverse[j]
    return L, inverse


def basis(direction: Any) -> Any:
    """Orthonormal axes (3x3, columns), the last along `direction`; without branches.

    Duff et al., "Building an orthonormal basis, revisited", J. Computer Graphics Techniques 6 (2017).
    """
    direction = direction + ca.vertcat(0, 0, 1e-9)
    x, y, z = ca.vertsplit(direction / ca.sqrt(ca.sumsqr(direction)))
    sign = select(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return ca.horzcat(
        ca.vertcat(1 + sign * x * x * a, sign * b, -sign * x), ca.vertcat(b, sign + y * y * a, -y), ca.vertcat(x, y, z)
    )


def unscented(q_hat: Any, P: Any, velocity: Any, distance: Any) -> Nonlinear:
    """The nonlinear part by sigma points in dQ, each of which is brought to unit length."""
    axes = U(q_hat) @ basis(velocity)  # 4x3: what dQ the turns about the body's axes are, but for a factor
    L, inverse = cholesky(axes.T @ P @ axes)
    C_hat = attitude.to_dcm(q_hat)

    def error(dQ: Any) -> tuple[Any, Any]:
        C = attitude.to_dcm(attitude.normalize(q_hat - dQ))
        return ca.vertcat((C_hat - C) @ velocity, (C_hat - C) @ distance), C

    first, ahead, extra, mean, C_mean = [], [], ca.SX(6, 6), ca.SX.zeros(6), C_hat
    for i in range(3):
        point = _ROOT * axes @ L[:, i]
        (plus, C_plus), (minus, C_minus) = error(point), error(-point)
        ahead.append(plus)
        first.append((plus - minus) / (2 * _ROOT))
        second = plus + minus  # the centre's is 0
        mean = mean + second / (2 * SPREAD)
        C_mean = C_mean + (C_plus + C_minus - 2 * C_hat) / (2 * SPREAD)
        extra = extra + (SPREAD - 1) / (4 * SPREAD**2) * (second @ second.T)
    # products of two: a tilt seen from an unknown heading
    for i, j in ((0, 1), (0, 2), (1, 2)):
        both = error(_ROOT * axes @ (L[:, i] + L[:, j]))[0]
        product = (both - ahead[i] - ahead[j]) / SPREAD
        extra = extra + product @ product.T
    # regression G L = [first]: back substitution
    G: list[Any] = [None] * 3
    for j in reversed(range(3)):
        G[j] = (first[j] - sum((G[k] * L[k, j] for k in range(j + 1, 3)), ca.SX.zeros(6))) * inverse[j]
    return Nonlinear(ca.horzcat(*G) @ axes.T, mean, extra, C_mean)


ESTIMATOR = estimator(
    "aqe-sukf", "large misalignment: additive quaternion error, simplified unscented Kalman filter", unscented
)
