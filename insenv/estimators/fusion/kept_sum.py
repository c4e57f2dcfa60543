"""A correction of the attitude leaves the sum that a vector instrument shows as it is.

A magnetometer shows the sum of the field of the place, turned into the body, and of the hard iron of the vehicle.  While the
vehicle does not turn, that is all that it shows: a heading that is psi off and an iron that makes up for it cannot be told
apart.  A filter whose equations are derived anew at each estimate tells them apart all the same: each correction of the
attitude turns the direction along which they make up for each other, and what was measured across the old direction counts
along the new one.

The covariance is therefore carried over with the error of the sum in the place of that of the iron, b.  R being the derivative
of what is shown by all errors e,

    sum = b + R e   (R without the part by b, which is 1)

and with the derivatives R before a correction and R' after it, in the errors after it,

    b <- b + (R - R') e,   P <- T P T^T,   T = 1 but for the rows of b, which have R - R' beside it.

The iron is corrected so that the sum is what the correction of first order says: on the arc along which field and iron make up
for each other the estimate stays.  Where the vehicle itself turns, R changes with no correction: that shows the iron.

Source: Hao, Tian and He (2025), "A transformation-based consistent estimation framework", arXiv:2502.05008, the second form of
its filter, in which corrections of state and covariance keep what the measurements cannot show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.measurement import derived, turned_columns
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, turn_of


def kept(
    aid: Aid,
    states: Sequence[ErrorState],
    places: Mapping[str, slice],
    p: Any,
    x: Any,
    u: Any,
    correction: Any,
    rows: Any,
    psi: Any = None,
) -> tuple[Any, Any]:
    """The error `aid.added` after a correction that keeps the sum, and R - R' (m x n, sparse).

    x: the state before the correction.  correction (n): the differences that were taken out.  rows: those of the state after
    it.  psi: the turn of x to where the equations of the correction were derived (3, rad, w), of a measurement of the aid
    itself; None: 0.

    Position and velocity stay those of x: the field that they change is nothing, and a covariance that came from them would
    have them computed in single precision where it is (`insenv.core.precision`).
    """
    n, turn = correction.numel(), correction[TILT]
    now = Values(**{**vars(u), **({aid.age: 0.0} if aid.age else {})})  # what it would show at the end of the sample
    estimated = Values(**{**vars(x), **{state.name: rows[state.name] for state in states}})
    before, R = derived(aid, states, places, n, p, x, now, psi)
    after, R_after = derived(aid, states, places, n, p, estimated, now, turn)
    in_place = ca.SX(correction)
    in_place[POSITION], in_place[VELOCITY] = ca.SX.zeros(3), ca.SX.zeros(3)
    left = before + R @ in_place - (after + R_after[:, TILT] @ turn)
    change = turned_columns(R - R_after, turn_of(turn).T)  # of the errors after the correction
    change[:, places[aid.added]] = 0
    return rows[aid.added] + left, ca.sparsify(change)


def covariance_kept(stored: Any, added: slice, change: Any) -> Any:
    """Covariance triangle with the error of the sum kept; change: R - R' (m x n)."""
    n = change.shape[1]
    T = ca.SX.eye(n)
    T[added, :] = T[added, :] + change
    T = ca.sparsify(T)
    return symmetric.triangle(T @ symmetric.full(stored, n) @ T.T)
