"""Wavelet de-noising of the signals that a machine learns.

Source: the LS-SVM large misalignment paper, section 4: five levels, high-frequency coefficients set to 0, those of lower
frequency that hold noise reduced by a soft threshold.  Read here: the details of the finest `DROPPED` levels are set to 0,
those of the others are reduced by Donoho's universal threshold, s sqrt(2 ln n), s from the median of the finest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WAVELET, LEVELS, DROPPED = "db4", 5, 3


def denoised(signal: Array) -> Array:
    """The signal (n, ...) along its first axis without what looks like noise; fewer levels where it is too short."""
    import pywt

    signal = np.asarray(signal, dtype=np.float64)
    levels = min(LEVELS, pywt.dwt_max_level(len(signal), pywt.Wavelet(WAVELET).dec_len))
    if levels < 1:
        return signal.copy()
    parts = pywt.wavedec(signal, WAVELET, mode="smooth", level=levels, axis=0)
    noise = np.median(np.abs(parts[-1]), axis=0) / 0.6745
    threshold = noise * np.sqrt(2 * np.log(len(signal)))
    for place in range(1, len(parts)):
        if place > levels - DROPPED:
            parts[place] = np.zeros_like(parts[place])
        else:
            parts[place] = np.sign(parts[place]) * np.maximum(np.abs(parts[place]) - threshold, 0.0)
    return pywt.waverec(parts, WAVELET, mode="smooth", axis=0)[: len(signal)]
