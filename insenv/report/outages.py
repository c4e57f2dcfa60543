"""Times without fixes, from the count of the fixes that a filter has used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
