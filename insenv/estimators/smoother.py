"""`smoother`: fixed-interval smoothing of a `loosely-coupled` run; the forward and the backward pass as two models.

Forward (`MODEL`): the filter of `loosely-coupled`, step by step, which also outputs what the backward pass needs: each
interval that the covariance was propagated over, and each scalar measurement with its gain. On its own it gives the
filter's estimates.

Backward (`BACKWARD`): Bryson and Frazier's adjoint filter. It carries the vector s (15) and the symmetric matrix L
(15x15) of what the later measurements say about the error state,

    smoothed error state = P s,   its covariance = P - P L P     (P of the filter at that instant, after correction)

from s = 0, L = 0 at the end. To go back from an instant k, after its measurements, to k - 1, the model runs once for
each scalar measurement, the last one first (once, if there is none); the last of these runs also goes over the
transition:

    scalar measurement of sensitivity H, gain K, innovation e of variance S:
        s <- (I - K H)^T s + H^T e / S,   L <- (I - K H)^T L (I - K H) + H^T H / S
    transition to the instant:
        s <- Phi^T s,   L <- Phi^T L Phi

No covariance is inverted, and process noise does not appear (it is in P). The filter feeds its estimate back at each
measurement, so its state jumps by what it has just learnt. s and L do not: they refer to innovations only, which are
the same with and without feedback, and P s is the error of the state as corrected at that instant.

Sources: the airborne-navigation paper smooths by filters forward and backward; the form without an inverse is Bryson
and Frazier's (1963) as modified for scalar measurements by Bierman (1973), "Fixed interval smoothing with discrete
measurements", Int. J. Control 18, 65-75. `insenv.runs.smoothed` runs both passes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import loosely_coupled as filter15
from insenv.estimators.parts import rows, standing
from insenv.estimators.parts.error_model import Interval, N, transition
from insenv.estimators.parts.kalman import weight_and_gain

INTERVAL = Table((
    Row("last_stretch", "Length of the interval that the covariance was last propagated over", "s"),
    Row("last_velocity_w", "Integral of the specific force over it", "m/s", (3,), "w"),
    Row("last_C_wb", "Integral of the attitude matrix over it", "s", (3, 3), "w"),
    Row("last_omega_ie_w", "Earth rate at its end", "rad/s", (3,), "w"),
    Row("last_omega_ew_w", "Transport rate at its end", "rad/s", (3,), "w"),
))  # fmt: skip
"""The arguments of the error model's transition."""


def _scalars(prefix: str, count: int, what: str) -> Table:
    return Table((
        Row(f"{prefix}_H", f"{what}: sensitivity to the error state", "SI", (count, N)),
        Row(f"{prefix}_gain", f"{what}: gain, 0 where it was not used", "SI", (count, N)),
        Row(f"{prefix}_weight", f"{what}: inverse variance of the innovation, 0 where it was not used", "SI", (count,)),
        Row(f"{prefix}_left", f"{what}: innovation minus what the ones before it explained", "SI", (count,)),
    ))  # fmt: skip


EVENTS = Table((
    Row("covariance_due", "1 when the covariance was propagated to the end of this sample"),
    Row("fix_used", "1 when a fix came with this sample"),
    Row("standing_now", "1 when the vehicle was known or detected to be at rest"),
))  # fmt: skip
FIX = _scalars("fix", 6, "Components of the last fix, in the order used")
REST = _scalars("rest", 3, "Components of the last zero velocity, in the order used")
NOMINAL = rows.chosen(filter15.STATE, "q_wb", "velocity_w", "q_ew", "height", "gyro_bias", "accel_bias", "covariance")
"""The filter's state, which the smoothed error state is taken out of, and its covariance."""


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample; an interval ends at a sample that is to be smoothed."""
    changed = filter15.sample(p, x, u)
    due = ca.logic_or(changed["covariance_due"], u.smoothed)
    return {
        **changed,
        "covariance_due": select(due, 1.0, 0.0),
        "fix_used": u.gnss_valid,
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance and record the arguments of the transition."""
    return {
        **filter15.covariance(p, x, u),
        "last_stretch": x.stretch,
        "last_velocity_w": x.stretch_velocity_w,
        "last_C_wb": x.stretch_C_wb,
        "last_omega_ie_w": x.omega_ie_w,
        "last_omega_ew_w": x.omega_ew_w,
    }


def gnss(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Process one fix and record its scalar measurements."""
    update, reported = filter15.gnss_update(p, x, u)
    return {**filter15.corrected(x, update.correction), "covariance": update.stored, **reported, **_recorded("fix", update)}


def zero_velocity(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Process a zero velocity and record its scalar measurements."""
    update = filter15.standing_update(p, x)
    return {**filter15.corrected(x, update.correction), "covariance": update.stored, **_recorded("rest", update)}


def _recorded(prefix: str, update: filter15.Update) -> dict[str, Any]:
    pairs = [weight_and_gain(s.stored, s.H, s.variance, s.accept) for s in update.scalars]
    return {
        f"{prefix}_H": ca.vertcat(*[s.H for s in update.scalars]),
        f"{prefix}_gain": ca.vertcat(*[gain.T for _, gain in pairs]),
        f"{prefix}_weight": ca.vertcat(*[weight for weight, _ in pairs]),
        f"{prefix}_left": ca.vertcat(*[s.left for s in update.scalars]),
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """The filter's outputs, and what the backward pass needs."""
    names = {row.name for row in MODEL.outputs} - {row.name for row in rows.AIDED_OUTPUTS}
    return {**filter15.output(p, x), **{name: getattr(x, name) for name in names}}


RECORDED = EVENTS + INTERVAL + FIX + REST

MODEL = Model(
    id="smoother",
    title="loosely-coupled smoothed over the whole run, forward and backward",
    parameters=filter15.PARAMETERS,
    state=filter15.STATE + Table(tuple(row for row in RECORDED if row.name not in filter15.STATE)),
    inputs=rows.AIDED_INPUTS
    + Table((Row("smoothed", "1 when the smoothed state is wanted at this sample's end", lower=0, upper=1, flag=True),)),
    outputs=rows.AIDED_OUTPUTS + RECORDED + Table(tuple(row for row in NOMINAL if row.name not in rows.AIDED_OUTPUTS)),
    steps={
        "sample": Step(sample),
        "still": Step(standing.found, when="still_due"),
        "covariance": Step(covariance, when="covariance_due"),
        "gnss": Step(gnss, when="gnss_valid"),
        "zero_velocity": Step(zero_velocity, when="standing_now"),
    },
    output=output,
    start=filter15.start,
)

ESTIMATOR = replace(filter15.ESTIMATOR, model=MODEL, smooths=filter15.MODEL.id)


def back_over_scalar(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Go back over a scalar measurement; a weight of 0 with a gain of 0 changes nothing."""
    H = u.H.T
    closed = ca.SX.eye(N) - u.gain @ H  # before the products with L: after a precise fix little of L is left
    L = closed.T @ (symmetric.full(x.information, N) @ closed) + H.T @ H * u.weight
    return {
        "adjoint": closed.T @ x.adjoint + H.T * (u.weight * u.left),
        "information": symmetric.triangle(L),
    }


def back_over_interval(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Go back over an interval by the elementary matrices of `kalman.propagate`, transposed, the last one first."""
    interval = Interval(u.last_stretch, u.last_velocity_w, u.last_C_wb, u.last_omega_ie_w, u.last_omega_ew_w)
    A = transition(interval, geodesy.NOMINAL_GRAVITY, p.gyro_correlation_time, p.accel_correlation_time)
    s = ca.vertsplit(x.adjoint)
    L = [[x.information[symmetric.place(i, j)] for j in range(N)] for i in range(N)]
    for i in reversed(range(N)):
        # x_i <- (1 + A_ii) (x_i + sum A_ij x_j); transposed, the component i is added to the components j
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


BACKWARD_STATE = Table((
    Row("adjoint", "Adjoint s of the error state, from the later measurements", "1/SI", (N,)),
    Row("information", "Their information L on the error state, upper triangle by columns", "1/SI^2",
        (symmetric.triangle_size(N),)),
))  # fmt: skip

BACKWARD_INPUTS = Table((
    Row("scalar_used", "1 to go back over a scalar measurement", lower=0, upper=1),
    Row("H", "Its sensitivity to the error state", "SI", (N,)),
    Row("gain", "Its gain, 0 where it was not used", "SI", (N,)),
    Row("weight", "Inverse variance of its innovation, 0 where it was not used", "SI"),
    Row("left", "Its innovation minus what the ones before it explained", "SI"),
    Row("carried", "1 to go back over an interval after that", lower=0, upper=1),
)) + INTERVAL  # fmt: skip

BACKWARD = Model(
    id="smoother-backward",
    title="backward pass of the smoother",
    parameters=rows.chosen(filter15.PARAMETERS, "gyro_correlation_time", "accel_correlation_time"),
    state=BACKWARD_STATE,
    inputs=BACKWARD_INPUTS,
    outputs=BACKWARD_STATE,
    # in the reverse order of the forward pass
    steps={"scalar": Step(back_over_scalar, when="scalar_used"), "carry": Step(back_over_interval, when="carried")},
    output=lambda p, x: {"adjoint": x.adjoint, "information": x.information},
)
