"""An estimator whose noise parameters are multiplied by factors that can change while it runs.

The factors are the state row `noise_scale`, 1 at the start, to be set from outside between samples.  They act on the
steps only, not on the initial covariance: the factor of a bias's standard deviation scales its driving noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from insenv.base.errors import InputError
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table

SCALE = "noise_scale"


@lru_cache(maxsize=32)
def scaled_model(estimator: Model, names: tuple[str, ...]) -> Model:
    """`estimator` with the state row `noise_scale` (k,); the same object for the same arguments.

    Every step uses the parameter or input row ``names[i]`` multiplied by element i.  Raises `InputError` for a name
    that is neither.
    """
    missing = [name for name in names if name not in estimator.parameters and name not in estimator.inputs]
    if missing:
        raise InputError(f"estimator {estimator.id!r} has no parameter or input {', '.join(map(repr, missing))} to scale")
    meaning = f"Factors on {', '.join(names)}"
    return replace(
        estimator,
        id=f"{estimator.id}-scaled",
        state=estimator.state + Table((Row(SCALE, meaning, "1", (len(names),), start=1.0),)),
        steps={name: Step(_scaled(step, names), step.when, step.uniforms) for name, step in estimator.steps.items()},
    )


def _scaled(step: Step, names: tuple[str, ...]) -> Callable[..., Any]:
    def function(p: Values, x: Values, u: Values, *r: Any) -> Any:
        p, u = SimpleNamespace(**vars(p)), SimpleNamespace(**vars(u))
        for i, name in enumerate(names):
            owner = p if hasattr(p, name) else u
            setattr(owner, name, getattr(owner, name) * getattr(x, SCALE)[i])
        return step.function(p, x, u, *r)

    return function
