"""Write the rows of `insenv reproduce` to `tests/reproduce/rows.json`, which `tests/reproduce/test_reproduce.py` compares.

    python tools/reproduced.py              all papers, minutes
    python tools/reproduced.py ecef         one paper; the rows of the others are kept

Run it where a change of the numbers is wanted, and read the difference before committing it. Numbers are written to
`DIGITS` significant digits: the rows are bit-identical on one machine, and on another differ by the rounding of sums.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from insenv.reproduce import PAPERS, Quantity, reproduce

TABLE = Path(__file__).parents[1] / "tests" / "reproduce" / "rows.json"
DIGITS = 6


def row(quantity: Quantity) -> dict[str, Any]:
    """A row of the table: name, unit, seeds, the numbers published, as printed, ours and of the limit, and the note."""
    numbers = {name: getattr(quantity, name) for name in ("published", "printed_form", "ours", "limit")}
    shown = {name: None if value is None else float(f"{value:.{DIGITS}g}") for name, value in numbers.items()}
    return {"quantity": quantity.quantity, "unit": quantity.unit, "seeds": quantity.seeds, **shown, "note": quantity.note}


def stored() -> dict[str, list[dict[str, Any]]]:
    """The table, by paper; empty if there is none."""
    return json.loads(TABLE.read_text(encoding="utf-8")) if TABLE.exists() else {}


def text(table: dict[str, list[dict[str, Any]]]) -> str:
    """JSON with one row per line, in the order of the papers."""
    papers = [
        f"{json.dumps(paper)}: [\n" + ",\n".join(f" {json.dumps(entry)}" for entry in table[paper]) + "\n]"
        for paper in PAPERS
        if paper in table
    ]
    return "{\n" + ",\n".join(papers) + "\n}\n"


def main(papers: list[str]) -> None:
    """Compute the rows of the papers (of all, if none is named) and write the table."""
    table = stored()
    for paper in papers or list(PAPERS):
        for name, found in reproduce(paper):
            table[name] = [row(quantity) for quantity in found]
            print(f"{name}: {len(found)} rows", flush=True)
            TABLE.write_text(text(table), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
