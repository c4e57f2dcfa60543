"""`smoother`: fixed-interval smoothing of a `loosely-coupled` run; the forward and the backward pass as two models.

Forward (`MODEL`): the filter of `loosely-coupled`, step by step, which also outputs what the backward pass needs: each
interval that the covariance was propagated over, and each scalar measurement with its gain. On its own it gives the
filter's estimates.

Backward (`BACKWARD`): the adjoint filter of `insenv.estimators.parts.adjoint`.  To go back from an instant k, after its
measurements, to k - 1, the model runs once for each scalar measurement, the last one first (once, if there is none); the last
of these runs also goes over the transition.

Source: the airborne-navigation paper, which smooths by filters forward and backward.  `insenv.runs.smoothed` runs both passes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from insenv import geodesy
from insenv.core.elementary import select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import loosely_coupled as filter15
from insenv.estimators.parts import adjoint, rows, standing
from insenv.estimators.parts.error_model import VELOCITY, Interval, N, transition
from insenv.estimators.parts.invariant import covariance_after

INTERVAL = Table((
    Row("last_stretch", "Length of the interval that the covariance was last propagated over", "s"),
    Row("last_velocity_w", "Integral of the specific force over it", "m/s", (3,), "w"),
    Row("last_C_wb", "Integral of the attitude matrix over it", "s", (3, 3), "w"),
    Row("last_omega_ie_w", "Earth rate at its end", "rad/s", (3,), "w"),
    Row("last_omega_ew_w", "Transport rate at its end", "rad/s", (3,), "w"),
))  # fmt: skip
"""The arguments of the error model's transition."""


EVENTS = Table((
    Row("covariance_due", "1 when the covariance was propagated to the end of this sample"),
    Row("fix_used", "1 when a fix came with this sample"),
    Row("standing_now", "1 when the vehicle was known or detected to be at rest"),
))  # fmt: skip
FIX = adjoint.scalar_rows("fix", 6, N, "Components of the last fix, in the order used")
REST = adjoint.scalar_rows("rest", 3, N, "Components of the last zero velocity, in the order used")
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
    return {
        **filter15.corrected(x, update.correction),
        "covariance": covariance_after(update, N),
        **reported,
        **adjoint.recorded("fix", update),
    }


def zero_velocity(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Process a zero velocity and record its scalar measurements."""
    update = filter15.standing_update(p, x)
    return {
        **filter15.corrected(x, update.correction),
        "covariance": covariance_after(update, N),
        **adjoint.recorded("rest", update),
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


def _transition(p: Any, u: Any) -> Any:
    interval = Interval(u.last_stretch, u.last_velocity_w, u.last_C_wb, u.last_omega_ie_w, u.last_omega_ew_w)
    return transition(interval, geodesy.NOMINAL_GRAVITY, p.gyro_correlation_time, p.accel_correlation_time)


GROUPS = (
    adjoint.Group(EVENTS["fix_used"], FIX, lambda: tuple(range(N))),
    adjoint.Group(EVENTS["standing_now"], REST, lambda: tuple(range(VELOCITY.start, VELOCITY.stop))),
)
BACKWARD = adjoint.backward_model(
    "smoother-backward",
    N,
    rows.chosen(filter15.PARAMETERS, "gyro_correlation_time", "accel_correlation_time"),
    GROUPS,
    INTERVAL,
    _transition,
)
SMOOTHING = adjoint.Smoothing(
    forward=MODEL,
    backward=BACKWARD,
    due="covariance_due",
    groups=GROUPS,
    interval=INTERVAL,
    nominal=NOMINAL,
    n=N,
    corrected=filter15.corrected,
    estimates=("gyro_bias", "accel_bias"),
    reported=rows.FIX_HEALTH,
)
ESTIMATOR = replace(filter15.ESTIMATOR, model=MODEL, smooths=filter15.MODEL.id, smoothing=SMOOTHING)
