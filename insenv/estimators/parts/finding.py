"""What a run shows at its end: an output that is far from where it belongs, and the sentence about that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Finding:
    """A sentence that holds where an output's last value is at least `limit` of its scales from a value.

    row: of the outputs.  about, scale: one number for each element of the row, or one for all, in its unit; an element of
    infinite scale does not count.  sentence: "{ratio}" in it stands for the largest distance over its scale.

    Data instead of a function, so that whoever has the outputs alone (a live page) can tell it.
    """

    row: str
    sentence: str
    scale: ArrayLike
    about: ArrayLike = 0.0
    limit: float = 1.0

    def said(self, outputs: Mapping[str, NDArray[np.float64]]) -> str:
        """The sentence about outputs (by row name, time along the first axis); empty if it does not hold."""
        ratio = float(np.max(np.abs(np.ravel(outputs[self.row][-1]) - self.about) / self.scale))
        return self.sentence.replace("{ratio}", f"{ratio:.3g}") if ratio >= self.limit else ""
