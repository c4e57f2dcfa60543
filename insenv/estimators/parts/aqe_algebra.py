"""The algebra of the additive quaternion error, equations (4), (5), (8) and (9) of the LS-SVM large misalignment paper.

Hamilton quaternions, scalar first; n and b are any right-handed frames, q takes b components to n components.

    [p] q = p (x) q,   <w> q = q (x) w,   U(q) u = q (x) (0, u),   Y(q) u = (0, u) (x) q,   Y^T U = C, Y^T q = U^T q = 0
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.attitude import skew


def left(q: Any) -> Any:
    """[q] (4x4): [q] p = q (x) p."""
    return ca.vertcat(ca.horzcat(q[0], -q[1:].T), ca.horzcat(q[1:], q[0] * ca.SX.eye(3) + skew(q[1:])))


def right(q: Any) -> Any:
    """<q> (4x4): <q> p = p (x) q."""
    return ca.vertcat(ca.horzcat(q[0], -q[1:].T), ca.horzcat(q[1:], q[0] * ca.SX.eye(3) - skew(q[1:])))


def U(q: Any) -> Any:
    """U(q) (4x3): U u = q (x) (0, u), (4)."""
    return left(q)[:, 1:]


def Y(q: Any) -> Any:
    """Y(q) (4x3): Y u = (0, u) (x) q, (4)."""
    return right(q)[:, 1:]


def delta_C(dQ: Any, q_hat: Any) -> Any:
    """C_hat - C (3x3) from dQ = Q_hat - Q, both of unit length, (9)."""
    return 2 * Y(dQ).T @ U(q_hat) - Y(dQ).T @ U(dQ)


def sensitivity(q_hat: Any, vector: Any) -> Any:
    """Derivative (3x4) of dC v with respect to dQ at 0: 2 Y^T(dQ) U(Q_hat) v as a matrix times dQ."""
    w = U(q_hat) @ vector
    return 2 * ca.horzcat(w[1:], -w[0] * ca.SX.eye(3) - skew(w[1:]))


@dataclass(frozen=True)
class Nonlinear:
    """The nonlinear part of a time update, [C(Q_hat) - C(Q)] times the integrals of the specific force.

    G (6x4): its regression on dQ (first the velocity's part, then the position's).  mean (6): its mean.
    extra (6x6): covariance of what the regression leaves.  C (3x3): mean attitude matrix.
    """

    G: Any
    mean: Any
    extra: Any
    C: Any


Spread = Callable[[Any, Any, Any, Any], Nonlinear]
"""From Q_hat at the interval's start, P of dQ (4x4) and the integrals (3; 3) to the nonlinear part."""
