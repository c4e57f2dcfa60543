"""Pages: one self-contained HTML file each, from the folder ``web/`` and JSON documents.

The modules of ``web/`` are joined into one script, those of the worker into another: each stands once, after those that it
imports.  Scripts and documents stand deflated in the page, which unpacks them itself.  A content security policy forbids every
request, and every script and style but those of the page, which it names by their digests.  web/README.md describes the form
of a document.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InsenvError
from insenv.base.output import to_json
from insenv.base.resources import web_folder
from insenv.base.shipped import __version__
from insenv.report.document import Page, Table
from insenv.report.panels import Band, Curve, IntervalsPanel, Panel, Range, TimePanel

LIMIT = 2_000_000
"""Bytes that a page may have."""
ENTRY = "main.js"
WORKER = "worker.js"
LOADER = "unpack.js"
STYLES = ("vendor/uPlot/uPlot.min.css", "colours.css", "page.css", "plots.css", "live.css", "sizes.css", "print.css")
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:function|const|class) (\w+)", re.MULTILINE)
_COMMENT = re.compile(r"^[ \t]*(?:/\*(?:[^*]|\*(?!/))*\*/[ \t]*\n|//[^\n]*\n)|^[ \t]+|^\n", re.MULTILINE)
"""What a reader of a page's source can do without: comments on lines of their own, indents, empty lines."""
_LEFT = re.compile(r"^\s*(?:import|export)\b", re.MULTILINE)


def assembled(title: str, documents: Mapping[str, Any]) -> str:
    """The text of a page that shows `documents`, JSON values by kind ("report", "live"); with "live" it may run WebAssembly."""
    folder = web_folder()
    style = "".join(_COMMENT.sub("", (folder / name).read_text("utf-8")) for name in STYLES)
    library = (folder / "vendor/uPlot/uPlot.iife.min.js").read_text("utf-8")
    script = f'{library}\n(() => {{\n"use strict";\n{joined(folder, ENTRY)}}})();\n'
    live = "live" in documents
    parts = [_part(kind, "application/json", to_json(value, indent=None)) for kind, value in documents.items()]
    if live:
        parts.append(_part("worker", "text/plain", worker_script()))
    parts.append(_part("script", "text/javascript", script))  # the last: it reads the others
    loader = _COMMENT.sub("", (folder / LOADER).read_text("utf-8"))
    filled = {
        "title": escape(title),
        "policy": policy((loader, script), style, live),
        "style": style,
        "packed": base64.b64encode(compressed(to_json(parts, indent=None).encode("utf-8"))).decode("ascii"),
        "loader": loader,
    }
    template = (folder / "page.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: filled[match.group(1)], template)


def worker_script() -> str:
    """The simulation of a live page, which its worker runs."""
    return f'"use strict";\n{joined(web_folder(), WORKER)}'


def check_size(text: str) -> None:
    """Raise `InsenvError` if a page is larger than `LIMIT`."""
    size = len(text.encode("utf-8"))
    if size > LIMIT:
        raise InsenvError(f"the page has {size / 1e6:.2f} MB: allowed are {LIMIT / 1e6:g} MB")


def policy(scripts: Sequence[str], style: str, live: bool) -> str:
    """The content security policy: no request at all; these scripts and this style; a worker and WebAssembly if `live`."""
    allowed = " ".join(map(_digest, scripts)) + (" 'wasm-unsafe-eval'; worker-src blob:" if live else "")
    return f"default-src 'none'; script-src {allowed}; style-src {_digest(style)}; img-src data: blob:"


def compressed(data: bytes) -> bytes:
    """Bytes as a page holds them: gzip, the same at any time."""
    return gzip.compress(data, 9, mtime=0)


def joined(folder: Path, entry: str) -> str:
    """The module `entry` with all that it imports as one text: each module is a function that gives what it exports.

    Raises `InsenvError` for a circle of imports, for other forms of import and export, and for template strings of several
    lines.
    """
    texts: dict[str, str] = {}

    def add(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            raise InsenvError(f"web/{name} imports itself: {' > '.join((*above, name))}")
        if name in texts:
            return
        text = (folder / name).read_text("utf-8")
        for _, other in _IMPORT.findall(text):
            add(other, (*above, name))
        exported = ", ".join(_EXPORT.findall(text))
        text = _IMPORT.sub(lambda match: f"const {{{match[1]}}} = {_variable(match[2])};\n", text)
        text = _COMMENT.sub("", _EXPORT.sub(lambda match: match.group().removeprefix("export "), text))
        if any(line.count("`") % 2 for line in text.splitlines()):
            raise InsenvError(f"web/{name}: a template string of several lines, which would lose its indents")
        if match := _LEFT.search(text):
            raise InsenvError(
                f"web/{name}: {match.group().strip()!r}: allowed are `import {{NAMES}} from` and `export` of a name"
            )
        texts[name] = f"// --- {name}\nconst {_variable(name)} = (() => {{\n{text}\nreturn {{ {exported} }};\n}})();\n"

    add(entry, ())
    return "".join(texts.values())


def _variable(name: str) -> str:
    return "module_" + name.removesuffix(".js").replace("-", "_")


def _part(id: str, type: str, text: str) -> dict[str, str]:
    """A script element of the page."""
    return {"id": id, "type": type, "text": text}


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


# A `Page` as the document for the front end: plain values, and its arrays.

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
    return {
        "caption": table.caption,
        "columns": list(table.heads or table.columns),
        "rows": table.texts,
        "group": table.group,
        "below": list(table.below),
        "warnings": table.marked,
        "state": table.state,
        "wide": table.wide,
    }


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
