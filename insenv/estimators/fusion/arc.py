"""The arc of what was gained with a wrong attitude.

A velocity that was integrated with an attitude that is psi off is off by more than psi x the velocity: a car that leaves with
a heading 5 deg off gains 0.4 % less along its track than it believes.  To first order that is nothing, and a filter, whose
covariance is of first order, would be surer of that velocity than it can be.  The errors of velocity and attitude are
therefore those of a group (`insenv.estimators.parts.error_model.with_platform`),

    v^ - v = J(psi) dv,   J(psi) = 1 + [psi x] / 2 + ...,  within psi^2 / 24 the rotation by psi / 2

for the part of dv that comes with the attitude, K psi with K = P_v,psi P_psi^-1.  The rest, as of a velocity stated at the
start, does not turn.  A correction follows the arc (`along`); what the arc leaves out of a measurement of first order and of
the stated sigma is counted (`moment`).

Source: Barrau and Bonnabel (2017), "The invariant extended Kalman filter as a stable observer", IEEE Trans. Automatic Control
62, 1797-1812: the exponential of SE2(3).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY

LEAST = 1e-14
"""rad^2: variance of an attitude that counts as known (0.02 arcsec)."""
LONGEST = 1.0
"""rad: standard deviation of psi beyond which an arc is no longer than its radius."""


def along(error: Any, P: Any, share: Any = 1.0) -> Any:
    """The differences (n) of a state and the true one whose error in the sense of the covariance is `error` (n).

    P: upper triangle of the covariance (n x n).  share: 0 for a filter of small angles.  The position does not turn: each
    measurement of it begins it anew.
    """
    turned, psi = ca.SX(error), error[TILT]
    gained = _by_attitude(P, VELOCITY) @ psi
    half = attitude.from_rotation_vector(psi * (0.5 * share))
    turned[VELOCITY] = error[VELOCITY] + attitude.rotate(half, gained) - gained
    return turned


def along_the_way(error: Any, P: Any) -> Any:
    """As `along`, of a smoother, whose corrections are of the whole way: the position that comes with the heading turns too.

    What comes with a tilt does not: it is gained against gravity, the error of an accelerometer takes it back, and a fix
    after an outage measures it without an arc.
    """
    turned = along(error, P)
    heading = TILT.stop - 1
    half = ca.vertcat(0.0, 0.0, error[heading] / 2)
    with_heading = ca.vertcat(*[P[symmetric.place(i, heading)] for i in range(POSITION.start, POSITION.stop)])
    gained = with_heading * (error[heading] / (P[symmetric.place(heading, heading)] + LEAST))
    turned[POSITION] = error[POSITION] + attitude.rotate(attitude.from_rotation_vector(half), gained) - gained
    return turned


def back(error: Any, P: Any) -> Any:
    """The error in the sense of the covariance whose difference `along` gives, within psi^3: of velocities."""
    turned, psi = ca.SX(error), error[TILT]
    gained = _by_attitude(P, VELOCITY) @ psi
    turned[VELOCITY] = error[VELOCITY] + gained - attitude.rotate(attitude.from_rotation_vector(psi / 2), gained)
    return turned


def moment(P: Any) -> Any:
    """Second moment (3x3, m^2/s^2, w) of psi x K psi / 2, by which v^ - v is more than dv.

    P: upper triangle of the covariance.  psi is normal, so that with psi x K psi = sum psi_j psi_l c_jl the mean of four
    factors is the sum of three products of means of two (Isserlis 1918).  Of an attitude of which nothing is known no more than
    of one of `LONGEST`.
    """
    S, K = _block(P, TILT, TILT), _by_attitude(P, VELOCITY)
    # component i of psi x K psi is psi^T A psi, A symmetric: its second moments are tr(A S) tr(B S) + 2 tr(A S B S)
    forms = [_symmetric(-skew(axis) @ K) @ S for axis in ca.horzsplit(ca.SX.eye(3))]
    M = ca.SX(3, 3)
    for i in range(3):
        for j in range(i + 1):
            M[i, j] = M[j, i] = ca.trace(forms[i]) * ca.trace(forms[j]) + 2 * ca.trace(forms[i] @ forms[j])
    return M * (0.25 / maximum(1.0, ca.trace(S) / LONGEST**2))


def _symmetric(A: Any) -> Any:
    return (A + A.T) / 2


def _by_attitude(P: Any, part: slice) -> Any:
    """K (3x3): the part of an error that comes with psi is K psi."""
    return _block(P, part, TILT) @ ca.inv(_block(P, TILT, TILT) + LEAST * ca.SX.eye(3))


def _block(P: Any, rows: slice, columns: slice) -> Any:
    """A block (3x3) of a covariance, from its upper triangle."""
    places = [[symmetric.place(i, j) for j in range(columns.start, columns.stop)] for i in range(rows.start, rows.stop)]
    return ca.vertcat(*[P[row].T for row in places])
