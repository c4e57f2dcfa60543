"""JSON documents: a report as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from insenv.base.output import finite
from insenv.report.run_data import RunData


def document(report: RunData, files: Sequence[str] = ()) -> dict[str, Any]:
    """The documented form of a run or replay; with `published` and `files` (paths written) if there are any."""
    found = report.as_json()
    if report.published:
        found["published"] = [{"name": name, "rms": dict(rms)} for name, rms in report.published]
    if files:
        found["files"] = list(files)
    return finite(found)
