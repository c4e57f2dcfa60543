"""Checks of arguments; each error names the argument, its value, its unit and what is allowed."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np

from insenv.base.errors import InputError, UnknownArgumentError, nearest
from insenv.core.tables import Array

MAX_TEXT = 80
"""Characters of a value in a message, at most."""


def refused(name: str, value: Any, allowed: str, unit: str = "") -> InputError:
    """Return the error for a value that is not allowed; `unit` follows the value if it is a number."""
    text = repr(value.item() if isinstance(value, np.generic) else value).replace("\n", "")
    text = text if len(text) <= MAX_TEXT else text[: MAX_TEXT - 3] + "..."
    return InputError(f"{name} = {text}{f' {unit}' if unit and is_number(value) else ''}: allowed is {allowed}")


def is_number(value: Any) -> bool:
    """Return whether a value is a real number; a bool is not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def is_whole(value: Any, least: int = 0) -> bool:
    """Return whether a value is an integer from `least`; a bool is not."""
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


def as_numbers(value: Any) -> Array | None:
    """Return nested sequences of numbers as an array, None for anything else."""
    try:
        array = np.asarray(value)
    except ValueError:  # nested sequences of different lengths
        return None
    return array.astype(np.float64, copy=False) if array.dtype.kind in "iuf" else None


def check_whole(name: str, value: Any) -> int:
    """Return a positive integer.  Raises `InputError` for anything else."""
    if not is_whole(value, 1):
        raise refused(name, value, "a whole number from 1")
    return int(value)


def check_number(name: str, value: Any, least: float, most: float, unit: str = "", *, above: bool = False) -> float:
    """Return a number from `least` (above: greater than `least`) to `most` as a float.  Raises `InputError`."""
    if not is_number(value) or not least <= value <= most or (above and value == least):
        bounds = f"above {least:g} up to {most:g}" if above else f"from {least:g} to {most:g}"
        raise refused(name, value, f"a number {bounds}{unit and ' '}{unit}", unit)
    return float(value)


def check_range(name: str, value: Any, least: float, most: float, unit: str = "") -> None:
    """Raise `InputError` unless the value is None or a pair of non-decreasing numbers from `least` to `most`."""
    pair = as_numbers(value) if value is not None else np.full(2, least)
    if pair is None or pair.shape != (2,) or not least <= pair[0] <= pair[1] <= most:
        raise refused(name, value, f"a pair (low, high) of numbers from {least:g} to {most:g}{unit and ' '}{unit}")


def check_choice(name: str, value: Any, choices: Sequence[str]) -> None:
    """Raise `InputError` unless the value is one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise refused(name, value, " or ".join(map(repr, choices)))


def check_type(name: str, value: Any, types: type | tuple[type, ...], allowed: str) -> None:
    """Raise `InputError` unless the value is of one of the types, which `allowed` describes."""
    if not isinstance(value, types):
        raise refused(name, value, allowed)


def check_keywords(owner: str, call: Callable[..., Any], names: Iterable[str]) -> None:
    """Raise `UnknownArgumentError` for the first keyword that `call` does not take; the message has the nearest one."""
    parameters = inspect.signature(call).parameters
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        return
    allowed = [name for name in parameters if name != "self"]
    for name in names:
        if name not in allowed:
            raise UnknownArgumentError(f"{owner} got an unexpected keyword argument {name!r}{nearest(name, allowed)}")
