"""How a text file is written: its separator, its header, the names of its columns.

The separator is the one by which the most lines have one number of fields, most of them numbers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.logs.columns import Column
from insenv.logs.formats.csv_table import AllColumns, all_columns, is_number
from insenv.studies.describe.finding import Finding, UnclearError
from insenv.studies.describe.tables import LogTable

SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": None}
"""Separator by its name in a description."""
HEAD_LINES = 400
"""Lines from which the layout is detected."""
NUMBERS_SHARE = 0.5
"""Share of the fields of a line that are numbers or empty, from which it is a row."""


def text_table(label: str, raw: bytes, file: str) -> LogTable:
    """A text file of a log.

    label: its name for messages; raw: its bytes; file: its name in the description.  Raises `InputError`.
    """
    if b"\0" in raw:
        raise InputError(f"{label}: neither a text table nor of a format that its name says")
    head = raw[: 1 << 20].decode("utf-8", errors="replace").splitlines()[:HEAD_LINES]
    head = head[:-1] if len(raw) > 1 << 20 else head
    comment = next((c for c in "#%" if any(line.startswith(c) for line in head)), "#")
    lines = [(number, line) for number, line in enumerate(head) if line.strip() and not line.startswith(comment)]
    name, fields, share = _separator(label, [line for _, line in lines])
    rows = [number for number, line in lines if _is_row(line, SEPARATORS[name], fields)]
    if not rows:
        raise InputError(f"{label}: no line holds numbers in {fields} fields")
    before = [line for number, line in lines if number < rows[0]]
    first = rows[0] if not before else 1 + max(number for number, _ in lines if number < rows[0])
    header_rows = first if before else None
    table = all_columns(label, raw, name, header_rows, comment)
    names, source = _names(table, before, SEPARATORS[name], fields, comment, head[:first])
    refs = _references(names, source == "header")
    head_words = {"header": "the line before them names the columns", "units": "a line of units follows that of the names"}
    evidence = (
        f"{100 * share:.4g} % of the lines have {fields} fields, separated by {name if name.isalpha() else repr(name)};"
        f" {head_words.get(source, 'no line names the columns, which are counted from 0')}"
    )
    layout: dict[str, Any] = {"delimiter": name}
    layout |= {} if header_rows is None else {"header_rows": header_rows}
    layout |= {} if comment == "#" else {"comment": comment}
    return LogTable((file,), names, refs, table.values, layout=layout, said=(Finding("delimiter", name, evidence),))


def _separator(label: str, lines: Sequence[str]) -> tuple[str, int, float]:
    """Name of the separator, number of fields, share of the lines that have it."""
    best: tuple[float, str, int, float] | None = None
    for name, character in SEPARATORS.items():
        if character is not None and not any(character in line for line in lines):
            continue
        counts = Counter(len(line.split(character)) for line in lines)
        fields, count = max(counts.items(), key=lambda item: (item[1], item[0]))
        share = count / len(lines)
        numbers = np.mean([_is_row(line, character, fields) for line in lines])
        score = share * float(numbers)
        if fields >= 2 and (best is None or score > best[0] + 1e-9):
            best = score, name, fields, share
    if best is None or best[0] < NUMBERS_SHARE:
        if all(len(line.split(character)) == 1 for line in lines for character in SEPARATORS.values()):
            raise UnclearError(f"{label}: one column: a log has a time and what was measured then")
        sample = next(iter(lines), "")[:60]
        decimal = (
            ": its numbers have decimal commas, which are not read" if re.search(r"\d,\d+[;\t]", " ".join(lines[-5:])) else ""
        )
        raise UnclearError(f"{label}: no separator parts its lines into numbers{decimal} (a line: {sample!r})")
    return best[1:]


def _is_row(line: str, separator: str | None, fields: int) -> bool:
    parts = [part.strip().strip('"') for part in line.strip("\r\n").split(separator)]
    if len(parts) != fields:
        return False
    filled = [part for part in parts if part]
    return bool(filled) and sum(map(is_number, filled)) >= NUMBERS_SHARE * len(filled)


def _names(
    table: AllColumns, before: Sequence[str], separator: str | None, fields: int, comment: str, head: Sequence[str]
) -> tuple[tuple[str, ...], str]:
    """Names of the columns and where they are from: "header", "units" (a line of units stands below them), or ""."""
    parts = [[part.strip().strip('"') for part in line.split(separator)] for line in before]
    fitting = [each for each in parts if len(each) == fields]
    if not fitting:
        return (table.names or ("",) * fields), "header" if table.names else ""
    if len(fitting) > 1 and all(re.fullmatch(r"[\[(]?[a-zµ/^0-9*.%-]*[\])]?", part) for part in fitting[-1]):
        return tuple(f"{a} [{b}]" if b else a for a, b in zip(fitting[-2], fitting[-1], strict=True)), "units"
    return tuple(fitting[-1]), "header" if len(parts[-1]) == fields else "units"


def _references(names: Sequence[str], usable: bool) -> tuple[Column, ...]:
    """How a description names the columns: by the name if it is the only one of its kind, otherwise by the number."""
    counts = Counter(names)
    return tuple(name if usable and name and counts[name] == 1 else place for place, name in enumerate(names))
