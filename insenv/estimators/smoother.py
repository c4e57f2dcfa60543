"""`smoother`: the run of `loosely-coupled`, smoothed over the whole interval by `insenv.runs.smoothed`.

The model here is its forward pass: the same filter, step by step, which also tells what the backward pass needs: every stretch
that the covariance was carried over, and every scalar measurement with its gain.  On its own it gives the filter's estimates.

Source: the airborne-navigation paper's fixed-interval smoothing, filters forward and backward; the form that needs no inverse
of a covariance is Bryson and Frazier's (1963) as modified for scalar measurements by Bierman (1973), "Fixed interval smoothing
with discrete measurements", Int. J. Control 18.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import loosely_coupled as filter15
from insenv.estimators.loosely_coupled_tables import INPUTS, OUTPUTS, PARAMETERS, STATE
from insenv.estimators.parts import standing
from insenv.estimators.parts.error_model import N, weight_and_gain

INTERVAL = Table(
    (
        Row("last_stretch", "Length of the stretch that the covariance was last carried over", "s"),
        Row("last_velocity_w", "Integral of the specific force over it", "m/s", (3,), "w"),
        Row("last_C_wb", "Integral of the attitude matrix over it", "s", (3, 3), "w"),
        Row("last_omega_ie_w", "Earth rate at its end", "rad/s", (3,), "w"),
        Row("last_omega_ew_w", "Transport rate at its end", "rad/s", (3,), "w"),
    )
)
"""What the error model's transition is made of."""


def _scalars(prefix: str, count: int, what: str) -> Table:
    return Table(
        (
            Row(f"{prefix}_H", f"{what}: sensitivity to the error state", "SI", (count, N)),
            Row(f"{prefix}_gain", f"{what}: gain, 0 where it was not used", "SI", (count, N)),
            Row(f"{prefix}_weight", f"{what}: inverse variance of the innovation, 0 where it was not used", "SI", (count,)),
            Row(f"{prefix}_left", f"{what}: innovation less what the ones before it explained", "SI", (count,)),
        )
    )


EVENTS = Table(
    (
        Row("covariance_due", "1 when the covariance was carried to this sample's end"),
        Row("fix_used", "1 when a fix came with this sample"),
        Row("standing_now", "1 when the vehicle was said or found to stand"),
    )
)
FIX = _scalars("fix", 6, "Components of the last fix, in the order used")
REST = _scalars("rest", 3, "Components of the last zero velocity, in the order used")
NOMINAL = Table(
    tuple(row for row in STATE if row.name in ("q_wb", "velocity_w", "q_ew", "height", "gyro_bias", "accel_bias", "covariance"))
)
"""The filter's state: what the smoothed error state is to be taken out of, and its covariance."""


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample; a stretch ends at a sample that is to be smoothed."""
    changed = filter15.sample(p, x, u)
    due = ca.logic_or(changed["covariance_due"], u.smoothed)
    return {
        **changed,
        "covariance_due": select(due, 1.0, 0.0),
        "fix_used": u.gnss_valid,
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The covariance over a stretch, which is told."""
    return {
        **filter15.covariance(p, x, u),
        "last_stretch": x.stretch,
        "last_velocity_w": x.stretch_velocity_w,
        "last_C_wb": x.stretch_C_wb,
        "last_omega_ie_w": x.omega_ie_w,
        "last_omega_ew_w": x.omega_ew_w,
    }


def gnss(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix, which is told."""
    update, told = filter15.gnss_update(p, x, u)
    return {**filter15.corrected(x, update.correction), "covariance": update.stored, **told, **_told("fix", update)}


def zero_velocity(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Zero velocity, which is told."""
    update = filter15.standing_update(p, x)
    return {**filter15.corrected(x, update.correction), "covariance": update.stored, **_told("rest", update)}


def _told(prefix: str, update: filter15.Update) -> dict[str, Any]:
    pairs = [weight_and_gain(s.stored, s.H, s.variance, s.accept) for s in update.scalars]
    return {
        f"{prefix}_H": ca.vertcat(*[s.H for s in update.scalars]),
        f"{prefix}_gain": ca.vertcat(*[gain.T for _, gain in pairs]),
        f"{prefix}_weight": ca.vertcat(*[weight for weight, _ in pairs]),
        f"{prefix}_left": ca.vertcat(*[s.left for s in update.scalars]),
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """The filter's outputs, and what the backward pass needs."""
    names = {row.name for row in MODEL.outputs} - {row.name for row in OUTPUTS}
    return {**filter15.output(p, x), **{name: getattr(x, name) for name in names}}


_RECORDED = EVENTS + INTERVAL + FIX + REST

MODEL = Model(
    id="smoother",
    title="loosely-coupled smoothed over the whole run, forward and backward",
    parameters=PARAMETERS,
    state=STATE + Table(tuple(row for row in _RECORDED if row.name not in STATE)),
    inputs=INPUTS + Table((Row("smoothed", "1 when the smoothed state is wanted at this sample's end", lower=0, upper=1),)),
    outputs=OUTPUTS + _RECORDED + Table(tuple(row for row in NOMINAL if row.name not in OUTPUTS)),
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
