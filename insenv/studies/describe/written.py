"""The description that is written: its keys in sections, each below the sentence on which it rests."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from insenv.logs.formats.text_log import toml_text
from insenv.studies.describe.finding import Finding

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
