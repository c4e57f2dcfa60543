"""What the outputs of a run show: an output that is far from where it belongs at the end, or when a sigma became small."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from insenv.base.remarks import Remark, coded
from insenv.core.elementary import maximum
from insenv.core.tables import Array


@dataclass(frozen=True, eq=False)
class Finding:
    """A sentence that holds where an output's last value is at least `limit` of its scales from a value.

    row: of the outputs.  about, scale: one number for each element of the row, or one for all, in its unit; an element of
    infinite scale does not count.  sentence: ``{ratio}`` in it stands for the largest distance over its scale.

    Data instead of a function, so that whoever has the outputs alone (a live page) can tell it.
    """

    row: str
    sentence: str
    scale: ArrayLike
    about: ArrayLike = 0.0
    limit: float = 1.0

    def numbers(self, outputs: Mapping[str, Array]) -> dict[str, Any]:
        """What `departure` gives for outputs (by row name, time along the first axis) at their end."""
        values = np.ravel(outputs[self.row][-1])
        about, scale, _ = np.broadcast_arrays(self.about, self.scale, values)
        numbers = departure(values, about, scale, self.limit)
        return {"said": bool(numbers["said"]), "ratio": float(numbers["ratio"])}

    @property
    def remark(self) -> Remark:
        """The sentence with its code."""
        return coded([self.sentence], "finding")[0]


def departure(values: Iterable[Any], about: Iterable[Any], scale: Iterable[Any], limit: Any) -> dict[str, Any]:
    """The largest distance of values from `about` over its scale, and whether it is said: from `limit` on.

    Numbers or symbols: Python evaluates it after a run, a live page runs it compiled (`insenv.web.judging`).
    """
    ratio = reduce(maximum, [abs(value - middle) / one for value, middle, one in zip(values, about, scale, strict=True)], 0.0)
    return {"said": ratio >= limit, "ratio": ratio}


@dataclass(frozen=True, eq=False)
class Reached:
    """A sentence about the first time at which standard deviations are small enough.

    row: of the outputs, rad.  scale: the largest that is small enough, one number for each element of the row.  sentence:
    ``{time}`` in it stands for that time in s, ``{sigma}`` for the last element of the row then, in deg.
    """

    row: str
    sentence: str
    scale: ArrayLike

    def said(self, time: Array, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
        """The sentence about outputs (by row name) at times (k,) s since the start; none if they never are small enough."""
        sigma = outputs[self.row]
        small = (sigma <= np.asarray(self.scale)).all(axis=1)
        if not small.any():
            return ()
        first = int(np.argmax(small))
        (sentence,) = coded([self.sentence], "reached")
        return (sentence.filled(time=f"{time[first]:.1f}", sigma=f"{np.degrees(sigma[first, -1]):.2g}"),)
