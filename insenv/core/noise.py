"""Counter-based noise: uniforms as a pure function of (seed, step, stream), by Philox 4x32-10.

Source: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011).  There is no
generator state to carry, split or restore: any number can be computed at any time, in any order, on any thread.

- key: the seed's low and high 32 bits;
- counter: the step's low and high 32 bits, the stream, the block of four numbers within the step;
- a word w becomes the uniform (w + 1/2) 2^-32, exactly representable and never 0 or 1.

The stream is the number of the step in its model, `START_STREAM` for the start.  The C driver (core/c/driver.h)
computes the same integers; everything after the uniform (normals, scaling) is arithmetic in the model's own symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

START_STREAM = 0xFFFFFFFF

_ROUNDS = 10
_MULTIPLIERS = 0xD2511F53, 0xCD9E8D57
_WEYL = 0x9E3779B9, 0xBB67AE85
_LOW = 0xFFFFFFFF


def philox(key: tuple[Any, Any], counter: tuple[Any, Any, Any, Any]) -> tuple[Any, Any, Any, Any]:
    """The four 32-bit words of Philox 4x32-10 for a key of two and a counter of four words.

    Whole numbers of Python, or arrays of uint64 that broadcast; so are the results.
    """
    (k0, k1), (c0, c1, c2, c3) = key, counter
    for _ in range(_ROUNDS):
        p0, p1 = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
        c0, c1, c2, c3 = (p1 >> 32) ^ c1 ^ k0, p1 & _LOW, (p0 >> 32) ^ c3 ^ k1, p0 & _LOW
        k0, k1 = (k0 + _WEYL[0]) & _LOW, (k1 + _WEYL[1]) & _LOW
    return c0, c1, c2, c3


def uniforms(seed: ArrayLike, step: ArrayLike, stream: int, count: int) -> NDArray[np.float64]:
    """`count` uniforms in (0, 1) for each seed and step number, which broadcast: shape ``(..., count)``."""
    seeds, steps = np.asarray(seed), np.asarray(step)
    blocks, shape = -(-count // 4), np.broadcast_shapes(seeds.shape, steps.shape)
    words: Any
    if seeds.size == steps.size == 1:  # numbers are quicker than arrays of one
        one, other = int(seeds.item()), int(steps.item())
        words = [_words(one, other, stream, block) for block in range(blocks)]
    else:
        several, others = (number.astype(np.uint64)[..., None] for number in (seeds, steps))
        all_words = _words(several, others, np.uint64(stream), np.arange(blocks, dtype=np.uint64))
        words = np.stack(np.broadcast_arrays(*all_words), axis=-1)
    numbers = (np.asarray(words, dtype=np.float64) + 0.5) * 2.0**-32
    return numbers.reshape(*shape, 4 * blocks)[..., :count]


def _words(seed: Any, step: Any, stream: Any, block: Any) -> tuple[Any, Any, Any, Any]:
    return philox((seed & _LOW, seed >> 32), (step & _LOW, step >> 32, stream, block))


# The first numbers of NumPy's default generators of many seeds at once.
#
# Making ``np.random.default_rng(seed)`` takes far longer than drawing from it.  Here the seed sequence, which hashes a seed
# into the start of a generator, is computed for all seeds together.  The numbers are those of NumPy, to the bit.
#
# Sources: O'Neill, "Developing a seed_seq alternative", 2015 (the hash); O'Neill, "PCG: a family of simple fast
# space-efficient statistically good algorithms for random number generation", HMC-CS-2014-0905 (PCG XSL RR 128/64); NumPy
# enhancement proposal 19 fixes both for all versions of NumPy.

Words = NDArray[np.uint32]
Longs = NDArray[np.uint64]

FEW_SEEDS = 8
"""Up to as many seeds, NumPy's own generators take less time."""

_MULTIPLIER = 47026247687942121848144207491837523525
_POOL, _WORDS = 4, 8  # of the hash; of the start of a generator
_HALF_WORD, _SEEDING_LOW = np.uint64(32), np.uint64(0xFFFFFFFF)


def _powers(start: int, factor: int, count: int) -> Words:
    """start factor^k mod 2^32 for k = 0 ... count - 1, as a column."""
    return np.array([start * pow(factor, k, 1 << 32) % (1 << 32) for k in range(count)], dtype=np.uint32)[:, None]


_IN = _powers(0x43B0D7E5, 0x931E8875, _POOL * _POOL + 1)
_OUT = _powers(0x8B51F9DD, 0x58F38DED, _WORDS + 1)
_MIX = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_HALF = np.uint32(16)


def first_uniforms(seeds: Sequence[int], count: int) -> NDArray[np.float64]:
    """The first `count` numbers of ``np.random.default_rng(seed).random()`` for seeds below 2^64, (seeds, count)."""
    if len(seeds) <= FEW_SEEDS:
        return np.array([np.random.default_rng(seed).random(count) for seed in seeds]).reshape(-1, count)
    high, low = _states(*_starts(np.array(seeds, dtype=np.uint64)), count)
    folded, turn = high ^ low, high >> np.uint64(58)
    turned = folded >> turn | folded << (np.uint64(64) - turn & np.uint64(63))
    return (turned >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _states(high: Longs, low: Longs, count: int) -> tuple[Longs, Longs]:
    """The first `count` states of generators, high and low 64 bits (seeds, count), from their starts (2, seeds, 1).

    The state after k steps s <- M s + c is M^k s + (M^(k-1) + ... + 1) c mod 2^128; the start s + c goes one step ahead.
    """
    of_high, of_low = _ahead(count)
    a, b, c, d = low >> _HALF_WORD, low & _SEEDING_LOW, of_low >> _HALF_WORD, of_low & _SEEDING_LOW
    ad, bc, bd = a * d, b * c, b * d
    middle = (ad & _SEEDING_LOW) + (bc & _SEEDING_LOW) + (bd >> _HALF_WORD)
    upper = a * c + (ad >> _HALF_WORD) + (bc >> _HALF_WORD) + (middle >> _HALF_WORD) + high * of_low + low * of_high
    lower = low * of_low
    total = lower[0] + lower[1]
    return upper[0] + upper[1] + (total < lower[0]), total


@lru_cache(maxsize=8)
def _ahead(count: int) -> tuple[Longs, Longs]:
    """The factors of s and of c in `_states`, high and low 64 bits, (2, 1, count) each."""
    powers = [pow(_MULTIPLIER, k, 1 << 128) for k in range(count + 2)]
    factors = [powers[2:], [sum(powers[: k + 1]) for k in range(2, count + 2)]]
    parts = [[[number >> shift & (1 << 64) - 1 for number in row] for row in factors] for shift in (64, 0)]
    high, low = np.array(parts, dtype=np.uint64).reshape(2, 2, 1, count)
    return high, low


def _starts(seeds: NDArray[np.uint64]) -> tuple[Longs, Longs]:
    """Start s and increment c of each seed's generator, high and low 64 bits, (2, seeds, 1) each."""
    pool = np.zeros((_POOL, len(seeds)), dtype=np.uint32)
    pool[0], pool[1] = seeds & _SEEDING_LOW, seeds >> _HALF_WORD
    pool = _hashed(pool, _IN[: _POOL + 1])
    for k in range(_POOL):
        others, first = [j for j in range(_POOL) if j != k], _POOL + (_POOL - 1) * k
        mixed = _MIX[0] * pool[others] - _MIX[1] * _hashed(pool[k], _IN[first : first + _POOL])
        pool[others] = mixed ^ (mixed >> _HALF)
    words = _hashed(np.concatenate([pool, pool]), _OUT)
    start, step = (words[1::2].astype(np.uint64) << _HALF_WORD | words[0::2]).reshape(2, 2, -1, 1)
    one, top = np.uint64(1), np.uint64(63)  # the increment is the odd number of which the words are all but the lowest bit
    return np.stack([start[0], step[0] << one | step[1] >> top]), np.stack([start[1], step[1] << one | one])


def _hashed(words: Words, constants: Words) -> Words:
    """Each row of words hashed with its constant and the next one."""
    mixed = (words ^ constants[:-1]) * constants[1:]
    return mixed ^ (mixed >> _HALF)
