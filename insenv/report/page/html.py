"""One self-contained HTML file from the folder ``web/`` and JSON documents.

The modules of ``web/`` are joined into one script, those of the worker into another: each stands once, after those that it
imports.  Scripts and documents stand deflated in the page, which unpacks them itself.  A content security policy forbids every
request, and every script and style but those of the page, which it names by their digests.
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

from insenv.base.errors import InsenvError
from insenv.base.output import to_json
from insenv.base.resources import web_folder

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
