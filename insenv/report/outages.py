"""Times without fixes, from the count of the fixes that a filter has used."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.errors import Result

Array = NDArray[np.float64]

LONGER = 3.5
"""Intervals between fixes after which a gap is an outage."""


def outages(time: Array, count: Array) -> tuple[tuple[float, float], ...]:
    """Begin and end of each time without fixes (s), the end of the run included.

    time (n,) s: of the records. count (n,): fixes so far.
    """
    fixes = time[1:][np.diff(count) > 0]
    if len(fixes) < 3:
        return ()
    longest = LONGER * float(np.median(np.diff(fixes)))
    ends = np.append(fixes[1:], time[-1])
    return tuple((float(a), float(b)) for a, b in zip(fixes, ends, strict=True) if b - a > longest)


def has_fixes(result: Result) -> bool:
    """Whether an estimator reports the health of fixes of GNSS, and had some: there are filters that have other aids alone."""
    return result.health is not None and result.health.fixes > 0


def without_fixes(results: Iterable[Result]) -> tuple[tuple[float, float], ...]:
    """Times without fixes (s), by the estimator that has used the most."""
    counts = [(r.time, r.outputs["fix_count"]) for r in results if has_fixes(r)]
    return outages(*max(counts, key=lambda one: float(one[1][-1]))) if counts else ()
