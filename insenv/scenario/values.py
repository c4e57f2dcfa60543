"""Kinds of values in a scenario file, besides those of `insenv.toml_files`."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, WithJsonSchema

from insenv.toml_files import Number, Vector3


def _check_axes(value: object) -> object:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number and not (isinstance(value, (list, tuple)) and len(value) == 3):
        raise ValueError("must be a number, or a list of three (forward, right, down)")
    return (value,) * 3 if number else tuple(value)  # type: ignore[arg-type]


PerAxis = Annotated[
    tuple[Number, Number, Number],
    BeforeValidator(_check_axes),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]}),
]
"""One number for all three axes, or three."""


def within(lower: float, upper: float, above: bool = False) -> AfterValidator:
    """Validator: each of the numbers from `lower` (or above it) to `upper`."""

    def check(value: tuple[float, ...]) -> tuple[float, ...]:
        if any(not lower <= number <= upper or (above and number == lower) for number in value):
            raise ValueError(f"each must be {f'above {lower:g}, at most' if above else f'from {lower:g} to'} {upper:g}")
        return value

    return AfterValidator(check)


LeverArm = Annotated[Vector3, within(-1e3, 1e3)]
NotNegative = Annotated[PerAxis, within(0.0, 1e5)]
Sigmas = Annotated[PerAxis, within(0.0, 1e5, above=True)]
