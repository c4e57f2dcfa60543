"""One measurement of an aid: component by component, gated, counted, with feedback left to the caller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select, sin_cos
from insenv.estimators.fusion import arc
from insenv.estimators.fusion.aid import Aid, Spread
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.navigation import Navigation, corrected, linear
from insenv.estimators.fusion.restart import counted as restarted
from insenv.estimators.fusion.restart import restart
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, turn_of, turned, with_platform
from insenv.estimators.parts.kalman import Update, innovation_variance, measure
from insenv.estimators.parts.rows import COUNTED, counted


def update(
    aid: Aid, states: Sequence[ErrorState], places: Mapping[str, slice], n: int, p: Any, x: Any, u: Any
) -> tuple[Update, dict[str, Any]]:
    """One measurement of an aid and the state rows after it; p, x, u: parameters, state, inputs by name."""
    psi = getattr(x, aid.misalignment_row) if aid.iterated else None
    innovation, by_error = derived(aid, states, places, n, p, x, u, psi)
    H = -by_error
    variance = aid.variance(p, x, u, spread_of(x, states, places)) + _of_arc(x, H)
    age = getattr(u, aid.age) if aid.age else 0.0
    since = maximum(getattr(x, aid.row("since")) - age, 0.0)  # between the epochs of the two measurements
    inflated = variance if aid.correlated is None else variance + aid.correlated(p, x, since)
    present = aid.present(p, x, u) if aid.present is not None else ca.SX.ones(aid.size)
    gate = getattr(p, aid.gate) if aid.gate else 0.0

    stored, correction = x.covariance, ca.SX.zeros(n)
    refusals = getattr(x, aid.row("refusals"))
    # a filter that rejects one measurement after the other is itself wrong: the gate stays open until they agree again
    gated = select(refusals < aid.max_rejections, 1.0, 0.0)
    begun = restart(aid, x, innovation, variance, present, since, n) if aid.restarts else None
    if begun is not None:
        stored, gated = begun.stored, gated * (1 - begun.now)
    scalars, ratios, outside = [], [], ca.SX(0)
    for i in range(aid.size):
        left = innovation[i] - H[i, :] @ correction
        ratio = present[i] * left / ca.sqrt(innovation_variance(stored, H[i, :], variance[i]))
        beyond = select(ca.logic_and(gate > 0, ca.fabs(ratio) > gate), 1.0, 0.0)
        accept = present[i] * (1 - gated * beyond)
        stored, correction, scalar = measure(stored, correction, H[i, :], innovation[i], inflated[i], accept)
        scalars.append(scalar)
        ratios.append(ratio)
        outside = outside + beyond
    accepted, test_ratio = ca.vertcat(*[scalar.accept for scalar in scalars]), ca.vertcat(*ratios)
    reported = {
        aid.row("innovation"): innovation * present,
        aid.row("test_ratio"): test_ratio,
        **counted(x, [aid.row(name) for name in COUNTED], aid.parts, present, accepted, test_ratio),
        aid.row("refusals"): select(outside > 0, refusals + 1, 0),
        aid.row("since"): age,
        **({aid.misalignment_row: ca.SX.zeros(3)} if aid.iterated else {}),
        **({} if begun is None else restarted(aid, x, begun, outside)),
    }
    return Update(tuple(scalars), correction, stored), reported


def derived(
    aid: Aid, states: Sequence[ErrorState], places: Mapping[str, slice], n: int, p: Any, x: Any, u: Any, psi: Any = None
) -> tuple[Any, Any]:
    """Innovation and its derivative by the whole error, at the attitude that a turn by psi (3, rad, w; None: 0) leads to."""
    turn = None if psi is None else turn_of(psi)
    value, slope = linear(lambda error: aid.residual(p, Navigation(x, u, states, places, error, turn), u), n)
    if psi is None:
        return value, slope
    slope = turned_columns(slope, turn)  # from the errors there to those at x, which turn with the platform
    return value - slope[:, TILT] @ psi, slope


def turned_columns(slope: Any, turn: Any) -> Any:
    """A derivative (m x n) by errors that turn with the platform, by those before the turn C (3x3)."""
    columns = ca.SX(slope)
    for part, block in with_platform(turn):
        columns[:, part] = columns[:, part] @ block
    return ca.sparsify(columns)


def _of_arc(x: Any, H: Any) -> Any:
    """Variance (m) of what the arc of the velocity (`arc`) leaves out of measurements with sensitivity H."""
    by_velocity = H[:, VELOCITY]
    if not by_velocity.nnz():
        return ca.SX.zeros(H.shape[0])
    return ca.sum2(by_velocity * (by_velocity @ arc.moment(x.covariance)))


WIDE = float(np.radians(3.0))
"""rad: standard deviation of the attitude from which it is found by several passes, each with the equations of where the one
before found it.  At three of these sigmas a field is 1 % longer along its direction than a first order says, which the errors
of the instrument take up."""
PREDICTED = 10.0
"""Variance of a prediction over that of the measurement up to which no pass is needed: it shows nothing beyond first order."""
PASSES = 4
"""They find a heading that is 60 deg off with honest sigmas."""


def wide(x: Any, n: int) -> Any:
    """1 where the attitude is known worse than that."""
    P = symmetric.full(x.covariance, n)
    return select(ca.trace(P[TILT, TILT]) > WIDE**2, 1.0, 0.0)


FAR = float(np.radians(15.0))
"""rad: standard deviation of the heading from which the passes begin at the heading that fits best."""
HEADINGS = 24
"""All round, of which that is one."""


def far(x: Any) -> Any:
    """1 where the heading is known worse than that."""
    return select(x.covariance[symmetric.place(TILT.stop - 1, TILT.stop - 1)] > FAR**2, 1.0, 0.0)


def heading_shown(aid: Aid, states: Sequence[ErrorState], places: Mapping[str, slice], n: int, p: Any, x: Any, u: Any) -> Any:
    """The turn about the vertical (rad), of `HEADINGS` all round, with which the innovation is smallest."""
    angles = [float(angle) for angle in np.arange(HEADINGS) * (2 * np.pi / HEADINGS)]
    turns = [turn_of(ca.vertcat(0, 0, angle)) for angle in angles]
    sizes = [ca.sumsqr(aid.residual(p, Navigation(x, u, states, places, ca.SX.zeros(n), turn), u)) for turn in turns]
    best, smallest = angles[0], sizes[0]
    for angle, size in zip(angles[1:], sizes[1:], strict=True):
        best, smallest = select(size < smallest, angle, best), minimum(size, smallest)
    return best


def headed(x: Any, angle: Any, n: int, states: Sequence[ErrorState], places: Mapping[str, slice]) -> dict[str, Any]:
    """State rows with the heading turned by an angle (rad), and with it what was gained with the wrong one."""
    P, heading = symmetric.full(x.covariance, n), TILT.stop - 1
    about, error = ca.vertcat(0, 0, angle), ca.SX.zeros(n)
    error[TILT] = about
    for part in (POSITION, VELOCITY):  # the chord of the arc of a vector that turns by the angle
        error[part] = turn_of(about / 2) @ (P[part, heading] / P[heading, heading]) * (2 * sin_cos(angle / 2)[0])
    turns = [(part, turn_of(about)) for part in (POSITION, VELOCITY, TILT)]
    return {**corrected(x, error, states, places), "covariance": symmetric.triangle(turned(P, turns))}


def attitude_shown(aid: Aid, states: Sequence[ErrorState], places: Mapping[str, slice], n: int, p: Any, x: Any, u: Any) -> Any:
    """Misalignment (3, rad, w) that a measurement shows, of all components at once: a Kalman filter that is iterated.

    Jazwinski (1970), Stochastic Processes and Filtering Theory, section 8.3.
    """
    P, psi = symmetric.full(x.covariance, n), ca.SX.zeros(3)
    variance = ca.diag(aid.variance(p, x, u, spread_of(x, states, places)))
    _, by_error = derived(aid, states, places, n, p, x, u)
    unforeseen = select(ca.trace(by_error @ P @ by_error.T) > PREDICTED * ca.trace(variance), 1.0, 0.0)
    for _ in range(PASSES):
        innovation, by_error = derived(aid, states, places, n, p, x, u, psi)
        shared = P @ -by_error.T
        psi = shared[TILT, :] @ ca.solve(variance - by_error @ shared, innovation)
    return psi * unforeseen


def spread_of(x: Any, states: Sequence[ErrorState], places: Mapping[str, slice]) -> Spread:
    """Variances (k) of the errors of the state after the interval, by name."""
    sizes = {"attitude": 3, **{state.name: state.size for state in states}}
    parts = {"attitude": TILT, **places}

    def variances(name: str) -> Any:
        if name not in parts:
            return ca.SX(0)
        first = parts[name].start
        return ca.vertcat(*[x.covariance[symmetric.place(i, i)] for i in range(first, first + sizes[name])])

    return variances
