"""The cascade of low-passes of `inertial-fir` as one filter."""

import numpy as np

from insenv.estimators.inertial_fir import FILTERS, STRIDES


def impulse_response():
    """Of the equivalent single filter at the rate of the blocks, (span,)."""
    total = np.ones(1)
    for h, stride in zip(FILTERS, STRIDES, strict=True):
        spread = np.zeros((len(h) - 1) * stride + 1)
        spread[::stride] = h
        total = np.convolve(total, spread)
    return total
