"""The description that is written, its keys in sections, each below the sentence on which it rests; and what is printed."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from insenv.base.output import check_output_file, write_unless_other
from insenv.logs.formats.text_log import toml_text
from insenv.report import Document, Report, run_document
from insenv.report.document import Block, Line, Listing
from insenv.studies.describe.finding import Described, Finding

WIDTH = 112
_MARKS = {"measured": "", "named": "by its name: ", "assumed": "assumed: ", "open": "not seen in this log: "}


def description_text(title: str, command: str, keys: Mapping[str, Any], findings: Sequence[Finding]) -> str:
    """The TOML text.  keys: of the description, by section; findings: by key, "imu.axes"; what is left open is asked at its
    place."""
    said = {finding.key: finding for finding in findings}
    lines = [
        f"# Written by `{command}`.  Above each key stands what it rests on; look at what is marked",
        "# `assumed` and `not seen in this log`.  Keys: docs/logs.md.",
        "",
    ]
    lines += _section("", {"title": title, **{k: v for k, v in keys.items() if not isinstance(v, Mapping)}}, said)
    for name, section in keys.items():
        if isinstance(section, Mapping):
            lines += ["", f"[{name}]", *_section(f"{name}.", section, said)]
    left = [
        finding
        for finding in findings
        if finding.value is None and (finding.key.partition(".")[0] not in keys and "." in finding.key)
    ]
    lines += [""] * bool(left)
    for finding in left:
        lines += _comment(f"{_MARKS[finding.confidence]}{finding.key}: {finding.evidence}")
    return "\n".join(lines) + "\n"


def _section(prefix: str, keys: Mapping[str, Any], said: Mapping[str, Finding]) -> list[str]:
    lines: list[str] = []
    above: set[str] = set()
    for name, value in keys.items():
        finding = said.get(prefix + name)
        if finding is not None:
            sentence = f"{_MARKS[finding.confidence]}{finding.evidence}"
            lines += [] if sentence in above else _comment(sentence)
            above.add(sentence)
        lines.append(toml_text({name: value}).strip())
    for key, finding in said.items():
        section, _, name = key.rpartition(".")
        if (f"{section}." if section else "") == prefix and name not in keys and finding.value is None:
            lines += _comment(f"{_MARKS[finding.confidence]}{name}: {finding.evidence}")
    return lines


def _comment(sentence: str) -> list[str]:
    return textwrap.wrap(sentence, WIDTH, initial_indent="# ", subsequent_indent="#   ", break_long_words=False)


# What is printed and kept of a described log.


NAME = "description"


def write(described: Described, path: Path) -> None:
    """Write the description.  Raises `InputError` for another file of that name, which a user may have edited."""
    check_output_file(path, ".toml")
    write_unless_other(path, described.text.encode())


def document(described: Described, path: Path | None = None, report: Report | None = None) -> Document:
    """What is printed and kept: the findings, and the run of the description, if there was one."""
    values = {
        "title": described.title,
        "description": dict(described.keys),
        "findings": [finding.as_json() for finding in described.findings],
        "written": None if path is None else str(path),
        "run": None if report is None else dict(run_document(report).values),
    }
    return Document(NAME, values, partial(_blocks, described, path, report), {f"{described.title}.toml": described.text})


def _blocks(described: Described, path: Path | None, report: Report | None) -> Iterator[Block]:
    rows, shown = [], set()
    for finding in described.findings:
        value = "" if finding.value is None else _text(finding.value)
        evidence = finding.evidence if finding.evidence not in shown else "the same"
        shown.add(finding.evidence)
        rows.append((f"{finding.key}\n{value}" if value else finding.key, finding.confidence, evidence))
    yield Listing(("key and value", "rests on", "evidence"), rows)
    yield Line()
    left = [finding.key for finding in described.findings if finding.confidence in ("open", "assumed")]
    if left:
        yield Line(f"not seen in this log, so look at: {', '.join(left)}", "yellow")
    if path is not None:
        yield Line(f"written: {path}")
    if report is not None:
        yield Line()
        yield from run_document(report).blocks()


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
