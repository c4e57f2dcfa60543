"""Elementary functions made of +, -, *, /, sqrt, floor and comparisons only.

IEEE 754 rounds these operations in exactly one way, so results are bit-identical in CasADi's interpreter, in generated
C, over vectors of lanes and on other machines; the sine of a C library is not. The functions also vectorize, because
they have no branches: ``select`` evaluates both sides and keeps one. The side that is not kept must therefore stay
finite too, in value and derivative, or symbolic differentiation would produce 0 * inf.

Arguments are SX of any shape (elementwise) or plain floats. Angles are in radians. The kernels are Taylor series
carried to rounding rather than minimax fits: the derivative of a Taylor series is again a Taylor series, so that
vehicle truth may differentiate them. Constants are literals or correctly rounded quotients, never results of
``math.log`` and the like, which differ between machines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from math import factorial
from typing import Any, TypeAlias

import casadi as ca

Scalar: TypeAlias = Any  # SX or float: no common type describes operators that take either

PI = 3.141592653589793
TWO_PI = 2.0 * PI


def _split(numerator: int, denominator: int, bits: Sequence[int]) -> list[float]:
    """A number as a sum of floats, each but the last truncated to a multiple of 2^-bits."""
    rest, parts = Fraction(numerator, denominator), []
    for bit in bits:
        parts.append(float(Fraction(int(rest * 2**bit), 2**bit)))
        rest -= Fraction(parts[-1])
    return [*parts, float(rest)]


# 33 bits per part: the product with a quadrant number below 2^20 is exact.
_HALF_PI = _split(157079632679489661923132169163975144209858469968755, 10**50, (32, 65))
# 32 bits: the product with a binary exponent below 2^11 is exact.
_LN2 = _split(69314718055994530941723212145817656807550013436026, 10**50, (32,))
_SQRT2 = 1.4142135623730951

_SIN = [(-1) ** k / factorial(2 * k + 1) for k in range(9)]  # sin(x)/x in x^2, good to 1e-19 for |x| <= pi/4
_COS = [(-1) ** k / factorial(2 * k) for k in range(9)]  # cos(x) in x^2, good to 3e-18 there
_EXP = [1 / factorial(k) for k in range(15)]  # good to 1e-19 for |x| <= ln(2)/2
_ATAN = [(-1) ** k / (2 * k + 1) for k in range(14)]  # atan(x)/x in x^2, good to 2e-19 for |x| <= 0.2361
_ATANH = [1 / (2 * k + 1) for k in range(12)]  # atanh(x)/x in x^2, good to 2e-20 for |x| <= 0.1716
_COS_HALF = [c / 4**k for k, c in enumerate(_COS)]
_SINC_HALF = [c / 2 / 4**k for k, c in enumerate(_SIN)]

ATAN_SERIES_LIMIT = 0.0557
"""Largest x^2 for which ``atan_series`` is accurate to rounding."""


def polynomial(x: Scalar, coefficients: Sequence[float]) -> Scalar:
    """Value at x of the polynomial with these coefficients, constant term first (Horner)."""
    value: Scalar = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + x * value
    return value


def select(condition: Scalar, a: Scalar, b: Scalar) -> Scalar:
    """a where the condition holds, b elsewhere; both are evaluated."""
    if isinstance(condition, ca.SX):  # the nodes of ca.if_else, without the search for its overload
        keep, other = ca.OP_IF_ELSE_ZERO, ca.SX.unary(ca.OP_NOT, condition)
        return ca.SX.binary(keep, condition, a) + ca.SX.binary(keep, other, b)
    if isinstance(condition, (ca.DM, ca.MX)):
        return ca.if_else(condition, a, b)
    return a if condition else b


def minimum(a: Scalar, b: Scalar) -> Scalar:
    """The smaller of the two; a NaN in a is kept."""
    return select(b < a, b, a)


def maximum(a: Scalar, b: Scalar) -> Scalar:
    """The larger of the two; a NaN in a is kept."""
    return select(b > a, b, a)


def clamp(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    """The value in [low, high] nearest to x; a NaN is kept."""
    return minimum(maximum(x, low), high)


def wrap_angle(x: Scalar) -> Scalar:
    """The angle shifted by whole turns into (-pi, pi]; unchanged to the last bit if it is there already."""
    return x + TWO_PI * ca.floor(0.5 - x / TWO_PI)


def sin_cos(x: Scalar) -> tuple[Scalar, Scalar]:
    """Sine and cosine to 2e-16 for |x| < 1e6; beyond, the error grows with the argument.

    Cody and Waite's reduction: x - k pi/2 with pi/2 in three parts, of which the first two give exact products.
    """
    k = ca.floor(x * (2.0 / PI) + 0.5)
    r = x
    for part in _HALF_PI:
        r = r - k * part
    z = r * r
    kernel_sin = r * polynomial(z, _SIN)
    kernel_cos = polynomial(z, _COS)
    half = ca.floor(0.5 * k)
    odd = k - 2.0 * half  # quadrants 1 and 3 exchange sine and cosine
    sign = 1.0 - 2.0 * (half - 2.0 * ca.floor(0.5 * half))  # quadrants 2 and 3 change the sign of the sine
    return (
        sign * select(odd == 1.0, kernel_cos, kernel_sin),
        sign * select(odd == 1.0, -kernel_sin, kernel_cos),
    )


def sin(x: Scalar) -> Scalar:
    return sin_cos(x)[0]


def cos(x: Scalar) -> Scalar:
    return sin_cos(x)[1]


def cos_half(s: Scalar) -> Scalar:
    """cos(a/2) from s = a^2, to rounding for |a| <= 0.5; differentiable at 0, having no square root."""
    return polynomial(s, _COS_HALF[:7])


def sinc_half(s: Scalar) -> Scalar:
    """sin(a/2)/a from s = a^2, by series: to rounding for |a| <= 0.5; 1/2 at 0."""
    return polynomial(s, _SINC_HALF[:6])


def atan_series(z: Scalar) -> Scalar:
    """atan(x)/x from z = x^2, by series: to rounding for z <= ATAN_SERIES_LIMIT; 1 at 0."""
    return polynomial(z, _ATAN)


def atan2(y: Scalar, x: Scalar) -> Scalar:
    """Angle of the point (x, y) in [-pi, pi], to 5e-16; atan2(0, 0) = 0, and the sign of a zero is ignored.

    The ratio t of the smaller to the larger coordinate is expanded about c = 0, 1/2 or 1: atan t = atan c +
    atan((t-c)/(1+ct)). Multiplication by these c is exact, and the remainder is at most sqrt(5) - 2.
    """
    x_negative, y_negative = x < 0.0, y < 0.0
    x_sign, y_sign = 1.0 - 2.0 * x_negative, 1.0 - 2.0 * y_negative
    ax, ay = x_sign * x, y_sign * y
    steep = ay > ax
    low, high = select(steep, ax, ay), select(steep, ay, ax)
    high = high + (high == 0.0)
    beyond_0, beyond_half = low > 0.2360 * high, low > 0.7208 * high
    c = 0.5 * beyond_0 + 0.5 * beyond_half
    t = (low - c * high) / (high + c * low)
    atan_c = 0.4636476090008061 * beyond_0 + 0.3217505543966422 * beyond_half  # atan(1/2), pi/4 - atan(1/2)
    a = atan_c + t * atan_series(t * t)
    a = select(steep, 0.5 * PI - a, a)
    return y_sign * (PI * x_negative + x_sign * a)


_DEGENERATE = 1e-28  # below this squared radius a point is the origin but for rounding


def split_half_angles(sum_x: Scalar, sum_y: Scalar, difference_x: Scalar, difference_y: Scalar) -> tuple[Scalar, Scalar]:
    """Angles a, b in (-pi, pi] from points of arguments (a + b)/2 and (a - b)/2; a = 0 if one vanishes."""
    half_sum, half_difference = atan2(sum_y, sum_x), atan2(difference_y, difference_x)
    no_sum = sum_x**2 + sum_y**2 < _DEGENERATE
    no_difference = difference_x**2 + difference_y**2 < _DEGENERATE
    half_sum, half_difference = (
        select(no_sum, -half_difference, half_sum),
        select(no_difference, -half_sum, half_difference),
    )
    return wrap_angle(half_sum + half_difference), wrap_angle(half_sum - half_difference)


def exp(x: Scalar) -> Scalar:
    """e^x to a relative 2e-16; the argument is clamped to [-700, 700], so that the result is a normal float."""
    x = clamp(x, -700.0, 700.0)
    k = ca.floor(x / (_LN2[0] + _LN2[1]) + 0.5)
    value = polynomial((x - k * _LN2[0]) - k * _LN2[1], _EXP)
    # 2^|k|, one exact factor for each binary digit of |k|
    negative = k < 0.0
    rest, power = (1.0 - 2.0 * negative) * k, 1.0
    for bit in reversed(range(10)):
        digit = rest >= 2.0**bit
        rest = rest - 2.0**bit * digit
        power = power * select(digit, 2.0**2**bit, 1.0)
    return value * select(negative, 1.0 / power, power)


def log(x: Scalar) -> Scalar:
    """Natural logarithm of a positive normal float, to a relative 4e-16; meaningless for x <= 0."""
    small = x < 1.0
    m = x * select(small, 2.0**1023, 1.0)
    k = -1023.0 * small
    for bit in reversed(range(10)):  # m into [1, 2) by exact factors
        large = m >= 2.0**2**bit
        m = m * select(large, 2.0 ** -(2**bit), 1.0)
        k = k + 2.0**bit * large
    upper = m > _SQRT2
    m = m * (1.0 - 0.5 * upper)
    k = k + upper
    f = (m - 1.0) / (m + 1.0)
    return k * _LN2[0] + (2.0 * f * polynomial(f * f, _ATANH) + k * _LN2[1])


# Minimax fits by the Remez exchange in extended precision: relative errors 1.4e-11, 7.5e-13 and 6.4e-11.
# fmt: off
_SIN_PI = (  # sin(pi x)/x in x^2, x^2 <= 1/4
    3.141592653246882, -5.1677127414079305, 2.5501627982540103,
    -0.599247433853031, 0.08203133723045328, -0.007000647226602793,
)
_COS_PI = (  # cos(pi x) in x^2, x^2 <= 1/4
    0.9999999999992518, -4.934802200250963, 4.058712107589396, -1.3352623161482258,
    0.2353254434269907, -0.02577634074294349, 0.001840021856131893,
)
_4_ATANH = (  # 4 atanh(x)/x in x^2, |x| <= tanh(3/8)
    3.9999999989839763, 1.333333892068586, 0.7999502914124786,
    0.573036987864765, 0.4212265692114418, 0.512795403544185,
)
_LOG_STEPS = (  # (bound, factor): below the bound, multiply by the factor
    (1.300729765406762e-05, 162754.79141900392),  # e^-11.25, e^12
    (0.005247518399181385, 403.4287934927351),  # e^-5.25, e^6
    (0.10539922456186433, 20.085536923187668),  # e^-2.25, e^3
    (0.4723665527410147, 4.4816890703380645),  # e^-0.75, e^1.5
)
# fmt: on


def normal_pair(u1: Scalar, u2: Scalar) -> tuple[Scalar, Scalar]:
    """Two independent standard normals from independent uniforms in (0, 1), u1 >= 2^-33, by Box and Muller.

    With r = sqrt(-2 ln u1), returns r cos(2 pi u2) and r sin(2 pi u2), within 1e-9, in 70 arithmetic operations.
    Multiplying a small u1 by e^12, e^6, e^3, e^1.5 brings it to [e^-0.75, e^0.75], since 31 * 0.75 > 33 ln 2. The fit
    is relative to the logarithm, so that u1 -> 1 gives a radius -> 0 and never the root of a negative number. Sine and
    cosine of the half angle need no reduction to octants; doubling the angle takes four operations.
    """
    m, steps = u1, 0.0
    for bound, factor in _LOG_STEPS:
        below = m < bound
        m = m * (1.0 + (factor - 1.0) * below)
        steps = 2.0 * steps + below
    f = (m - 1.0) / (m + 1.0)
    radius = ca.sqrt(3.0 * steps - f * polynomial(f * f, _4_ATANH))
    a = 0.5 - u2
    z = a * a
    s = a * polynomial(z, _SIN_PI)
    radius_s = 2.0 * radius * s
    return radius_s * s - radius, radius_s * polynomial(z, _COS_PI)


def normals(uniforms: Any) -> Any:
    """Independent standard normals (n) from an even number n of uniforms in (0, 1), as a column."""
    pairs = [normal_pair(uniforms[i], uniforms[i + 1]) for i in range(0, uniforms.shape[0], 2)]
    return ca.vertcat(*[number for pair in pairs for number in pair])


# CasADi's operators without the search for their overload, while equations are traced.
#
# `x * y` of two SX takes 20 us in Python, of which the node takes 2: CasADi tries to convert both to numbers, arrays and sparse
# matrices before it takes them for what they are.  A model has some ten thousand such operations.

_FORWARD = {
    "__add__": ca.OP_ADD,
    "__sub__": ca.OP_SUB,
    "__mul__": ca.OP_MUL,
    "__truediv__": ca.OP_DIV,
    "__lt__": ca.OP_LT,
    "__le__": ca.OP_LE,
    "__eq__": ca.OP_EQ,
    "__ne__": ca.OP_NE,
}
_REVERSED = {
    "__radd__": ca.OP_ADD,
    "__rsub__": ca.OP_SUB,
    "__rmul__": ca.OP_MUL,
    "__rtruediv__": ca.OP_DIV,
    "__gt__": ca.OP_LT,
    "__ge__": ca.OP_LE,
}
_PLAIN = frozenset((ca.SX, float, int))


@contextmanager
def quick_operators() -> Iterator[None]:
    """Operators of SX with SX or plain numbers make the same node at once; all others are CasADi's, as all are afterwards."""
    for name, quick in _QUICK.items():
        setattr(ca.SX, name, quick)
    try:
        yield
    finally:
        for name, usual in _USUAL.items():
            setattr(ca.SX, name, usual)


def _quick(name: str) -> Callable[[Any, Any], Any]:
    usual, make = _USUAL[name], ca.SX.binary
    if name in _REVERSED:
        operation = _REVERSED[name]
        return lambda x, y: make(operation, y, x) if type(y) in _PLAIN else usual(x, y)
    operation = _FORWARD[name]
    return lambda x, y: make(operation, x, y) if type(y) in _PLAIN else usual(x, y)


_USUAL = {name: getattr(ca.SX, name) for name in (*_FORWARD, *_REVERSED)}
_QUICK = {name: _quick(name) for name in _USUAL}
