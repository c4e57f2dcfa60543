"""Distributions of varied keys: ``0:1``, ``normal(0, 1)``, ``lognormal(1, 0.5)``, ``loguniform(0.1, 10)``, ``choice(a, b)``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, nearest

Array = NDArray[np.float64]

KINDS = {
    "uniform": "LOW, HIGH",
    "loguniform": "LOW, HIGH",
    "normal": "MEAN, SIGMA",
    "lognormal": "MEDIAN, SIGMA of the natural logarithm",
    "choice": "A, B, ...",
}
"""Kinds of distributions and their parameters."""
_CALL = re.compile(r"\s*([a-z]+)\s*\((.*)\)\s*", re.DOTALL)


@dataclass(frozen=True)
class Distribution:
    """A distribution by its kind (`KINDS`) and parameters; those of "choice" are numbers, texts or truth values."""

    kind: str
    parameters: tuple[Any, ...]

    def __post_init__(self) -> None:
        refusal = self._refusal()
        if refusal:
            raise InputError(f"{self}: {refusal}")

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(f'{p:g}' if isinstance(p, float) else str(p) for p in self.parameters)})"

    def _refusal(self) -> str:
        if self.kind not in KINDS:
            return f"no such distribution{nearest(self.kind, KINDS)}"
        if self.kind == "choice":
            kinds = {float if isinstance(p, (int, float)) and not isinstance(p, bool) else type(p) for p in self.parameters}
            if len(self.parameters) < 2 or len(set(self.parameters)) < len(self.parameters) or len(kinds) > 1:
                return "allowed are two or more different values of one kind"
            return "" if kinds != {float} or all(map(math.isfinite, self.parameters)) else "allowed are finite numbers"
        numbers = [isinstance(p, (int, float)) and not isinstance(p, bool) and math.isfinite(p) for p in self.parameters]
        if len(numbers) != 2 or not all(numbers):
            return f"allowed are two finite numbers, {KINDS[self.kind]}"
        first, second = self.parameters
        if self.kind in ("uniform", "loguniform") and first > second:
            return "allowed is a range of numbers, the lower first"
        if self.kind in ("loguniform", "lognormal") and first <= 0:
            return "allowed is a first number above 0"
        return "allowed is a sigma of 0 or more" if self.kind in ("normal", "lognormal") and second < 0 else ""

    def numbers(self, uniforms: Array) -> Array:
        """Values (n,) of the distribution for uniforms (n,) in (0, 1): its quantiles; of "choice" the places of the values."""
        if self.kind == "choice":
            return np.floor(uniforms * len(self.parameters))
        first, second = map(float, self.parameters)
        if self.kind == "uniform":
            return first + (second - first) * uniforms
        if self.kind == "loguniform":
            return first * np.exp(math.log(second / first) * uniforms)
        from scipy.special import ndtri

        normal = second * ndtri(uniforms)
        return first + normal if self.kind == "normal" else first * np.exp(normal)

    def value(self, number: float) -> Any:
        """The value of a scenario's key for one of `numbers`."""
        return self.parameters[int(number)] if self.kind == "choice" else float(number)

    def tried(self, numbers: Array) -> list[tuple[Any, str]]:
        """Values with which a plan is checked, and which ones they are: ends of a range, all choices, extremes of `numbers`."""
        if self.kind in ("uniform", "loguniform", "choice"):
            return [(value, "") for value in self.parameters]
        extremes = {"smallest": float(numbers.min()), "largest": float(numbers.max())}
        return [(value, f"the {which} of {len(numbers)} values drawn") for which, value in extremes.items()]

    @property
    def is_of_numbers(self) -> bool:
        """Whether its values are numbers."""
        return self.kind != "choice" or all(isinstance(p, (int, float)) and not isinstance(p, bool) for p in self.parameters)

    def as_json(self) -> dict[str, Any]:
        """Its documented form; of a range with the keys "low" and "high"."""
        ends = {"low": self.parameters[0], "high": self.parameters[1]} if self.kind == "uniform" else {}
        return {"distribution": self.kind, "parameters": list(self.parameters), **ends}


def parse_distribution(text: str) -> Distribution:
    """Parse ``low:high`` or ``kind(a, b, ...)``.  Raises `InputError` for any other form."""
    call = _CALL.fullmatch(text)
    if call:
        kind, inside = call.groups()
        parameters = tuple(_parameter(part) for part in inside.split(","))
        return Distribution(kind, parameters)
    low, colon, high = text.partition(":")
    try:
        parameters = float(low), float(high)
    except ValueError:
        colon = ""
    if not colon:
        raise InputError(f"allowed is key=low:high, such as imu.gyro_bias_deg_h=-0.01:0.01, or key= one of {_forms()}")
    return Distribution("uniform", parameters)


def _forms() -> str:
    return ", ".join(f"{kind}({parameters})" for kind, parameters in KINDS.items())


def _parameter(text: str) -> Any:
    text = text.strip().strip("\"'")
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text
