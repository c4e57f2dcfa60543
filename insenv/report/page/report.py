"""A `Page` as the document for the front end: plain values, and its arrays.  web/README.md describes the form."""

from __future__ import annotations

import base64
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.output import to_json
from insenv.base.shipped import __version__
from insenv.report.document import Page, Table
from insenv.report.page.html import assembled
from insenv.report.panels import Band, Curve, IntervalsPanel, Panel, Range, TimePanel

BYTES = 1_500_000
"""Bytes of a page for its arrays."""
FEWEST = 100
"""Records that a page keeps, however many arrays it has."""


def shown_records(records: int, arrays: int, budget: int = BYTES) -> NDArray[np.intp]:
    """Indices of the records that a page keeps: evenly spaced, the last among them; `arrays` arrays of them fit in `budget`."""
    most = max(FEWEST, int(budget / (16 / 3 * max(arrays, 1))))
    stride = -(-records // most) if records else 1
    return np.arange(records - 1, -1, -stride)[::-1]


class Pool:
    """The arrays of a page; panels refer to them by number."""

    def __init__(self) -> None:
        self._places: dict[bytes, int] = {}
        self._texts: list[str] = []

    def add(self, values: Any) -> int:
        """The number of an array (n,): single precision, little endian; the same array again has the same number."""
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        if data not in self._places:
            self._places[data] = len(self._texts)
            self._texts.append(base64.b64encode(data).decode("ascii"))
        return self._places[data]

    def as_json(self) -> list[str]:
        """The arrays in base64, by number."""
        return self._texts


def html(page: Page) -> str:
    """The text of a page."""
    return assembled(page.tab, {"report": page_json(page), **page.further})


def room(page_further: Any) -> int:
    """Bytes for the arrays of a page beside its further documents."""
    return BYTES - sum(len(to_json(document, indent=None)) for document in page_further.values())


def page_json(page: Page) -> dict[str, Any]:
    """The document of a page; sections without panels are left out."""
    pool = Pool()
    sections = [
        {
            "title": section.title,
            "panels": [_panel(panel, pool) for panel in section.panels],
            "columns": section.columns,
            "note": section.note,
        }
        for section in page.sections
        if section.panels
    ]
    return {
        "kind": "report",
        "version": __version__,
        "name": page.name,
        "title": page.title,
        "facts": list(page.facts),
        "truth": page.truth,
        **page.more,
        "legend": list(page.legend),
        "tables": [_table(table) for table in page.tables],
        "explained": list(page.explained),
        "notes": list(page.notes),
        "sections": sections,
        "arrays": pool.as_json(),
    }


def _table(table: Table) -> dict[str, Any]:
    return {**asdict(table), "columns": list(table.columns), "rows": [list(row) for row in table.rows]}


def _panel(panel: Panel, pool: Pool) -> dict[str, Any]:
    if isinstance(panel, TimePanel):
        curves = [_mark(mark, pool) for mark in panel.marks]
        settings = ("threshold", "log", "wraps", "from_s", "positive", "most", "level")
        return {
            "type": "time",
            "title": panel.title,
            "unit": panel.unit,
            "x": pool.add(panel.x),
            **{name: getattr(panel, name) for name in settings},
            "shade": [list(interval) for interval in panel.shade],
            "curves": curves,
        }
    if isinstance(panel, IntervalsPanel):
        rows = [dict(zip(("name", "value", "low", "high"), row, strict=True)) for row in panel.rows]
        return {"type": "intervals", "title": panel.title, "rows": rows}
    return {
        "type": "track",
        "title": panel.title,
        "unit": "m",
        "x": pool.add(panel.x),
        "tracks": [{"group": group, "east": pool.add(east), "north": pool.add(north)} for group, east, north in panel.tracks],
        "refused": [{"group": group, "at": [int(place) for place in places]} for group, places in panel.refused],
    }


def _mark(mark: Curve | Band | Range, pool: Pool) -> dict[str, Any]:
    if isinstance(mark, Curve):
        return {"kind": mark.kind, "group": mark.group, "y": pool.add(mark.y)}
    if isinstance(mark, Band):
        centre = None if mark.centre is None else pool.add(mark.centre)
        return {"kind": "band", "group": mark.group, "half": pool.add(mark.half), "centre": centre}
    both = {"low": pool.add(mark.low), "high": pool.add(mark.high)}
    return {"kind": "between", "group": mark.group, **both, "strength": mark.strength}
