"""What a linearised filter omits of its covariance while its attitude is uncertain.

A vector that an error psi of the attitude turns changes by psi x the vector, and by a part of second order, which for a turn
about the vertical is 1 - cos psi of the vector.  The filter has the first; the variance of the second is added here.  So
position and velocity have honest sigmas while the attitude is sought (`insenv.estimators.fusion.unknown_start`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Step
from insenv.estimators.fusion.aid import NEVER, Aid
from insenv.estimators.parts.applicability import LINEAR_TILT
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY

MEASURED_OFTEN = 2.0
"""s: the omitted turn of the Earth rate and of the way counts from so long after a measured velocity on; before that it is
small.
"""
BY_RATE = 5 / 3
"""A constant rate of the level moves the place by T^3 / 6 in the time T, a random walk that ends with the same level by
T^3 / sqrt 60.
"""

Turned = Callable[[Any, Any, Any], tuple[tuple[slice, Any], ...]]
"""``(p, x, u)`` to vectors (3, b) that turn with the attitude, each with the part of the error in which it shows."""


@dataclass(frozen=True)
class Omitted:
    """The steps of a filter, with what they omit.

    aid: of the measurements by which the filter is started anew.  seeking, time, gained: names of state rows: whether the
    attitude is sought, the time since the start, and the integral (3, w) of the specific force since the last new start.
    """

    aid: Aid
    seeking: str
    time: str
    gained: str

    def sampling(self, step: Step) -> Step:
        """The step of a sample: gravity acts in a wrong direction while the level is sought, and the sigmas follow at once."""

        def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
            changed = dict(step.function(p, x, u))
            psi = _variances(x.covariance)
            tilted = ca.logic_and(getattr(x, self.seeking) > 0, maximum(psi[0], psi[1]) > LINEAR_TILT**2)
            return changed | {"covariance_due": select(tilted, 1.0, changed["covariance_due"])}

        return replace(step, function=function)

    def propagating(self, step: Step) -> Step:
        """The step that propagates the covariance.

        The attitude turns the specific force, the Earth rate and the way.  The omitted part stays for as long as the heading is
        uncertain, and adds up with the time, not with its root: of the velocity until the next one is measured, of the
        others while none is.
        """

        def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
            changed = dict(step.function(p, x, u))
            since = getattr(x, self.aid.row("since"))
            since = select(since < NEVER, since, getattr(x, self.time))
            unmeasured = maximum(since - MEASURED_OFTEN, 0.0)
            growth = 2 * unmeasured * x.since_propagation * moment(_variances(x.covariance)[2])
            rate, speed = (x.omega_ie_w + x.omega_ew_w)[:2], x.velocity_w[:2]
            for part, square in ((POSITION, ca.sumsqr(speed)), (TILT, BY_RATE * ca.sumsqr(rate))):
                _add(changed, part, growth * square * ca.vertcat(1, 1, 0))
            before, after = getattr(x, self.gained), getattr(x, self.gained) + x.since_propagation_velocity_w
            grown = variances(x.covariance, after) - variances(x.covariance, before)
            _add(changed, VELOCITY, getattr(x, self.seeking) * ca.vertcat(*[maximum(v, 0.0) for v in ca.vertsplit(grown)]))
            return {**changed, self.gained: after}

        return replace(step, function=function)

    def measuring(self, step: Step, turned: Turned) -> Step:
        """The step of `aid`."""

        def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
            changed = dict(step.function(p, x, u))
            for part, vector_b in turned(p, x, u):
                _add(changed, part, getattr(x, self.seeking) * variances(x.covariance, attitude.rotate(x.q_wb, vector_b)))
            return changed

        return replace(step, function=function)


def variances(P: Any, vector_w: Any) -> Any:
    """Variances (3, w) of the second-order part of a vector (3, w) that turns by psi: by the heading, then by the level.

    P: upper triangle of the covariance.
    """
    psi = _variances(P)
    return ca.vertcat(vector_w[:2] ** 2 * moment(psi[2]), 0) + moment(psi[0] + psi[1]) * ca.sumsqr(vector_w)


def _variances(P: Any) -> Any:
    """Variances (3) of psi."""
    return ca.vertcat(*[P[symmetric.place(axis, axis)] for axis in range(TILT.start, TILT.stop)])


def moment(variance: Any) -> Any:
    """The second moment of 1 - cos psi: of a normal psi, and at most that of one of which nothing is known."""
    return minimum(0.75 * variance * variance, 1.5)


def _add(changed: dict[str, Any], part: slice, added: Any) -> None:
    """Add variances (3) to a part of the covariance among changed rows."""
    for axis in range(3):
        changed["covariance"][symmetric.place(part.start + axis, part.start + axis)] += added[axis]
