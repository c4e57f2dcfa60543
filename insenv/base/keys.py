"""What a key of a section sets: a parameter row, by a conversion that a page repeats to the bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

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


SAME = Conversion("product", 1.0)
DEGREES = Conversion("product", math.pi / 180.0)
CELSIUS = Conversion("sum", 273.15)
BY_UNIT = {
    "deg": DEGREES,
    "deg/s": DEGREES,
    "deg C": CELSIUS,
    "K/h": Conversion("quotient", 3600.0),
    "Hz": Conversion("product", 2.0 * math.pi),
}
"""Conversions to SI by the unit of a key; values in other units are those of their rows."""


@dataclass(frozen=True)
class SetsRow:
    """Of a key: the row that it sets, and by which conversion.  ``{}`` in `row` stands for the name of the list that the
    section of the key is in; the place in that list is the element of the row."""

    row: str
    convert: Conversion


def unit_of(field: FieldInfo) -> str:
    """The unit of a key."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def conversion_of(field: FieldInfo) -> Conversion:
    """The conversion of a key: that of the row that it sets, else that of its unit."""
    stated = [each.convert for each in field.metadata if isinstance(each, SetsRow)]
    return stated[0] if stated else BY_UNIT.get(unit_of(field), SAME)


def keys_of(section: type[BaseModel]) -> dict[str, SetsRow]:
    """The keys of a section that set a row, and what each sets."""
    keys = ((name, each) for name, field in section.model_fields.items() for each in field.metadata)
    return {name: each for name, each in keys if isinstance(each, SetsRow)}


def rows_of(section: BaseModel, within: str = "", without: Collection[str] = ()) -> dict[str, Any]:
    """The rows (SI) that the keys of a section set, by name; not those of keys without a value and of `without`.

    within: name of the list that the section is in.
    """
    rows = {}
    for name, each in keys_of(type(section)).items():
        value = getattr(section, name)
        if value is not None and name not in without:
            converted = each.convert(np.asarray(value, dtype=np.float64))
            rows[each.row.format(within)] = converted if np.ndim(converted) else float(converted)
    return rows
