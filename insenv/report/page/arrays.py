"""Arrays of a page: single-precision numbers as text, each kept once."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BYTES = 1_500_000
"""Bytes of a page for its arrays."""
FEWEST = 100
"""Records that a page keeps, however many arrays it has."""


def kept_records(records: int, arrays: int, budget: int = BYTES) -> NDArray[np.intp]:
    """Indices of the records that a page keeps: evenly spaced, the last among them; `arrays` arrays of them fit in `budget`."""
    most = max(FEWEST, int(budget / (16 / 3 * max(arrays, 1))))
    stride = -(-records // most) if records else 1
    return np.arange(records - 1, -1, -stride)[::-1]


class Pool:
    """The arrays of a page; panels refer to them by number."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}
        self._texts: list[str] = []

    def add(self, values: Any) -> int:
        """The number of an array (n,): single precision, little endian; the same array again has the same number."""
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        if data not in self._places:
            self._places[data] = len(self._texts)
            self._texts.append(base64.b64encode(data).decode("ascii"))
        return self._places[data]

    def as_json(self) -> list[str]:
        """The arrays in base64, by number."""
        return self._texts
