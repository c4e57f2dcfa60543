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

import numpy as np
from numpy.typing import ArrayLike, NDArray

START_STREAM = 0xFFFFFFFF

_MULTIPLIER = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)


def philox(key: tuple[ArrayLike, ArrayLike], counter: tuple[ArrayLike, ...]) -> list[NDArray[np.uint64]]:
    """The four 32-bit words (in uint64) of Philox 4x32-10 for a key of two and a counter of four words, broadcast."""
    words = [np.asarray(w, dtype=np.uint64) for w in (*key, *counter)]
    key0, key1, a, b, c, d = np.broadcast_arrays(*words)
    for _ in range(10):
        product0, product1 = _MULTIPLIER[0] * a, _MULTIPLIER[1] * c
        a, b, c, d = (
            (product1 >> _SHIFT) ^ b ^ key0,
            product1 & _LOW,
            (product0 >> _SHIFT) ^ d ^ key1,
            product0 & _LOW,
        )
        key0, key1 = (key0 + _WEYL[0]) & _LOW, (key1 + _WEYL[1]) & _LOW
    return [a, b, c, d]


def uniforms(seed: float, step: ArrayLike, stream: int, count: int) -> NDArray[np.float64]:
    """`count` uniforms in (0, 1) for each step number: shape ``step.shape + (count,)``."""
    step = np.asarray(step).astype(np.uint64)[..., None]
    block = np.arange(-(-count // 4), dtype=np.uint64)
    key = (np.uint64(int(seed) & 0xFFFFFFFF), np.uint64(int(seed) >> 32))
    words = philox(key, (step & _LOW, step >> _SHIFT, np.uint64(stream), block))
    numbers = (np.stack(words, axis=-1).astype(np.float64) + 0.5) * 2.0**-32
    return numbers.reshape(*numbers.shape[:-2], -1)[..., :count]
