"""What a key of a section sets: a parameter row, by a conversion that a page repeats to the bit."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from insenv.base.units import Conversion, converted


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
    return stated[0] if stated else converted(unit_of(field)).convert


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
