"""The table of the keys beside a flight log; `python -m insenv.logs.flight.keys docs/flight-logs.md` renews it."""

from __future__ import annotations

import sys
from pathlib import Path

from insenv.files.toml import key_table, renew_page, renewed
from insenv.logs.flight.description import FlightDescription

BEGIN = "<!-- keys: begin (python -m insenv.logs.flight.keys docs/flight-logs.md) -->"
END = "<!-- keys: end -->"


def table() -> str:
    """Markdown: the keys."""
    return key_table([("top level", "", FlightDescription, list(FlightDescription.model_fields))])


def renew(path: Path) -> str:
    """The text of a page with its table of keys replaced by the current one."""
    return _renewed(path.read_text(encoding="utf-8"))


def _renewed(text: str) -> str:
    return renewed(text, BEGIN, END, table())


if __name__ == "__main__":
    renew_page(sys.argv[1], _renewed)
