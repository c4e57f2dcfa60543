"""Elementary functions against NumPy's extended precision."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insenv.core import elementary
from insenv.core.numeric import vectorized

LD = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(LD).nmant < 63, reason="the oracle needs extended precision")

N = 50_000
RNG = np.random.default_rng(1)
sin_cos = vectorized(elementary.sin_cos, ())
atan2 = vectorized(elementary.atan2, (), ())
exp = vectorized(elementary.exp, ())
log = vectorized(elementary.log, ())
normal_pair = vectorized(elementary.normal_pair, (), ())
wrap_angle = vectorized(elementary.wrap_angle, ())


def error(got, exact, relative=False):
    difference = np.abs(got.astype(LD) - exact)
    return float(np.max(difference / np.abs(exact) if relative else difference))


@pytest.mark.parametrize("reach, bound", [(0.8, 1.7e-16), (100.0, 1.7e-16), (1e6, 2e-16)])
def test_sin_cos(reach, bound):
    x = RNG.uniform(-reach, reach, N)
    s, c = sin_cos(x)
    assert error(s, np.sin(x.astype(LD))) < bound
    assert error(c, np.cos(x.astype(LD))) < bound
    k = np.arange(-400, 401)
    s, c = sin_cos(k * (np.pi / 2))
    assert np.max(np.abs(s - np.array([0, 1, 0, -1])[k % 4])) < 1e-13
    assert np.max(np.abs(c - np.array([1, 0, -1, 0])[k % 4])) < 1e-13
    assert sin_cos(0.0) == (0.0, 1.0)


def test_derivatives_are_as_good():
    x = ca.SX.sym("x")
    derivative = elementary.sin(x)
    for _ in range(4):
        derivative = ca.jacobian(derivative, x)
    f = ca.Function("f", [x], [derivative])
    grid = np.linspace(-10, 10, 2001)
    assert np.max(np.abs(np.array(f(grid)).ravel() - np.sin(grid))) < 1e-12


@pytest.mark.parametrize("decades", [0, 10, 100])
def test_atan2(decades):
    y, x = RNG.normal(size=(2, N)) * 10 ** RNG.uniform(-decades, decades, (2, N))
    assert error(atan2(y, x), np.arctan2(y.astype(LD), x.astype(LD))) < 5e-16
    y, x = (v.ravel() for v in np.meshgrid([-2.0, 0.0, 2.0], [-2.0, 0.0, 2.0]))
    np.testing.assert_array_equal(atan2(y, x), np.arctan2(y, x))


def test_exp_and_log():
    x = np.concatenate([RNG.uniform(-1, 1, N), RNG.uniform(-700, 700, N)])
    assert error(exp(x), np.exp(x.astype(LD)), relative=True) < 2.3e-16
    assert exp(0.0) == 1.0 and exp(1000.0) == exp(700.0) and np.isnan(exp(np.nan))
    x = np.concatenate([RNG.uniform(0.5, 2, N), 10 ** RNG.uniform(-307, 308, N), 1 + RNG.normal(size=N) * 1e-6])
    x = x[x != 1.0]
    assert error(log(x), np.log(x.astype(LD)), relative=True) < 5e-16
    assert log(1.0) == 0.0


@settings(deadline=None)  # the first call traces
@given(st.floats(-1e3, 1e3))
def test_wrap_angle(x):
    wrapped = wrap_angle(x)
    assert -np.pi <= wrapped <= np.nextafter(np.pi, 4)
    assert abs(np.sin((wrapped - x) / 2)) < 1e-12
    assert wrapped == x or not -np.pi < x <= np.pi


def test_normal_pair():
    word = np.concatenate([RNG.integers(0, 2**32, N), np.arange(100), 2**32 - 1 - np.arange(100)])
    u1, u2 = (word + 0.5) * 2.0**-32, (RNG.permutation(word) + 0.5) * 2.0**-32
    cosine_part, sine_part = normal_pair(u1, u2)
    radius, angle = np.sqrt(-2 * np.log(u1.astype(LD))), 8 * np.arctan(LD(1)) * u2
    assert error(cosine_part, radius * np.cos(angle)) < 1e-9
    assert error(sine_part, radius * np.sin(angle)) < 1e-9


def test_vectors_are_taken_too():
    v = ca.SX.sym("v", 3)
    f = ca.Function("f", [v], [elementary.clamp(v, -1.0, 1.0), elementary.cos(v)])
    clamped, cosine = f([-2.0, 0.5, 2.0])
    np.testing.assert_array_equal(clamped, [[-1.0], [0.5], [1.0]])
    np.testing.assert_allclose(cosine.full().ravel(), np.cos([-2.0, 0.5, 2.0]), atol=3e-16)
