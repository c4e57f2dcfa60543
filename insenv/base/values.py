"""Types of values in a scenario file, in addition to those of `insenv.base.toml`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, WithJsonSchema

from insenv.base.toml import Number, Vector3, plain


def _check_axes(value: object) -> object:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number and not (isinstance(value, (list, tuple)) and len(value) == 3):
        raise ValueError("must be a number, or a list of three, one for each axis")
    return (value,) * 3 if number else tuple(value)  # type: ignore[arg-type]


_check_axes.takes = "number or 3"  # type: ignore[attr-defined]  # for the table of keys


def _check_pair(value: object) -> object:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise ValueError("must be a list of two, begin and end")
    return tuple(value)


PerAxis = Annotated[
    tuple[Number, Number, Number],
    BeforeValidator(_check_axes),
    WithJsonSchema(
        {"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]}
    ),
]
"""One number for all three axes, or one for each."""


def within(lower: float, upper: float, above: bool = False) -> AfterValidator:
    """Validator: each number is from `lower` (`above`: excluded) to `upper`."""
    limits = f"{'above' if above else 'from'} {plain(lower)} to {plain(upper)}"

    def check(value: tuple[float, ...]) -> tuple[float, ...]:
        if any(not lower <= number <= upper or (above and number == lower) for number in value):
            raise ValueError(f"each must be {limits}")
        return value

    check.limits = limits  # type: ignore[attr-defined]  # for the table of keys
    return AfterValidator(check)


Rotation = Annotated[Vector3, within(-180.0, 180.0)]
LeverArm = Annotated[Vector3, within(-1e3, 1e3)]
NotNegative = Annotated[PerAxis, within(0.0, 1e5)]
Sigmas = Annotated[PerAxis, within(0.0, 1e5, above=True)]

Window = Annotated[tuple[Number, Number], BeforeValidator(_check_pair)]


def one_of(names: Iterable[str]) -> WithJsonSchema:
    """Annotation: in the JSON schema, the value is one of `names`.  It does not check the value."""
    return WithJsonSchema({"type": "string", "enum": list(names)})
