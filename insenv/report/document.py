"""JSON documents: a report as plain values, and plain values as text without NaN."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from insenv.report.run_data import RunData


def document(report: RunData, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented form of a run or replay; with `published` and `files` (paths written) if there are any."""
    found = report.as_json()
    if report.published:
        found["published"] = [{"name": name, "rms": dict(rms)} for name, rms in report.published]
    if files:
        found["files"] = list(files)
    return finite(found)


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
