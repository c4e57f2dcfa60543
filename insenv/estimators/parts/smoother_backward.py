"""The backward pass of the smoother: Bryson and Frazier's adjoint filter on what the forward pass told, as a `Model`.

It carries the vector s (15) and the symmetric matrix L (15x15) of what the measurements still to come say:

    smoothed error state = P s,   its covariance = P - P L P        (P of the filter there, about the filter's corrected state)

from s = 0, L = 0 at the end.  An instant k is taken back, from after its updates to after those of k - 1, by an advance for
each scalar measurement (one, if it has none), the last one first; the last advance goes over the transition too:

    a scalar measurement of sensitivity H, gain K, innovation e of variance S:
        s <- (I - K H)^T s + H^T e / S,   L <- (I - K H)^T L (I - K H) + H^T H / S
    the transition to the instant:
        s <- Phi^T s,   L <- Phi^T L Phi

No covariance is inverted, and process noise appears nowhere (it is in P).  The filter feeds its estimate back at every
measurement, so its state jumps by what it has just learnt; s and L do not: they refer to innovations only, which are the same
with feedback and without, and P s is the error of the state as corrected at that instant.

Source: Bierman (1973), "Fixed interval smoothing with discrete measurements", Int. J. Control 18, 65-75.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import smoother
from insenv.estimators.loosely_coupled_tables import PARAMETERS
from insenv.estimators.parts.error_model import Interval, N, transition
from insenv.geodesy import NOMINAL_GRAVITY


def scalar(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Back over a scalar measurement; a weight of 0 with a gain of 0 leaves everything as it is."""
    H = u.H.T
    closed = ca.SX.eye(N) - u.gain @ H  # first of all: where a fix tells nearly everything, little of L is left
    L = closed.T @ (symmetric.full(x.information, N) @ closed) + H.T @ H * u.weight
    return {
        "adjoint": closed.T @ x.adjoint + H.T * (u.weight * u.left),
        "information": symmetric.triangle(L),
    }


def carry(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Back over a stretch: with the very elementary matrices of `error_model.propagate`, transposed, the last one first."""
    interval = Interval(u.last_stretch, u.last_velocity_w, u.last_C_wb, u.last_omega_ie_w, u.last_omega_ew_w)
    A = transition(interval, NOMINAL_GRAVITY, p.gyro_correlation_time, p.accel_correlation_time)
    s = ca.vertsplit(x.adjoint)
    L = [[x.information[symmetric.place(i, j)] for j in range(N)] for i in range(N)]
    for i in reversed(range(N)):
        # x_i <- (1 + A_ii) (x_i + sum A_ij x_j): transposed, what belongs to i goes to the j as well
        if not A[i, i].is_zero():
            decay = 1 + A[i, i]
            s[i] = decay * s[i]
            square = decay * (decay * L[i][i])
            for k in range(N):
                L[i][k] = L[k][i] = decay * L[i][k]
            L[i][i] = square
        sources = [j for j in range(N) if j != i and not A[i, j].is_zero()]
        row = list(L[i])
        for j in sources:
            s[j] = s[j] + A[i, j] * s[i]
        for j in range(N):
            for k in range(j + 1):
                added: Any = 0
                if j in sources:
                    added = added + A[i, j] * row[k]
                if k in sources:
                    added = added + A[i, k] * (row[j] + (A[i, j] * row[i] if j in sources else 0))
                L[j][k] = L[k][j] = L[j][k] + added
    return {"adjoint": ca.vertcat(*s), "information": ca.vertcat(*[L[i][j] for j in range(N) for i in range(j + 1)])}


STATE = Table(
    (
        Row("adjoint", "What the measurements to come say of the error state: s", "1/SI", (N,)),
        Row("information", "How well they say it: L, upper triangle by columns", "1/SI^2", (symmetric.triangle_size(N),)),
    )
)

INPUTS = (
    Table(
        (
            Row("scalar_used", "1 to go back over a scalar measurement", lower=0, upper=1),
            Row("H", "Its sensitivity to the error state", "SI", (N,)),
            Row("gain", "Its gain, 0 where it was not used", "SI", (N,)),
            Row("weight", "Inverse variance of its innovation, 0 where it was not used", "SI"),
            Row("left", "Its innovation, less what the ones before it explained", "SI"),
            Row("carried", "1 to go back over a stretch then", lower=0, upper=1),
        )
    )
    + smoother.INTERVAL
)

MODEL = Model(
    id="smoother-backward",
    title="backward pass of the smoother",
    parameters=Table(tuple(row for row in PARAMETERS if row.name.endswith("_correlation_time"))),
    state=STATE,
    inputs=INPUTS,
    outputs=STATE,
    # in the reverse order of the forward pass
    steps={"scalar": Step(scalar, when="scalar_used"), "carry": Step(carry, when="carried")},
    output=lambda p, x: {"adjoint": x.adjoint, "information": x.information},
)
