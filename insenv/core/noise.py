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

_ROUNDS = 10
_MULTIPLIERS = np.array([0xD2511F53, 0xCD9E8D57], dtype=np.uint64)
_WEYL = np.arange(_ROUNDS, dtype=np.uint64)[:, None] * np.array([0x9E3779B9, 0xBB67AE85], dtype=np.uint64)
_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)


def philox(key: tuple[ArrayLike, ArrayLike], counter: tuple[ArrayLike, ...]) -> list[NDArray[np.uint64]]:
    """The four 32-bit words (in uint64) of Philox 4x32-10 for a key of two and a counter of four words, broadcast."""
    a, b, c, d, *keys = np.broadcast_arrays(*(np.asarray(word, dtype=np.uint64) for word in (*counter, *key)))
    alone = [1] * a.ndim
    multipliers, even, odd = _MULTIPLIERS.reshape(2, *alone), np.stack([a, c]), np.stack([b, d])
    for added in (np.stack(keys) + _WEYL.reshape(_ROUNDS, 2, *alone)) & _LOW:
        products = (multipliers * even)[::-1]
        even, odd = (products >> _SHIFT) ^ odd ^ added, products & _LOW
    return [even[0], odd[0], even[1], odd[1]]


def uniforms(seed: ArrayLike, step: ArrayLike, stream: int, count: int) -> NDArray[np.float64]:
    """`count` uniforms in (0, 1) for each seed and step number, which broadcast: shape ``(..., count)``."""
    seed, step = (np.asarray(number).astype(np.uint64)[..., None] for number in (seed, step))
    block = np.arange(-(-count // 4), dtype=np.uint64)
    key = (seed & _LOW, seed >> _SHIFT)
    words = philox(key, (step & _LOW, step >> _SHIFT, np.uint64(stream), block))
    numbers = (np.stack(words, axis=-1).astype(np.float64) + 0.5) * 2.0**-32
    return numbers.reshape(*numbers.shape[:-2], -1)[..., :count]
