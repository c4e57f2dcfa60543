"""q-method: its eigenvector against LAPACK, its low-pass and weights, sway."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed

from insenv import run
from insenv.core.numeric import vectorized
from insenv.estimators import q_method
from insenv.estimators.parts.inertial_vectors import largest_eigenvector
from insenv.estimators.q_method import FILTER, SECTIONS

eigenvector = vectorized(largest_eigenvector, (4, 4))
CLOSE, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(4, 4)))


def symmetric_matrices(count=20):
    rng = np.random.default_rng(0)
    for _ in range(count):
        A = rng.normal(size=(4, 4)) * 10.0 ** rng.integers(-6, 7)
        yield A + A.T


SPECIAL = [np.zeros((4, 4)), np.eye(4), np.diag([1.0, 3, 3, 0]), np.diag([-5.0, -4, -9, -7]), np.ones((4, 4))]


@pytest.mark.parametrize("A", [*symmetric_matrices(), *SPECIAL, CLOSE @ np.diag([1.0, 1 - 2e-6, 0.2, 0.1]) @ CLOSE.T])
def test_eigenvector_against_lapack(A):
    """Of equal and zero eigenvalues too, and of a gap of 1e-6, from which heading follows after a minute."""
    values, vectors = np.linalg.eigh(A)
    found, gap = eigenvector(A), (values[3] - values[2]) / max(np.abs(A).max(), 1e-300)
    assert abs(found @ found - 1) < 1e-14
    assert np.abs(A @ found - values[-1] * found).max() <= 1e-13 * np.abs(A).max()
    if gap > 1e-7:
        assert np.linalg.norm(found - vectors[:, -1] * (found @ vectors[:, -1])) < 1e-14 / gap


def passed(signal, time_constant, dt):
    """Output of the low-pass for a signal (n), and its last states."""
    values, rates, value = ca.SX.sym("v", SECTIONS, 1), ca.SX.sym("r", SECTIONS, 1), ca.SX.sym("x")
    step = ca.Function("f", [values, rates, value], q_method.low_pass(values, rates, value, time_constant, dt))
    start, whole = ca.DM.zeros(SECTIONS), step.mapaccum("whole", len(signal), 2)
    v, r, found = (np.array(part) for part in whole(start, start, ca.DM(signal).T))
    return found.ravel(), v[:, -1], r[:, -1]


def test_low_pass_has_unit_gain_its_delay_and_its_zeros():
    dt = 0.1
    time = np.arange(dt, 300.0, dt)
    assert passed(np.ones(len(time)), 4.0, dt)[0][-1] == pytest.approx(1.0, abs=1e-6)
    assert time[-1] - passed(time, 4.0, dt)[0][-1] == pytest.approx(4.0 * sum(b for _, b, _ in FILTER), rel=1e-3)
    for _, _, c in FILTER:
        left = passed(np.sin(time / (4.0 * c)), 4.0, dt)[0][time > 200]
        assert np.abs(left).max() < 1e-4
    waves = [passed(np.sin(2 * np.pi * time / period), 4.0, dt)[0][time > 200] for period in (5.0, 7.0, 8.5, 10.0)]
    assert max(np.abs(wave).max() for wave in waves) < 5e-3
    signal = np.random.default_rng(1).normal(size=50)
    found, values, rates = passed(signal, 0.0, 0.01)
    assert np.allclose(found, signal, rtol=1e-15) and not values.any() and not rates.any()


def test_the_weights_are_those_of_the_windows():
    """Unit vectors one at a time through `sample`'s recursion: l(t) h(T - t) + 2 h(t) l(T - t) by convolution."""
    dt, n, memory = 0.25, 240, 20.0
    step = passed(np.ones(n), 4.0, dt)[0]
    keep = memory / (memory + dt)
    fading = passed(keep ** np.arange(1, n + 1), 4.0, dt)[0]
    late = passed(keep ** np.arange(n), 4.0, dt)[0]
    for k in (20, 100, 200):
        total = np.zeros(n)
        total[k:] = fading[k] + q_method.LATE * step[k] * keep ** np.arange(n - k)
        by_recursion = passed(total, 4.0, dt)[0][-1]
        expected = fading[k] * step[n - 1 - k] + q_method.LATE * step[k] * late[n - 1 - k]
        assert by_recursion == pytest.approx(expected, rel=1e-9)
    assert step.min() > 0 and fading.min() > 0


@pytest.mark.parametrize("duration", [20.0, 68.0, 340.0])
def test_a_gyro_bias_turns_the_stated_vertical_for_the_mean_age_of_the_weights(duration):
    """Weights exp(-t / m) + 2 exp(-(T - t) / m) of the vectors at t, without a low-pass."""
    memory, bias = 34.0, 1e-7
    p = SimpleNamespace(
        memory_time=memory, smoothing_time=0.0, gyro_bias_sigma=bias,
        **dict.fromkeys(("accel_bias_sigma", "angle_random_walk", "velocity_random_walk"), 0.0),
    )  # fmt: skip
    x = SimpleNamespace(time=ca.SX(duration), rest_force_n=ca.SX([0, 0, -9.8]), axis_n=ca.SX([0.8, 0, -0.6]))
    t = (np.arange(2000) + 0.5) * duration / 2000
    age = np.average(duration - t, weights=np.exp(-t / memory) + 2 * np.exp((t - duration) / memory))
    found = np.sqrt(np.array(ca.DM(ca.evalf(q_method.sensor_variance(p, x)))).ravel())
    assert found[:2] == pytest.approx([bias * age] * 2, rel=0.04)


def test_sway_alone_leaves_little():
    """A perfect unit on the swaying ship, weights of its marine unit: a twentieth of the error from its noise."""
    scenario = changed("ship-swaying", imu={"grade": "perfect"})
    (result,) = run(scenario, "q-method", seed=1, settings={"q-method": {"memory_time_s": 34.4}}).results
    heading = np.abs(result.errors["heading_deg"])
    assert heading[result.time >= 150].max() < 5e-3
    assert heading[result.time >= 270].max() < 2e-3
