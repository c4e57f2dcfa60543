"""Cascades of linear-phase FIR low-passes with decimation: their design, frozen coefficients, exact delay and response.

Each sub-filter is of odd length and symmetric, so that its delay is half its length exactly, at every frequency.  `lowpass`
designs the shortest one that keeps pass-band, stop-band and ripples, by the exchange of Parks and McClellan
(`scipy.signal.remez`).  A model does not call it: its coefficients are the constants of `CASCADE`, rounded to 1e-12, so that an
estimate is the same to the bit whatever SciPy is installed; a test designs them anew and compares.

Source: the swaying-base paper, section 1: two decimations, three sub-filters, pass-band ripple 0.01, disturbances above
1/15 Hz.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.estimators.parts.fir_coefficients import FIRST, SECOND, THIRD

Array = NDArray[np.float64]

BLOCK_S = 0.1
"""Interval of the cascade's input, s: means of specific force over blocks of samples."""
PASS_HZ = 0.002
"""Edge of the pass-band: gravity's cone in the inertial frame turns at 1.16e-5 Hz."""
STOP_HZ = 1.0 / 15.0
"""Edge of the stop-band: disturbances lie above."""
PASS_RIPPLE = 0.01
STOP_DB = 100.0
"""Of sway of 0.5 m/s^2 not more than 5e-6 m/s^2 is left: below 0.01 deg of heading."""


@dataclass(frozen=True)
class Cascade:
    """Sub-filters (coefficients, newest sample first) and the decimations between them.

    Sub-filter i works on every `decimation[0] * .. * decimation[i - 1]`-th block.
    """

    filters: tuple[tuple[float, ...], ...]
    decimation: tuple[int, ...]

    @property
    def strides(self) -> tuple[int, ...]:
        """Blocks between two inputs of each sub-filter."""
        return tuple(int(np.prod(self.decimation[:i])) for i in range(len(self.filters)))

    @property
    def span(self) -> int:
        """Number of blocks that one output depends on."""
        return 1 + sum((len(h) - 1) * s for h, s in zip(self.filters, self.strides, strict=True))

    @property
    def delay(self) -> float:
        """Delay in blocks, exact, of an output relative to the middle of the last block."""
        return (self.span - 1) / 2

    def impulse_response(self) -> Array:
        """The equivalent single filter at the rate of the blocks, (span,)."""
        total = np.ones(1)
        for h, stride in zip(self.filters, self.strides, strict=True):
            spread = np.zeros((len(h) - 1) * stride + 1)
            spread[::stride] = h
            total = np.convolve(total, spread)
        return total


def lowpass(rate: float, pass_edge: float, stop_edge: float, pass_ripple: float, stop_db: float) -> Array:
    """The shortest symmetric low-pass of odd length that keeps its specification, of gain 1 at frequency 0.

    rate, pass_edge, stop_edge in Hz; pass_ripple: largest deviation of the gain from 1; stop_db: attenuation, dB.
    """
    from scipy.signal import freqz, remez

    stop_ripple = 10 ** (-stop_db / 20)
    for taps in range(5, 400, 2):
        bands, weight = [0, pass_edge, stop_edge, rate / 2], [1 / pass_ripple, 1 / stop_ripple]
        h = remez(taps, bands, [1, 0], weight=weight, fs=rate, maxiter=200)
        h = (h + h[::-1]) / (2 * h.sum())
        passed = np.abs(freqz(h, worN=np.linspace(0, pass_edge, 200), fs=rate)[1])
        stopped = np.abs(freqz(h, worN=np.linspace(stop_edge, rate / 2, 4000), fs=rate)[1])
        if np.abs(passed - 1).max() <= pass_ripple and stopped.max() <= stop_ripple:
            return np.asarray(h)
    raise ValueError("no filter of fewer than 400 taps keeps the specification")


def design(block: float = BLOCK_S, decimation: tuple[int, ...] = (5, 4)) -> Cascade:
    """The cascade of the specification above: what a decimation folds onto the final pass-band and transition is stopped
    before it.
    """
    rates = 1 / block / np.concatenate([[1], np.cumprod(decimation)])
    # before a decimation all that would fold below STOP_HZ is stopped; the last sub-filter stops the rest
    edges = [*(later - STOP_HZ for later in rates[1:]), STOP_HZ]
    filters = [lowpass(rate, PASS_HZ, edge, PASS_RIPPLE, STOP_DB) for rate, edge in zip(rates, edges, strict=True)]
    return Cascade(tuple(tuple(h.round(12).tolist()) for h in filters), decimation)


def _whole(half: tuple[float, ...]) -> tuple[float, ...]:
    return half + half[-2::-1]


CASCADE = Cascade((_whole(FIRST), _whole(SECOND), _whole(THIRD)), (5, 4))
"""The cascade in use."""


def filtered(taps: tuple[float, ...], buffer: Any) -> Any:
    """Output (3x1) of a symmetric filter on its last inputs (rows of `buffer`, newest first): one product for each pair."""
    last = len(taps) - 1
    total = taps[last // 2] * buffer[last // 2, :]
    for k in range(last // 2):
        total = total + taps[k] * (buffer[k, :] + buffer[last - k, :])
    return total.T
