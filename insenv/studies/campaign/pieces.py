"""Run a batch in pieces of about half a second, between which a caller looks at what has happened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from insenv.core.batch import Batch

PIECE_S = 0.5
"""Approximate time between two looks, s."""
FIRST_PIECE = 2000
"""Inertial samples, all rows together, before the first look: milliseconds to a tenth of a second."""


@dataclass
class Begun:
    """What of a batch is done: samples of a row, and the outputs (rows, records, outputs.size) of the records so far."""

    samples: int
    found: list[NDArray[np.float64]]


def in_pieces(
    batch: Batch, records: int, record_samples: int, look: Callable[[Begun], None], begun: Begun | None = None
) -> NDArray[np.float64]:
    """Return the outputs (rows, records, outputs.size), one record every `record_samples` samples.

    look: called before each piece with what is done; it may raise.  begun: what is done already by a batch whose states are
    those after it.
    """
    so_far = Begun(0, []) if begun is None else begun
    found, piece = so_far.found, max(1, FIRST_PIECE // batch.rows)
    for record in range(so_far.samples // record_samples, records):
        left = (record + 1) * record_samples - so_far.samples
        while left:
            look(so_far)
            now = min(piece, left)
            left -= now
            clock = perf_counter()
            shown = batch.run(now, every=0 if left else now)
            so_far.samples += now
            # pieces grow and shrink towards PIECE_S; the results do not depend on them
            piece = max(1, min(int(now * PIECE_S / max(perf_counter() - clock, 1e-6)), 4 * piece))
        found.append(shown)
    return np.concatenate(found, axis=1)
