"""Units: what they are made of, and how values in those of data sheets and files become values in SI.

``h`` is an hour, ``g`` the standard gravity of data sheets (9.80665 m/s^2, independent of the local gravity), ``ppm`` a
millionth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest

FORMS: Mapping[str, Callable[[Any, float], Any]] = {
    "product": np.multiply,
    "quotient": np.divide,
    "sum": np.add,
    "degrees": lambda value, scale: np.divide(np.multiply(value, math.pi), scale),
    "inverse": lambda value, scale: np.multiply(scale, np.divide(1.0, value)),
}
"""The ways in which an element of a row follows from a value and a scale, each rounded in one way: as in web/machine.js."""


@dataclass(frozen=True)
class Conversion:
    """A conversion of numbers or arrays: one of the `FORMS`, with its scale."""

    form: str
    scale: float

    def __call__(self, value: Any) -> Any:
        return FORMS[self.form](value, self.scale)

    def back(self, value: Any) -> Any:
        """The value that a product converts to `value`."""
        assert self.form == "product"
        return np.divide(value, self.scale)


@dataclass(frozen=True)
class Converted:
    """What a unit becomes: the SI unit, and the conversion to it."""

    si: str
    convert: Conversion


def _times(si: str, scale: float) -> Converted:
    return Converted(si, Conversion("product", scale))


HOUR = 3600.0
"""s."""
DEGREE = math.pi / 180.0
"""rad."""
STANDARD_GRAVITY = 9.80665
"""The unit g of data sheets, m/s^2, wherever the sensor is; exact by definition (3rd CGPM, 1901)."""
SAME = Conversion("product", 1.0)

CONVERTED: Mapping[str, Converted] = {
    "deg": _times("rad", DEGREE),
    "arcsec": _times("rad", DEGREE / 3600.0),
    "urad": _times("rad", 1e-6),
    "deg/s": _times("rad/s", DEGREE),
    "deg/h": _times("rad/s", DEGREE / HOUR),
    "deg/sqrt(h)": _times("rad/s^0.5", DEGREE / math.sqrt(HOUR)),
    "deg/h/sqrt(h)": _times("rad/s/sqrt(s)", DEGREE / HOUR / math.sqrt(HOUR)),
    "deg/h/g": _times("(rad/s)/(m/s^2)", DEGREE / HOUR / STANDARD_GRAVITY),
    "deg/h/K": _times("rad/s/K", DEGREE / HOUR),
    "Hz": _times("rad/s", 2.0 * math.pi),
    "g": _times("m/s^2", STANDARD_GRAVITY),
    "ug": _times("m/s^2", STANDARD_GRAVITY * 1e-6),
    "mGal": _times("m/s^2", 1e-5),
    "ug/K": _times("m/s^2/K", STANDARD_GRAVITY * 1e-6),
    "ug/sqrt(Hz)": _times("m/s^1.5", STANDARD_GRAVITY * 1e-6),  # velocity random walk as an acceleration density
    "ug/sqrt(h)": _times("m/s^2/sqrt(s)", STANDARD_GRAVITY * 1e-6 / math.sqrt(HOUR)),
    "m/s/sqrt(h)": _times("m/s^1.5", 1.0 / math.sqrt(HOUR)),
    "km/h": _times("m/s", 1.0 / 3.6),
    "kn": _times("m/s", 1852.0 / 3600.0),
    "%": _times("1", 0.01),
    "% per m/s^2": _times("s^2/m", 0.01),
    "ppm": _times("1", 1e-6),
    "ppm/K": _times("1/K", 1e-6),
    "nT": _times("T", 1e-9),
    "deg C": Converted("K", Conversion("sum", 273.15)),
    "K/h": Converted("K/s", Conversion("quotient", HOUR)),
}
"""The units that are not SI, by name."""

SI = ("m", "s", "rad", "Hz", "K", "Pa", "T", "kg", "N", "J", "W", "A", "V")
"""What the SI units of rows are made of, with powers, roots and "1"."""

Dimension = Mapping[str, float]
"""Power of each of the `SI` that is not 0."""


def dimension(unit: str) -> Dimension | None:
    """What a unit of a row is made of, such as ``{"m": 1, "s": -2}`` of "m/s^2"; None for one that is not made of the `SI`."""
    tokens = re.findall(r"sqrt|[A-Za-z]+|\^-?[0-9.]+|[()/*]|1|\S", unit)
    try:
        rest = iter([*tokens, ""])
        powers, end = _product(rest, next(rest))
    except (ValueError, StopIteration):
        return None
    return None if end else {name: power for name, power in powers.items() if power}


def _product(rest: Iterator[str], token: str) -> tuple[dict[str, float], str]:
    """The powers of a product or quotient that begins with `token`, and the token after it."""
    powers: dict[str, float] = {}
    sign = 1.0
    while True:
        factor, token = _factor(rest, token)
        for name, power in factor.items():
            powers[name] = powers.get(name, 0.0) + sign * power
        if token not in ("/", "*"):
            return powers, token
        sign, token = (-1.0 if token == "/" else 1.0), next(rest)


def _factor(rest: Iterator[str], token: str) -> tuple[dict[str, float], str]:
    root = token == "sqrt"
    token = next(rest) if root else token
    if token == "(":
        powers, closing = _product(rest, next(rest))
        if closing != ")":
            raise ValueError(closing)
    elif token in SI and not root:
        powers = {token: 1.0}
    elif token == "1" and not root:
        powers = {}
    else:
        raise ValueError(token)
    token, exponent = next(rest), 0.5 if root else 1.0
    if token.startswith("^"):
        token, exponent = next(rest), exponent * float(token[1:])
    return {name: power * exponent for name, power in powers.items()}, token


def converted(unit: str) -> Converted:
    """What a unit becomes: one of `CONVERTED`; any other is its own SI unit, none is "1"."""
    return CONVERTED.get(unit) or Converted(unit or "1", SAME)


def is_known(unit: str) -> bool:
    """Whether a unit is none, one of `CONVERTED`, or made of the `SI`."""
    return not unit or unit in CONVERTED or dimension(unit) is not None


def check_unit(what: str, unit: str, row: str = "", row_unit: str = "") -> None:
    """Raise `InputError` for a unit that is not known, or whose values, converted, are none of a row in `row_unit` (SI).

    what: in messages, what is given in the unit.  row: name of the row.
    """
    if not is_known(unit):
        raise InputError(f"{what}: unit {unit!r}: unknown{nearest(unit, [*CONVERTED, 'm', 's', 'm/s', 'rad', 'rad/s'])}")
    if not row:
        return
    si, of_row = converted(unit).si, dimension(row_unit)
    if si != row_unit and (of_row is None or dimension(si) != of_row):
        fitting = [name for name, each in CONVERTED.items() if of_row is not None and dimension(each.si) == of_row]
        allowed = ", ".join(map(repr, dict.fromkeys([row_unit if row_unit != "1" else "", *fitting])))
        raise InputError(f"{what}: unit {unit!r} ({si}) is none of its row {row!r} in {row_unit}: allowed is {allowed}")
