"""`wander-sins`: free-inertial navigation in the wander-azimuth frame, from a given start.

Source: the airborne-navigation paper, equations (3)-(11), in exact form (`insenv.estimators.parts.strapdown`).  Nothing bounds
the
vertical channel: errors of height grow by a factor of e every 9.5 minutes.
"""

from __future__ import annotations

from typing import Any

from insenv.core.model import Model, Step
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.increments import SAMPLE_INPUTS


def start(p: Any) -> dict[str, Any]:
    """The start as given."""
    return strapdown.start_state(p)


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    moved = strapdown.move(x, u.delta_angle, u.delta_velocity, u.dt)
    return strapdown.moved_rows(moved, x, u.delta_angle, u.delta_velocity)


def output(p: Any, x: Any) -> dict[str, Any]:
    """Navigation in n."""
    return strapdown.navigation_outputs(x)


MODEL = Model(
    id="wander-sins",
    title="free-inertial navigation in the wander-azimuth frame",
    parameters=strapdown.START,
    state=strapdown.STATE,
    inputs=SAMPLE_INPUTS,
    outputs=strapdown.OUTPUTS,
    steps={"sample": Step(sample)},
    output=output,
    start=start,
)

ESTIMATOR = Estimator(MODEL, kind="navigation")
