"""Splines of degree 5 and their fit: against SciPy, against functions and noise of known size."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from insenv.vehicles.track import BASIS, DEGREE, Spline, smoothed

TIME = np.linspace(0.0, 100.0, 1001)


def test_basis_against_scipy():
    points, time = np.random.default_rng(1).standard_normal((12, 2)), np.linspace(3.0, 6.49, 200)
    spline, other = Spline(points, 0.5, 3.0), BSpline(np.arange(-DEGREE, 13.0) * 0.5 + 3.0, points, DEGREE)
    assert np.allclose(BASIS.sum(axis=1), [1, 0, 0, 0, 0, 0], atol=1e-15)
    for order in range(4):
        assert np.allclose(spline.at(time, order), other(time, order), rtol=1e-11, atol=1e-11 * 10**order)


def test_noise_is_smoothed_away():
    wave, generator = np.sin(0.3 * TIME), np.random.default_rng(2)
    noisy, other = (wave + 0.05 * generator.standard_normal(1001) for _ in range(2))
    shown = smoothed(TIME, noisy[:, None], 0.5).at(TIME)[:, 0]
    assert np.std(shown - noisy) == pytest.approx(0.05, rel=0.1)
    assert np.std(shown - wave) < 0.015  # of 0.05; at 21 s a period, 20 points and more share a wiggle
    assert np.std(smoothed(TIME, other[:, None], 0.5, sigma=0.05).at(TIME)[:, 0] - wave) < 0.02


@pytest.mark.parametrize("knots", [50, 200])
def test_a_gap_of_many_knots(knots):
    """There the penalty alone determines the spline: a parabola has no jerk."""
    time = np.r_[np.arange(300.0), np.arange(300.0 + knots, 600.0 + knots)]
    fine = np.linspace(0.0, time[-1], 5000)
    assert np.abs(smoothed(time, (time**2)[:, None], 1.0).at(fine)[:, 0] - fine**2).max() < 1e-7 * time[-1] ** 2


@pytest.mark.parametrize("seed", [29, 211, 265])
def test_weights_that_rounding_loses_are_left_out(seed):
    """Long gaps between single points: with the smallest weights the equations are not positive definite."""
    choice, p = [1e-3, 0.3, 1.0, 3.0, 50.0, 199.0], [0.1, 0.2, 0.5, 0.1, 0.05, 0.05]
    time = np.concatenate([[0.0], np.cumsum(np.random.default_rng(seed).choice(choice, size=20, p=p))])
    spline = smoothed(time, (1e-3 * time)[:, None], 1.0, sigma=0.0)
    assert np.abs(spline.at(time)[:, 0] - 1e-3 * time).max() < 1e-5 * time[-1]
