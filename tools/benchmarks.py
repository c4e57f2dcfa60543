"""The tables of docs/benchmarks.md and docs/papers, and the stored figures that they are made of.

    python tools/benchmarks.py accuracy            measures the accuracy again (seconds; needs the package onavdata)
    python tools/benchmarks.py speed BENCH.json    takes the times from the document of `insenv bench --json`
    python tools/pages.py                          then writes the tables

Accuracy is the same on every machine: tests/project/test_benchmarks.py compares it.  Times are those of the machine that the
page names.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import reproduced

from insenv.bench import machine_line
from insenv.reproduce import PAPERS, conditions, footnotes

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "tests" / "project" / "benchmarks.json"
Markdown = Callable[[Any, Any], str]

DRIFTS = {
    "ship": "ship, 10 deg and 1 m of sway",
    "car": "car, city drive with engine and wind",
    "aircraft": "aircraft, take-off and climb, engine and gusts",
}
"""The figures ``truth.drift.NAME`` and what each is of."""
LOGS = {
    "positions and velocities": ("n380-car.toml", "coarse"),
    "positions only": ("n380-car-position-only.toml", "coarse"),
    "positions only, started from the reference": ("n380-car-position-only.toml", "reference"),
}
CHANNELS = {
    "north_m": "north m", "east_m": "east m", "down_m": "down m", "vn_mps": "vn m/s", "ve_mps": "ve m/s", "vd_mps": "vd m/s",
    "roll_deg": "roll deg", "pitch_deg": "pitch deg", "heading_deg": "heading deg",
}  # fmt: skip
DIGITS = 3


def stored() -> dict[str, Any]:
    """The stored figures: `drift` (mm), `peer` (mm), `log` (rms by row), `kf_gins`, `speed`."""
    return json.loads(TABLE.read_text(encoding="utf-8"))


def drifts() -> dict[str, float]:
    """Drift of each vehicle, mm."""
    from insenv.bench import truth

    return {name: _rounded(truth.drift(name).value) for name in DRIFTS}


def log_rows() -> dict[str, dict[str, float]]:
    """RMS errors on the recorded log, by row and channel."""
    from insenv import replay

    found = {}
    for name, (file, start) in LOGS.items():
        (result,) = replay(ROOT / "examples" / file, "loosely-coupled", start=start).results
        rms = result.statistics()["rms"]
        found[name] = {channel: _rounded(rms[channel]) for channel in CHANNELS}
    return found


def published() -> dict[str, float]:
    """RMS errors that others published for the log, by channel."""
    from insenv.base.toml import read_toml

    ((_, rms),) = [(p["name"], p["rms"]) for p in read_toml(ROOT / "examples" / "n380-car.toml")["evaluation"]["published"]]
    return {channel: float(rms[channel]) for channel in CHANNELS}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def shown(value: float | None) -> str:
    """A number with at most three significant digits, millions as M; a dash for none."""
    if value is None:
        return "-"
    if value >= 1e6:
        return f"{shown(value / 1e6)} M"
    return f"{_rounded(value):.0f}" if value >= 1e3 else f"{value:.{DIGITS}g}"


# --- tables ------------------------------------------------------------------------------------------


def pages(markdown: Markdown) -> dict[str, dict[str, Callable[[], str]]]:
    """By page, its generated parts by name."""
    return {
        "docs/benchmarks.md": {
            "drift": partial(drift_table, markdown),
            "log": partial(log_table, markdown),
            "speed": partial(speed_table, markdown),
        },
        **{f"docs/papers/{paper}.md": {"rows": partial(paper_table, markdown, paper)} for paper in PAPERS},
    }


def drift_table(markdown: Markdown) -> str:
    """Drift with a perfect unit, beside that of pyins."""
    table = stored()
    head = ("", "insenv", f"{table['peer']['name']}, its own increments and integration")
    rows = [(what, f"{shown(table['drift'][name])} mm", f"{shown(table['peer'][name])} mm") for name, what in DRIFTS.items()]
    return markdown(head, rows)


def log_table(markdown: Markdown) -> str:
    """RMS errors on the recorded log, beside the published ones."""
    rows = [(f"insenv, {name}", *(shown(rms[channel]) for channel in CHANNELS)) for name, rms in stored()["log"].items()]
    others = ("KF-GINS, positions only, started from the reference", *(shown(value) for value in published().values()))
    return markdown(("RMS", *CHANNELS.values()), [*rows, others])


def speed_table(markdown: Markdown) -> str:
    """Times, each beside its floor and target."""
    rows = []
    for row in stored()["speed"]["figures"]:
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        rows.append(
            (
                f"`{row['name']}`",
                row["note"],
                *(f"{shown(row[k])}{unit}" if row[k] is not None else "" for k in ("value", "floor", "target")),
            )
        )
    return markdown(("figure", "what", "value", "floor", "target"), rows)


def paper_table(markdown: Markdown, paper: str) -> str:
    """The conditions of a paper, all its rows, and their notes."""
    numbers, stored_rows = ("published", "printed_form", "ours", "limit"), reproduced.stored()[paper]
    marks, notes = footnotes(row["note"] for row in stored_rows)
    rows = [
        (row["quantity"] + mark, *(shown(row[name]) for name in numbers), row["unit"], str(row["seeds"]))
        for row, mark in zip(stored_rows, marks, strict=True)
    ]
    table = markdown(("quantity", "published", "as printed", "insenv", "limit", "unit", "seeds"), rows)
    return "\n\n".join([f"Conditions: {conditions(paper)}.", table, *notes])


# --- renewing ----------------------------------------------------------------------------------------


def main(arguments: list[str]) -> None:
    """Renew the stored figures."""
    table = stored()
    if arguments == ["accuracy"]:
        table |= {"drift": drifts(), "log": log_rows()}
    elif arguments[:1] == ["speed"] and len(arguments) == 2:
        document = json.loads(Path(arguments[1]).read_text(encoding="utf-8"))
        by_name = {figure["name"]: figure for figure in document["figures"]}
        for row in table["speed"]["figures"]:
            if row["name"] in by_name:
                found = by_name[row["name"]]
                row |= {"value": _rounded(found["value"]), "floor": _rounded(found["floor"]), "unit": found["unit"]}
        table["speed"]["machine"] = machine_line(document["machine"])
    else:
        raise SystemExit(__doc__)
    TABLE.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
