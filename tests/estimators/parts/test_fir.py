"""The cascade of low-passes: its coefficients are within the specification, and it has its delay."""

import numpy as np
import pytest
from cascade import impulse_response
from scipy.signal import freqz

from insenv.estimators import inertial_fir
from insenv.estimators.parts import fir
from insenv.estimators.parts.fir import CASCADE


def test_two_decimations_three_symmetric_subfilters_within_specification():
    rate, last = 1 / fir.BLOCK_S, len(CASCADE.filters) - 1
    assert [len(h) for h in CASCADE.filters] == [21, 19, 31]
    for i, h in enumerate(CASCADE.filters):
        assert h == h[::-1] and len(h) % 2 == 1
        assert sum(h) == pytest.approx(1, abs=1e-10)
        own = rate / CASCADE.strides[i]
        edge = fir.STOP_HZ if i == last else own / CASCADE.decimation[i] - fir.STOP_HZ
        passed = np.abs(freqz(h, worN=np.linspace(0, fir.PASS_HZ, 300), fs=own)[1])
        stopped = np.abs(freqz(h, worN=np.linspace(edge, own / 2, 9000), fs=own)[1])
        assert np.abs(passed - 1).max() <= fir.PASS_RIPPLE
        assert 20 * np.log10(stopped.max()) <= -fir.STOP_DB + 0.01


def test_the_cascade_attenuates_sway_and_delays_by_half_its_span():
    h = impulse_response()
    assert len(h) == CASCADE.span == 711
    f = np.linspace(fir.STOP_HZ, 5, 40_000)
    assert 20 * np.log10(np.abs(freqz(h, worN=f, fs=10)[1]).max()) <= -fir.STOP_DB + 0.01
    # group delay: the phase is linear to rounding
    f = np.linspace(1e-4, 0.02, 50)
    response = freqz(h, worN=f, fs=10)[1] * np.exp(2j * np.pi * f / 10 * CASCADE.delay)
    assert np.abs(response.imag).max() < 1e-12
    assert abs(inertial_fir.SPAN * fir.BLOCK_S - 180.0) < 1e-9
