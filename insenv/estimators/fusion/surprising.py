"""What the estimated errors of a run tell: an error many times as large as it was said to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.remarks import Doubt, declared
from insenv.core.model import Values
from insenv.core.tables import Array
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.parts.finding import Finding

SURPRISING = 5.0
"""Standard deviations of the start from which an estimate is called surprising.

The estimate of an error that was drawn with the stated sigma stays below it: among 40 errors it exceeds 5 by
chance in 2 runs of 100 000.
"""


_SURPRISING = declared(
    "estimate-surprising",
    "the estimate of {state} is {ratio} times its stated standard deviation ({sigma}): the instrument, its description or "
    "that sigma is wrong",
    Doubt,
)


def surprising(states: Sequence[ErrorState], parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Of each state: its estimate at the end is beyond `SURPRISING` of its standard deviations at the start.

    parameters: rows by name, SI.  Of a Gauss-Markov error the stationary standard deviation counts, about 0; of a constant one
    that of the start, about the start.
    """
    p, findings_of = Values(**parameters), []
    for state in states:
        if state.rate_w is not None or state.process is not None:
            continue  # the square of an error of the heading is far from normal; a sway has a finding of its own
        sigma = _numbers(parameters[state.sigma] if state.time else state.start_sigma(p), state.size)
        begun = np.zeros(state.size) if state.time or state.started is None else _numbers(state.started(p), state.size)
        sentence = _SURPRISING.filled(state=state.name, sigma=state.sigma)
        findings_of.append(Finding(state.name, sentence, np.where(sigma > 0.0, sigma, np.inf), begun, SURPRISING))
    return tuple(findings_of)


def _numbers(value: Any, size: int) -> Array:
    """A number or a CasADi matrix as (size) numbers."""
    return np.broadcast_to(np.ravel(np.array(ca.evalf(ca.SX(value)))), (size,))
