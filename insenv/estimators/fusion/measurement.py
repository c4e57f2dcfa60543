"""One measurement of an aid: component by component, gated, counted, with feedback left to the caller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.elementary import maximum, select
from insenv.estimators.fusion.aid import Aid, Spread
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.navigation import Navigation, linear
from insenv.estimators.fusion.restart import counted as restarted
from insenv.estimators.fusion.restart import restart
from insenv.estimators.parts.error_model import TILT
from insenv.estimators.parts.kalman import Update, innovation_variance, measure
from insenv.estimators.parts.rows import COUNTED, counted


def update(
    aid: Aid, states: Sequence[ErrorState], places: Mapping[str, slice], n: int, p: Any, x: Any, u: Any
) -> tuple[Update, dict[str, Any]]:
    """One measurement of an aid and the state rows after it; p, x, u: parameters, state, inputs by name."""
    innovation, by_error = linear(lambda error: aid.residual(p, Navigation(x, u, states, places, error), u), n)
    H = -by_error
    variance = aid.variance(p, x, u, spread_of(x, states, places))
    age = aid.age(u) if aid.age is not None else 0.0
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
        **({} if begun is None else restarted(aid, x, begun, outside)),
    }
    return Update(tuple(scalars), correction, stored), reported


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
