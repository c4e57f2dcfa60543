"""A call of the functions for NumPy arrays: on one row, and on many."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insenv.attitude import numeric
from insenv.bench.figure import Figure, median_time
from insenv.core.numeric import vectorized

REPETITIONS = 9
CALLS = 2000  # on one row, in a repetition
ROWS = 10_000
_SELF = vectorized(lambda q, v: v, 4, 3)


def one() -> Figure:
    """A vector rotated by a quaternion, as agents of one's own do at each sample."""
    value, floor, peer = (1e6 * taken for taken in _times((), CALLS))
    return Figure("numeric.one", value, "us", floor, REPETITIONS, _note("one row"), ("SciPy's Rotation", peer))


def many() -> Figure:
    """The same of many rows: time of a row."""
    value, floor, peer = (1e9 * taken / ROWS for taken in _times((ROWS,), 1))
    return Figure("numeric.many", value, "ns", floor, REPETITIONS, _note(f"a row of {ROWS}"), ("SciPy's Rotation", peer))


def _note(rows: str) -> str:
    return f"attitude.numeric.rotate, {rows}; floor: a function that returns its argument"


def _times(leading: tuple[int, ...], calls: int) -> tuple[float, ...]:
    """Of a call of the function, of an empty one, and of the peer, s."""
    draw = np.random.default_rng(1)
    q, v = draw.normal(size=(*leading, 4)), draw.normal(size=(*leading, 3))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    last = np.roll(q, -1, axis=-1)  # SciPy has the scalar last
    return tuple(
        median_time(call, REPETITIONS, calls)
        for call in (lambda: numeric.rotate(q, v), lambda: _SELF(q, v), lambda: Rotation.from_quat(last).apply(v))
    )
