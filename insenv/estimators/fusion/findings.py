"""What the estimated errors of a run tell: an error many times as large as it was said to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.core.model import Values
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.parts.finding import Finding

SURPRISING = 5.0
"""Standard deviations of the start from which an estimate is called surprising.

The estimate of an error that was drawn with the stated sigma stays below it: among 40 errors it exceeds 5 by
chance in 2 runs of 100 000.
"""


def surprising(states: Sequence[ErrorState], parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Of each state: its estimate at the end is beyond `SURPRISING` of its standard deviations at the start.

    parameters: rows by name, SI.  Of a Gauss-Markov error the stationary standard deviation counts, about 0; of a constant one
    that of the start, about the start.
    """
    p, found = Values(**parameters), []
    for state in states:
        sigma = _numbers(parameters[state.sigma] if state.time else state.start_sigma(p), state.size)
        begun = np.zeros(state.size) if state.time or state.started is None else _numbers(state.started(p), state.size)
        sentence = (
            f"the estimate of {state.name} is {{ratio}} times the standard deviation told of it ({state.sigma}): the "
            "instrument, its description or that sigma is wrong"
        )
        found.append(Finding(state.name, sentence, np.where(sigma > 0.0, sigma, np.inf), begun, SURPRISING))
    return tuple(found)


def _numbers(value: Any, size: int) -> NDArray[np.float64]:
    """A number or a CasADi matrix as (size) numbers."""
    import casadi as ca

    return np.broadcast_to(np.ravel(np.array(ca.evalf(ca.SX(value)))), (size,))
