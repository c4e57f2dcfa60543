"""Splines of degree 5 and their fit: against SciPy, against functions and noise of known size."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from insenv.vehicles.splines import BASIS, DEGREE, Spline, point_count, smoothed


def test_basis_against_scipy():
    points = np.random.default_rng(1).standard_normal((12, 2))
    knots = np.arange(-DEGREE, 13.0) * 0.5 + 3.0
    other = BSpline(knots, points, DEGREE)
    time = np.linspace(3.0, 6.49, 200)
    spline = Spline(points, 0.5, 3.0)
    assert np.allclose(BASIS.sum(axis=1), [1, 0, 0, 0, 0, 0], atol=1e-15)
    for order in range(4):
        assert np.allclose(spline.at(time, order), other(time, order), rtol=1e-11, atol=1e-11 * 10**order)


def test_points_without_noise_are_met():
    time = np.linspace(0.0, 100.0, 1001)
    wave = np.sin(0.7 * time) + 0.2 * time
    spline = smoothed(time, wave[:, None], 0.5)
    fine = np.linspace(1.0, 99.0, 5000)
    assert np.sqrt(np.mean((spline.at(time)[:, 0] - wave) ** 2)) < 1e-6
    assert np.abs(spline.at(fine)[:, 0] - np.sin(0.7 * fine) - 0.2 * fine).max() < 1e-6
    assert np.abs(spline.at(fine, 2)[:, 0] + 0.49 * np.sin(0.7 * fine)).max() < 1e-4


def test_noise_is_smoothed_away():
    generator, time = np.random.default_rng(2), np.linspace(0.0, 100.0, 1001)
    wave = np.sin(0.3 * time)
    noisy = wave + 0.05 * generator.standard_normal(1001)
    spline = smoothed(time, noisy[:, None], 0.5)
    assert np.sqrt(np.mean((spline.at(time)[:, 0] - noisy) ** 2)) == pytest.approx(0.05, rel=0.1)
    error = spline.at(time)[:, 0] - wave
    assert np.sqrt(np.mean(error**2)) < 0.015  # of 0.05; at 21 s a period, 20 points and more share a wiggle
    known = smoothed(time, (wave + 0.05 * generator.standard_normal(1001))[:, None], 0.5, sigma=0.05)
    assert np.sqrt(np.mean((known.at(time)[:, 0] - wave) ** 2)) < 0.02


def test_irregular_times_and_weights():
    generator = np.random.default_rng(3)
    time = np.sort(generator.uniform(0.0, 60.0, 400))
    wave = np.cos(0.5 * time)
    wrong = wave.copy()
    wrong[::10] += 5.0
    weight = np.ones(400)
    weight[::10] = 1e-9
    spline = smoothed(time, wrong[:, None], 1.0, weight, sigma=0.0)
    assert len(spline.points) == point_count(time[-1] - time[0], 1.0)
    inside = (time > 2.0) & (time < 58.0)
    assert np.abs(spline.at(time)[inside, 0] - wave[inside]).max() < 2e-3


def test_derivatives_tell_of_the_motion_between_points():
    """Four points a period: too few without the derivatives."""
    time = np.arange(0.0, 60.0, 1.5)
    fine = np.linspace(0.0, time[-1], 1000)
    spline = smoothed(time, np.sin(time)[:, None], 1.5, rates=np.cos(time)[:, None])
    assert np.abs(spline.at(fine)[:, 0] - np.sin(fine)).max() < 0.01
    assert np.abs(smoothed(time, np.sin(time)[:, None], 1.5).at(fine)[:, 0] - np.sin(fine)).max() > 0.5


@pytest.mark.parametrize("knots", [50, 200])
def test_a_gap_of_many_knots(knots):
    """There the penalty alone determines the spline: a parabola has no jerk."""
    time = np.r_[np.arange(300.0), np.arange(300.0 + knots, 600.0 + knots)]
    spline = smoothed(time, (time**2)[:, None], 1.0)
    fine = np.linspace(0.0, time[-1], 5000)
    assert np.abs(spline.at(fine)[:, 0] - fine**2).max() < 1e-7 * time[-1] ** 2


@pytest.mark.parametrize("seed", [29, 211, 265])
def test_weights_that_rounding_loses_are_left_out(seed):
    """Long gaps between single points: with the smallest weights the equations are not positive definite."""
    generator = np.random.default_rng(seed)
    steps = generator.choice([1e-3, 0.3, 1.0, 3.0, 50.0, 199.0], size=20, p=[0.1, 0.2, 0.5, 0.1, 0.05, 0.05])
    time = np.concatenate([[0.0], np.cumsum(steps)])
    spline = smoothed(time, (1e-3 * time)[:, None], 1.0, sigma=0.0)
    assert np.abs(spline.at(time)[:, 0] - 1e-3 * time).max() < 1e-5 * time[-1]


@pytest.mark.parametrize("interval", [0.1, 0.25, 1.0])
def test_points_that_are_to_be_met_do_not_ring_at_the_ends(interval):
    """A uniform motion has no acceleration; a start and a stop between knots have none where they stand."""
    time = np.linspace(0.0, 60.0, 601)
    uniform = smoothed(time, np.column_stack([10.0 * time, 3.0 * time]), interval, sigma=0.0)
    fine = np.linspace(0.0, 60.0, 6001)
    assert np.abs(uniform.at(fine, 2)).max() < 1e-5
    inner = np.clip(time - 20.0, 0.0, 20.0)
    place = 0.5 * np.minimum(inner, 10.0) ** 2 + 10.0 * np.maximum(inner - 10.0, 0.0) - 0.5 * np.maximum(inner - 10.0, 0.0) ** 2
    spline = smoothed(time, place[:, None], interval, sigma=0.0)
    stands = (fine < 5.0) | (fine > 55.0)
    assert np.abs(spline.at(fine[stands], 2)).max() < 0.02
    assert np.abs(spline.at(time)[:, 0] - place).max() < 0.05  # corners of the acceleration between knots of 1 s
