"""The cascade of low-passes: the stored coefficients are those of their design, within the specification, with their delay."""

import numpy as np
import pytest
from cascade import impulse_response
from scipy.signal import freqz, remez

from insenv.estimators import inertial_fir
from insenv.estimators.parts import fir
from insenv.estimators.parts.fir import CASCADE


def lowpass(rate, pass_edge, stop_edge, pass_ripple, stop_db):
    """The shortest symmetric low-pass of odd length within the specification, with gain 1 at frequency 0.

    rate, pass_edge, stop_edge in Hz; pass_ripple: largest deviation of the gain from 1; stop_db: attenuation, dB.
    """
    stop_ripple = 10 ** (-stop_db / 20)
    for taps in range(5, 400, 2):
        bands, weight = [0, pass_edge, stop_edge, rate / 2], [1 / pass_ripple, 1 / stop_ripple]
        h = remez(taps, bands, [1, 0], weight=weight, fs=rate, maxiter=200)
        h = (h + h[::-1]) / (2 * h.sum())
        passed = np.abs(freqz(h, worN=np.linspace(0, pass_edge, 200), fs=rate)[1])
        stopped = np.abs(freqz(h, worN=np.linspace(stop_edge, rate / 2, 4000), fs=rate)[1])
        if np.abs(passed - 1).max() <= pass_ripple and stopped.max() <= stop_ripple:
            return h
    raise ValueError("no filter of fewer than 400 taps keeps the specification")


def design(decimation=(5, 4)):
    """The cascade of the specification: a sub-filter stops what its decimation would fold onto the pass-band."""
    rates = 1 / fir.BLOCK_S / np.concatenate([[1], np.cumprod(decimation)])
    # a sub-filter stops all that its decimation would fold below STOP_HZ; the last one stops the rest
    edges = [*(later - fir.STOP_HZ for later in rates[1:]), fir.STOP_HZ]
    filters = [lowpass(rate, fir.PASS_HZ, edge, fir.PASS_RIPPLE, fir.STOP_DB) for rate, edge in zip(rates, edges, strict=True)]
    return fir.Cascade(tuple(tuple(h.round(12).tolist()) for h in filters), decimation)


def test_the_stored_coefficients_are_those_of_the_design():
    designed = design()
    assert designed.decimation == CASCADE.decimation
    assert [len(h) for h in designed.filters] == [len(h) for h in CASCADE.filters] == [21, 19, 31]
    for found, frozen in zip(designed.filters, CASCADE.filters, strict=True):
        assert np.abs(np.array(found) - frozen).max() < 1e-10


def test_two_decimations_three_symmetric_subfilters_within_specification():
    rate, last = 1 / fir.BLOCK_S, len(CASCADE.filters) - 1
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
