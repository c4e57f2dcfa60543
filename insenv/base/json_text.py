"""What commands print: plain values as JSON text without NaN, and the width of lines without a terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

WIDTH = 80
"""Columns of a table where there is no terminal."""


def to_json(value: Any, indent: int | None = 2) -> str:
    """JSON text in ASCII that any parser reads: numbers that are not finite become null."""
    return json.dumps(finite(value), allow_nan=False, indent=indent)


def finite(value: Any) -> Any:
    """A copy of nested mappings, sequences and scalars, including those of NumPy, with None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(name): finite(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
