"""Run a batch in pieces of about half a second, between which a caller looks at what has happened."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from insenv.core.batch import Batch

PIECE_S = 0.5
"""Approximate time between two looks, s."""
FIRST_PIECE = 2000
"""Inertial samples, all rows together, before the first look: milliseconds to a tenth of a second."""


def in_pieces(batch: Batch, records: int, record_samples: int, look: Callable[[int], None]) -> NDArray[np.float64]:
    """Return the outputs (rows, records, outputs.size), one record every `record_samples` samples.

    look: called before each piece with the number of samples of a row that are done; it may raise.
    """
    found, piece, done = [], max(1, FIRST_PIECE // batch.rows), 0
    for _ in range(records):
        left = record_samples
        while left:
            look(done)
            now = min(piece, left)
            left -= now
            begun = perf_counter()
            shown = batch.run(now, every=0 if left else now)
            done += now
            # pieces grow and shrink towards PIECE_S; the results do not depend on them
            piece = max(1, min(int(now * PIECE_S / max(perf_counter() - begun, 1e-6)), 4 * piece))
        found.append(shown)
    return np.concatenate(found, axis=1)
