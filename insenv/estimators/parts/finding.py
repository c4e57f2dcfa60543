"""What a run shows at its end: an output that is far from where it belongs, and the sentence about that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

RATIO = "{ratio}"


@dataclass(frozen=True, eq=False)
class Finding:
    """A sentence that holds where an output's last value is at least `limit` of its scales from a value.

    row: of the outputs.  about, scale: one number for each element of the row, or one for all, in its unit; an element of
    infinite scale does not count.  sentence: `RATIO` in it stands for the largest distance over its scale.

    Data instead of a function, so that whoever has the outputs alone (a live page) can tell it.
    """

    row: str
    sentence: str
    scale: ArrayLike
    about: ArrayLike = 0.0
    limit: float = 1.0

    def ratio(self, outputs: Mapping[str, NDArray[np.float64]]) -> float:
        """The largest distance over its scale of outputs (by row name, time along the first axis) at their end."""
        return float(np.max(np.abs(np.ravel(outputs[self.row][-1]) - self.about) / self.scale))
