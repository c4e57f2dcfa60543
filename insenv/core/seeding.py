"""The first numbers of NumPy's default generators of many seeds at once.

Making ``np.random.default_rng(seed)`` takes far longer than drawing from it.  Here the seed sequence, which hashes a seed
into the start of a generator, is computed for all seeds together.  The numbers are those of NumPy, to the bit.

Sources: O'Neill, "Developing a seed_seq alternative", 2015 (the hash); O'Neill, "PCG: a family of simple fast
space-efficient statistically good algorithms for random number generation", HMC-CS-2014-0905 (PCG XSL RR 128/64); NumPy
enhancement proposal 19 fixes both for all versions of NumPy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint32]

FEW = 8
"""Up to as many seeds, NumPy's own generators take less time."""

_MASK = (1 << 128) - 1
_MULTIPLIER = 47026247687942121848144207491837523525
_POOL, _WORDS = 4, 8  # of the hash; of the start of a generator


def _powers(start: int, factor: int, count: int) -> Words:
    """start factor^k mod 2^32 for k = 0 ... count - 1, as a column."""
    return np.array([start * pow(factor, k, 1 << 32) % (1 << 32) for k in range(count)], dtype=np.uint32)[:, None]


_IN = _powers(0x43B0D7E5, 0x931E8875, _POOL * _POOL + 1)
_OUT = _powers(0x8B51F9DD, 0x58F38DED, _WORDS + 1)
_MIX = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_HALF = np.uint32(16)


def first_uniforms(seeds: Sequence[int], count: int) -> NDArray[np.float64]:
    """The first `count` numbers of ``np.random.default_rng(seed).random()`` for seeds below 2^64, (seeds, count)."""
    if len(seeds) <= FEW:
        return np.array([np.random.default_rng(seed).random(count) for seed in seeds]).reshape(-1, count)
    numbers = []
    for state, step in _starts(np.array(seeds, dtype=np.uint64)):
        for _ in range(count):
            state = (state * _MULTIPLIER + step) & _MASK
            folded = (state ^ state >> 64) & 0xFFFFFFFFFFFFFFFF
            numbers.append((folded << 64 | folded) >> (state >> 122) + 11 & 0x1FFFFFFFFFFFFF)  # turned right, upper 53 bits
    return np.array(numbers).reshape(-1, count) * 2.0**-53


def _starts(seeds: NDArray[np.uint64]) -> Iterator[tuple[int, int]]:
    """State and increment of each seed's generator, 128 bits each."""
    pool = np.zeros((_POOL, len(seeds)), dtype=np.uint32)
    pool[0], pool[1] = seeds & np.uint64(0xFFFFFFFF), seeds >> np.uint64(32)
    pool = _hashed(pool, _IN[: _POOL + 1])
    for k in range(_POOL):
        others, first = [j for j in range(_POOL) if j != k], _POOL + (_POOL - 1) * k
        mixed = _MIX[0] * pool[others] - _MIX[1] * _hashed(pool[k], _IN[first : first + _POOL])
        pool[others] = mixed ^ (mixed >> _HALF)
    words = _hashed(np.concatenate([pool, pool]), _OUT)
    low, high = words[0::2].astype(np.uint64), words[1::2].astype(np.uint64)
    for row in (high << np.uint64(32) | low).T.tolist():
        state, step = row[0] << 64 | row[1], (row[2] << 65 | row[3] << 1 | 1) & _MASK
        yield ((state + step) * _MULTIPLIER + step) & _MASK, step


def _hashed(words: Words, constants: Words) -> Words:
    """Each row of words hashed with its constant and the next one."""
    found = (words ^ constants[:-1]) * constants[1:]
    return found ^ (found >> _HALF)
