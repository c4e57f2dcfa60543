"""What a filter counts of the measurements of an instrument: how many there were, how many were refused, and sums of their NIS.

`insenv.evaluation.health` judges the instrument by these rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca

from insenv.core.elementary import select


def counted(x: Any, names: Iterable[str], groups: Iterable[slice], present: Any, accept: Any, ratio: Any) -> dict[str, Any]:
    """The rows that count, after a measurement of m components.

    names: of the rows, in the order of `insenv.estimators.parts.rows.FIX_HEALTH`.  groups: components that are summed apart.
    present, accept (m each): 1 for a component that is there, and for one that was used.  ratio (m): innovations over their
    standard deviations, 0 for a component that is not there.
    """
    square, refused = ratio * ratio, present - accept

    def sums(values: Any) -> Any:
        return ca.vertcat(*[ca.sum1(values[group]) for group in groups])

    added = (
        1,
        select(ca.sum1(refused) > 0, 1.0, 0.0),
        sums(accept * square),
        sums(accept),
        sums(refused * square),
        sums(refused),
    )
    return {name: getattr(x, name) + more for name, more in zip(names, added, strict=True)}
