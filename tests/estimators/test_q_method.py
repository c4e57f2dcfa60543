"""Low-pass and weights of the q-method: residual sway and cost."""

import casadi as ca
import numpy as np
import pytest

from insenv.estimators import q_method
from insenv.estimators.q_method import FILTER, SECTIONS
from insenv.runs.ensemble import ensemble
from insenv.scenario import load


def passed(signal, time_constant, dt):
    """Output of the low-pass for a signal (n), and its last states."""
    values, rates, value = ca.SX.sym("v", SECTIONS, 1), ca.SX.sym("r", SECTIONS, 1), ca.SX.sym("x")
    step = ca.Function("f", [values, rates, value], q_method.low_pass(values, rates, value, time_constant, dt))
    v, r, found = ca.DM.zeros(SECTIONS), ca.DM.zeros(SECTIONS), np.empty(len(signal))
    for k, x in enumerate(signal):
        v, r, y = step(v, r, x)
        found[k] = float(y)
    return found, np.array(v), np.array(r)


@pytest.mark.parametrize("dt", [pytest.param(0.02, marks=pytest.mark.slow), 0.1])
def test_low_pass_has_unit_gain_its_delay_and_its_zeros(dt):
    time = np.arange(dt, 300.0, dt)
    assert passed(np.ones(len(time)), 4.0, dt)[0][-1] == pytest.approx(1.0, abs=1e-6)
    assert time[-1] - passed(time, 4.0, dt)[0][-1] == pytest.approx(4.0 * sum(b for _, b, _ in FILTER), rel=1e-3)
    for _, _, c in FILTER:
        left = passed(np.sin(time / (4.0 * c)), 4.0, dt)[0][time > 200]
        assert np.abs(left).max() < 1e-4
    waves = [passed(np.sin(2 * np.pi * time / period), 4.0, dt)[0][time > 200] for period in (5.0, 7.0, 8.5, 10.0)]
    assert max(np.abs(wave).max() for wave in waves) < 5e-3


def test_time_constant_zero_is_no_low_pass():
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


def test_sway_alone_leaves_little():
    """A perfect unit on the swaying ship, weights of its marine unit: a twentieth of the error from its noise."""
    scenario = load("ship-swaying")
    scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": "perfect"})})
    e = ensemble(scenario, ["q-method"], [1], records=60, tuning={"q-method": {"memory_time": 34.4}})
    heading = np.abs(e.attitude_errors_deg("q-method")[0, :, 2])
    assert heading[e.time >= 150].max() < 5e-3
    assert heading[e.time >= 270].max() < 2e-3
