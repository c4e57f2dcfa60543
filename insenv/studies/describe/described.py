"""What is printed, kept and written of a described log."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from insenv.base.output import check_output_file, write_unless_other
from insenv.report import Document, Report, run_document
from insenv.report.document import Block, Line, Listing
from insenv.studies.describe.finding import Described

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
