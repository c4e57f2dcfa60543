"""A filter that starts without an attitude: velocity integration finds it, and the filter starts from it.

A linearised filter that is told 180 deg of heading settles on a wrong one: the first change of velocity, and at once a velocity
in body axes, seem to show a heading near the one it assumes.  `insenv.estimators.velocity_integration` needs no start attitude
and states its accuracy.  So until level and heading are known to `LINEAR_TILT` and `FOUND`,

- no aid measures;
- each fix with a velocity starts the filter anew: its level, with the covariance, is that of the alignment once that is known
  to `LINEAR_TILT` or better than before, its heading where that is better than what is known; its position and velocity
  are unknown, and the fix is its first measurement.

The rows of the alignment have the names of `velocity-integration` behind `PREFIX`; after the start its steps do not run.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from math import radians
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators import velocity_integration as alignment
from insenv.estimators.contract import Knowledge
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.contract import Aid
from insenv.estimators.fusion.retraction import corrected
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.applicability import LINEAR_HEADING, LINEAR_TILT
from insenv.estimators.parts.error_model import ACCEL, GYRO, POSITION, TILT, VELOCITY
from insenv.estimators.parts.finding import Finding
from insenv.estimators.parts.rest_bias import bias_sigma

PREFIX = "alignment_"
FOUND = radians(7.0)
"""rad of heading: of an aircraft with centimetre fixes that starts with 10 deg the NEES was 16 of 9, with 7 deg it was 10."""
UNKNOWN_PLACE, UNKNOWN_VELOCITY = 1e4, 1e2
"""m, m/s: standard deviations before the first measurement."""
SHARED = ("antenna_lever_arm", "angle_random_walk", "velocity_random_walk", "start_gyro_bias", "start_gyro_bias_error")
"""Parameters that filter and alignment have in common."""

STATE = Table((
    Row("seeking", "1 until the attitude is known well enough to start from"),
    Row("fix_due", "1 at a fix with a velocity"),
))  # fmt: skip
"""Rows beside those of the alignment, behind `PREFIX` too."""
_SEEKING, _FIX = (PREFIX + row.name for row in STATE)


def wanted(known: Knowledge) -> bool:
    """Whether the start attitude is too uncertain for a linearised filter."""
    return bool(_uncertain(known))


def _uncertain(told: Any) -> Any:
    """The same of whatever has the fields or rows `heading_sigma` and `tilt_sigma`, numbers or symbols."""
    return ca.logic_or(told.heading_sigma > LINEAR_HEADING, told.tilt_sigma > LINEAR_TILT)


def prepared(known: Knowledge) -> dict[str, Any]:
    """Parameter rows of the alignment."""
    return {PREFIX + name: value for name, value in alignment.prepare(known).items() if name not in SHARED}


def finding() -> Finding:
    """What is said of a run that has not found its heading at its end."""
    return Finding(
        "attitude_sigma",
        "the heading is not found: until it is, each fix starts the filter anew, and no other aid is used; turns, changes of "
        "speed and waves show it",
        scale=(np.inf, np.inf, alignment.LARGEST_LINEAR),
    )


@lru_cache(maxsize=16)
def model_of(filter: Composition) -> Model:
    """The model of `filter`, which has the aid gnss, with the alignment before its aids; made once for each filter."""
    model = filter.model
    aids = {aid.id: aid.due_row for aid in filter.aids}
    gnss = next(aid for aid in filter.aids if aid.id == "gnss")
    own = Table(tuple(row for row in alignment.PARAMETERS if row.name not in SHARED))
    return replace(
        model,
        title=f"{model.title}; attitude at the start by {alignment.MODEL.id}",
        parameters=model.parameters + _prefixed(own),
        state=model.state + _prefixed(STATE + alignment.STATE),
        steps={
            **{name: _masked(step, aids.values()) for name, step in model.steps.items() if name not in aids},
            **{PREFIX + name: _aligning(name, step) for name, step in alignment.MODEL.steps.items()},
            f"{PREFIX}start": Step(_started(filter, gnss), when=_FIX),
            **{name: model.steps[name] for name in aids},
        },
        start=_start(filter),
    )


def _prefixed(table: Table) -> Table:
    return Table(tuple(replace(row, name=PREFIX + row.name) for row in table))


def _parameters(p: Any) -> Values:
    """The parameters as the alignment names them."""
    return Values(**{name: getattr(p, name if name in SHARED else PREFIX + name) for name in alignment.PARAMETERS.names})


def _state(x: Any) -> Values:
    """The state as the alignment names it."""
    return Values(**{name: getattr(x, PREFIX + name) for name in alignment.STATE.names})


def _start(filter: Composition) -> Callable[[Any], Mapping[str, Any]]:
    def start(p: Any) -> dict[str, Any]:
        aligning = {PREFIX + name: value for name, value in alignment.start(_parameters(p)).items()}
        return {**filter.start(p), **aligning, _SEEKING: select(_uncertain(p), 1.0, 0.0)}

    return start


def _masked(step: Step, due: Collection[str]) -> Step:
    """A step of the filter; no aid is due while the attitude is sought."""

    def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
        changed = dict(step.function(p, x, u))
        return changed | {name: select(getattr(x, _SEEKING), 0.0, changed[name]) for name in due if name in changed}

    return replace(step, function=function)


def _aligning(name: str, step: Step) -> Step:
    """A step of the alignment."""

    def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
        changed = {PREFIX + row: value for row, value in step.function(_parameters(p), _state(x), u).items()}
        return changed | ({_FIX: u.gnss_velocity_valid} if name == "sample" else {})

    when = {"sample": _SEEKING, "fix": _FIX}.get(name, f"{PREFIX}{step.when}")
    return Step(function, when=when)


def _started(filter: Composition, gnss: Aid) -> Callable[[Any, Any, Any], dict[str, Any]]:
    """The step that starts the filter anew, from the answer of the alignment where that is better than what is known."""

    def step(p: Any, x: Any, u: Any) -> dict[str, Any]:
        own, state = _parameters(p), _state(x)
        found = alignment.output(own, state)
        sigma, P = found["attitude_sigma"], symmetric.full(x.covariance, filter.n)
        known = ca.diag(P)[TILT]
        # the level that is known turns with gyro biases whose direction an unknown heading hides
        levelled = ca.logic_and(sigma[0] < LINEAR_TILT, sigma[1] < LINEAR_TILT)
        levelled = ca.logic_or(levelled, ca.sumsqr(sigma[:2]) < ca.sum1(known[:2]))
        headed = ca.logic_and(sigma[2] < alignment.UNKNOWN, sigma[2] ** 2 < known[2])
        taken = ca.vertcat(*[select(better, 1.0, 0.0) for better in (levelled, levelled, headed)])
        left = ca.sqrt(taken * sigma**2 + (1 - taken) * known)
        unknown = ca.logic_or(left[2] > FOUND, ca.logic_or(left[0] > LINEAR_TILT, left[1] > LINEAR_TILT))

        q_wb = attitude.multiply(attitude.conjugate(strapdown.wander_quaternion(x.q_ew)), found["q_nb"])
        apart = attitude.error_rotation_vector(q_wb, x.q_wb)
        q_wb = attitude.multiply(attitude.from_rotation_vector((taken - 1) * apart), q_wb)
        turn = ca.SX.zeros(filter.n)
        turn[TILT] = attitude.error_rotation_vector(q_wb, x.q_wb)
        return {
            **corrected(x, turn, filter.states, filter.places),
            "covariance": symmetric.triangle(_covariance(P, x, own, state, taken)),
            **_uncounted(gnss, p, x, u),
            gnss.due_row: 1.0,
            _FIX: 0.0,
            _SEEKING: select(unknown, 1.0, 0.0),
            f"{PREFIX}covariance_due": 0.0,
        }

    return step


def _uncounted(gnss: Aid, p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The sums of test ratios before the fix that the filter starts from: after it they are 0."""
    assert gnss.present is not None
    present = gnss.present(p, x, u)
    zero = {gnss.row(name): ca.SX.zeros(len(gnss.parts)) for name in ("nis_used", "nis_refused", "nis_refused_count")}
    return {**zero, gnss.row("nis_used_count"): -ca.vertcat(*[ca.sum1(present[part]) for part in gnss.parts])}


def _covariance(P: Any, x: Any, own: Values, state: Values, taken: Any) -> Any:
    """Covariance (n x n, w) after that.  P: before it.  taken (3): 1 for the components of psi that the alignment gives.

    Their covariance, that with the biases too, is the one that the alignment states; its rotation vector has the other sign
    than psi.  A bias that is smaller than the one that the alignment counts, because the filter has states for the rest, has
    the share of the covariance that its variance has.
    """
    C_wi = strapdown.C_nw(x.q_ew).T @ attitude.to_dcm(alignment.q_ni(state, state.q_i0i))
    turn = ca.SX(3, alignment.N)
    turn[:, alignment.KEPT] = turn[:, alignment.DRIFT] = C_wi
    shared = turn @ symmetric.full(state.covariance, alignment.N)
    stated = (shared @ turn.T + own.thrust_error**2 * ca.SX.eye(3)) * (taken @ taken.T)
    stated += ca.trace(stated) ** 2 * ca.diag(taken)  # products of two errors, which linearisation leaves out
    for part, size in ((POSITION, UNKNOWN_PLACE), (VELOCITY, UNKNOWN_VELOCITY)):
        P[part, :] = P[:, part] = 0
        P[part, part] = size**2 * ca.SX.eye(3)
    kept = 1 - taken
    before = P[TILT, :]
    P[TILT, :] = ca.repmat(kept, 1, P.shape[1]) * before
    by_bias = ca.SX(3, 3)
    for part, theirs, counted in ((GYRO, alignment.GYRO, bias_sigma(own)), (ACCEL, alignment.ACCEL, own.accel_bias_sigma)):
        variance = ca.diag(P[part, part])
        share = minimum(variance / maximum(counted, 1e-30) ** 2, 1.0)
        found = -(taken @ share.T) * shared[:, theirs]
        P[TILT, part] += found
        by_bias += found @ ca.diag(1 / maximum(variance, 1e-300)) @ before[:, part].T
    P[:, TILT] = P[TILT, :].T
    apart = by_bias * (taken @ kept.T)  # what both share through the biases
    P[TILT, TILT] = stated + before[:, TILT] * (kept @ kept.T) + apart + apart.T
    return P
