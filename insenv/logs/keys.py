"""The table of a log description's keys, made from the pydantic model; `python -m insenv.logs.keys
docs/logs.md` renews it."""

from __future__ import annotations

import sys
from pathlib import Path

from pydantic import BaseModel

from insenv.files.toml import key_table, renew_page, renewed
from insenv.logs import description

BEGIN, END = "<!-- keys: begin (python -m insenv.logs.keys docs/logs.md) -->", "<!-- keys: end -->"

_SECTIONS: tuple[tuple[str, type[BaseModel]], ...] = (
    ("top level", description.LogDescription),
    ("[imu]", description.ImuSection),
    ("[gnss]", description.GnssSection),
    ("[reference]", description.ReferenceSection),
    ("[initial]", description.InitialSection),
    ("[evaluation]", description.EvaluationSection),
    ("[[evaluation.published]]", description.PublishedSection),
)
_SPECIAL = {"axes": "text or 3x3", "accel_axes": "text or 3x3", "file": "text or list"}


def table() -> str:
    """Markdown: for each section its keys, values, units, defaults and meanings."""
    common = set(description.ImuSection.model_fields) & set(description.ReferenceSection.model_fields)
    sections = []
    for title, model in _SECTIONS:
        names = list(model.model_fields)
        remark = ""
        if title.startswith(("[gn", "[ref")):
            names = [name for name in names if name not in common]
            remark = "The keys about the file and its times are those of [imu]; besides them:"
        sections.append((title, remark, model, names))
    return key_table(sections, _SPECIAL)


def renew(path: Path) -> str:
    """The text of a page with its table of keys replaced by the current one."""
    return _renewed(path.read_text(encoding="utf-8"))


def _renewed(text: str) -> str:
    return renewed(text, BEGIN, END, table())


if __name__ == "__main__":
    renew_page(sys.argv[1], _renewed)
